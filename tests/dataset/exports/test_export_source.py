"""What is exported: splits, samples, the resultant, images that are the dataset's; and how a folder appears."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_dataset import small_study, write_cells

from gelforge.cli import main
from gelforge.config import Sensor
from gelforge.dataset.exports.export import Export, Options, export_dataset, library, whole_folder
from gelforge.dataset.exports.source import SPLITS, open_source, wrench
from gelforge.dataset.join import join_shard
from gelforge.dataset.manifest import describe_dataset
from gelforge.dataset.schema import DatasetError
from gelforge.dataset.shard import ShardDataset
from gelforge.indentation.planning.plan import plan_cells


def test_splits_are_those_of_training_and_presses_whole(made_once):
    """`validation` are the rows that monitor the loss; no orbit is on two sides, every row is in one split."""
    from gelforge.learning.basis.data import training_and_validation

    source = made_once.source
    rows = ShardDataset(made_once.shards, "train")
    sides = training_and_validation(rows, made_once.shards, made_once.study)
    for split, numbers in zip(("train", "validation"), sides):
        exported = {name for press in source.of_split(split) for name in rows_of(source, press)["cell"]}
        assert exported == set(rows.read(numbers, ["cell"])["cell"])
        assert source.counts[split] == len(numbers) > 0
    everyone = np.concatenate([press.rows for press in source.presses])
    assert_array_equal(np.sort(everyone), np.arange(len(source.rows)))

    # Presses are whole and in order
    for press in source.presses:
        rows = source.read([press])
        assert set(rows["press"]) == {press.name.split("/")[1]}
        assert rows["image_index"].tolist() == sorted(rows["image_index"])
        assert set(rows["split"]) == {press.split}


def rows_of(source, press):
    return source.read([press], ["cell", "split", "press"])


def test_a_sample_holds_its_share_of_every_split_and_keeps_its_size(made_once, tmp_path):
    source = made_once.source
    row = source.read(source.presses[:1])
    whole = len(source.rows) * sum(np.asarray(v[0]).nbytes for v in row.values()) / 1e6
    part = source.sampled(whole / 2)
    assert 0.3 * len(source.rows) < sum(part.counts.values()) <= 0.5 * len(source.rows)
    assert list(part.counts) == list(SPLITS)
    with pytest.raises(DatasetError, match="no room for an indentation of each split"):
        source.sampled(whole / 1000)
    too_much = Export("much", "", lambda source, folder, options: (folder / "a").write_bytes(b"0" * 10_000))
    with pytest.raises(DatasetError, match=r"takes 0.0 MB, --sample-mb is 0.005"):
        export_dataset(too_much, part, tmp_path / "out", Options(), 0.005)
    assert list(tmp_path.iterdir()) == []


def test_the_resultant_is_computed_by_hand_and_a_missing_library_named():
    # Resultant of one bin and of a dome. Moments by hand: a bin's force at its centre, about the sensor's middle
    layers = [{"name": "gel", "thickness_mm": 6.0, "material": "soft"}]
    block = Sensor(layers=layers, bins={"nx": 4, "ny": 2})  # 32 x 32 mm: bins of 8 x 16
    forces = np.zeros((1, 8, 3))
    forces[0, 3] = 1, 0, -2  # centre (28, 8) mm, 12 and -8 mm from the middle
    found = wrench(forces, forces.sum(axis=1), block)
    assert_allclose(found, [[1, 0, -2, 16, 24, 8]])
    dome = Sensor(layers=layers, bins={"nx": 4, "ny": 2}, shape={"kind": "dome"})
    z = 6 * (np.sqrt(1 - (12**2 + 8**2) / 16**2) - 1)
    assert_allclose(wrench(forces, forces.sum(axis=1), dome), [[1, 0, -2, 16, 24 + z, 8]])

    # A library that is not there is named with its remedy
    with pytest.raises(DatasetError, match=r"no_such_library.*pip install 'gelforge\[export\]'"):
        library("no_such_library")


def test_labels_only_are_exported_by_cell(tmp_path):
    study = small_study(tmp_path, sessions=())
    shard = tmp_path / "dataset" / "shard-00000.h5"
    join_shard(study, list(plan_cells(study)), write_cells(study, tmp_path), {}, shard)
    describe_dataset(study, [shard], {}, shard.parent)
    source = open_source(shard.parent)
    assert sorted(press.name for press in source.presses) == sorted(plan_cells(study))
    assert "feature" not in source.variables
    with pytest.raises(DatasetError, match="labels only"):
        open_source(shard.parent, images=True)
    assert (
        main(
            [
                "export",
                "dataset",
                "--results",
                str(tmp_path),
                "--format",
                "robomimic",
                "--out",
                str(tmp_path / "out"),
            ]
        )
        == 0
    )
    assert "measured" in (tmp_path / "out" / "README.md").read_text()


def test_images_or_shards_that_have_changed_are_refused(made_once, tmp_path):
    study = made_once.study
    elsewhere = tmp_path / "data"
    shutil.copytree(study.data_folder, elsewhere)
    source = open_source(made_once.folder, images=True, data=elsewhere)
    press = source.presses[0]
    assert source.read([press])["image"] == made_once.source.read([press])["image"]
    row = source.read([press], ["session", "image_file"])
    path = elsewhere / "recordings" / row["session"][0] / "images" / row["image_file"][0]
    path.write_bytes(path.read_bytes() + b" ")
    with pytest.raises(DatasetError, match="has changed since the dataset was made"):
        source.read([press])
    path.unlink()
    with pytest.raises(DatasetError, match="is missing; run where the study was run"):
        source.read([press])

    # A changed shard is refused
    shutil.copytree(made_once.folder, tmp_path / "dataset")
    shutil.copy(made_once.shards[0], tmp_path / "dataset" / "shard-00001.h5")
    with pytest.raises(DatasetError, match="not the shard that"):
        open_source(tmp_path / "dataset")


# ----------------------------------------------------------------------------------------- whole or absent
def test_a_folder_appears_when_it_is_whole_also_after_a_killed_export(tmp_path):
    # A folder appears when it is whole
    def broken():
        with whole_folder(tmp_path / "out") as folder:
            (folder / "a").write_text("a")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        broken()
    assert list(tmp_path.iterdir()) == []
    with whole_folder(tmp_path / "out") as folder:
        (folder / "a").write_text("a")
        assert not (tmp_path / "out").exists()
    assert (tmp_path / "out" / "a").read_text() == "a"
    with pytest.raises(DatasetError, match="exists already"), whole_folder(tmp_path / "out"):
        pass

    # A killed export leaves nothing that the next does not remove
    killed = tmp_path / "killed"
    killed.mkdir()
    code = (
        "import os, sys; from gelforge.dataset.exports.export import whole_folder\n"
        "with whole_folder(sys.argv[1]) as folder:\n"
        "    (folder / 'half').write_text('x'); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code, str(killed / "out")], check=False)
    assert not (killed / "out").exists()
    assert len(list(killed.iterdir())) == 1
    with whole_folder(killed / "out") as folder:
        (folder / "a").write_text("a")
    assert [path.name for path in killed.iterdir()] == ["out"]


# -------------------------------------------------------------------------------------------- command line
def test_export_on_the_command_line(made_once, tmp_path, capsys):
    line = ["export", "dataset", "--results", str(made_once.folder), "--format", "robomimic", "--images"]
    assert main([*line, "--out", str(tmp_path / "out"), "--licence", "cc-by-4.0"]) == 0
    said = capsys.readouterr().out
    assert "72 " not in said and "train" in said and "SYNTHETIC" in said
    assert "Licence: cc-by-4.0" in (tmp_path / "out" / "README.md").read_text()
    assert main([*line, "--out", str(tmp_path / "out")]) == 1
    assert "exists already" in capsys.readouterr().err

    # Export of a model still needs both
    assert main(["export", "--out", "x.onnx"]) == 1
    assert "export needs --study or --model" in capsys.readouterr().err
