"""Every format gives back what the shards hold, read by the format's own library and by what is installed anyway."""

import base64
import hashlib
import io
import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from PIL import Image

from gelforge.dataset.exports import NAMES, format_of, formats
from gelforge.dataset.exports.images import pixels
from gelforge.dataset.exports.source import SPLITS, wrench

EXAMPLE = Path("docs/adding/examples/npz.py")
PARQUET = ("huggingface", "croissant", "lerobot", "rocrate")


def grey(encoded):
    return pixels(encoded)[:, :, 0]


@pytest.mark.parametrize("name", NAMES)
def test_a_file_is_a_format_and_its_sums_hold(name, exported):
    assert format_of(name).name == name
    if name in PARQUET:
        pytest.importorskip("pyarrow")
    if name in ("mcap", "rerun"):
        pytest.importorskip(name)
    folder = exported(name)
    lines = (folder / "SHA256SUMS").read_text().splitlines()
    assert {line[66:] for line in lines} == {
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    } - {"SHA256SUMS"}
    for line in lines:
        assert line[:64] == hashlib.sha256((folder / line[66:]).read_bytes()).hexdigest()
    assert "SYNTHETIC" in (folder / "README.md").read_text()
    assert "FOLDER" in (folder / "README.md").read_text()


def test_the_guides_example_is_a_format(exported, expected, tmp_path, monkeypatch):
    shutil.copy(EXAMPLE, tmp_path)
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path)])
    folder = exported("npz")
    for split in SPLITS:
        with np.load(folder / f"{split}.npz") as found:
            assert set(expected[split]) - set(found) == {
                "session",
                "press",
                "cell",
                "phase",
                "image_file",
                "image",
                "split",
            }
            for name in found:
                assert_array_equal(found[name], expected[split][name])
    assert "SYNTHETIC" in (folder / "README.md").read_text()
    assert len((folder / "SHA256SUMS").read_text().splitlines()) == 4


# ------------------------------------------------------------------------------------------- huggingface
def test_parquet_holds_every_column_exactly(exported, expected, made_once):
    pq = pytest.importorskip(
        "pyarrow.parquet", reason="pyarrow is not installed: pip install 'gelforge[export]'"
    )
    for split in SPLITS:
        table = pq.read_table(exported("huggingface") / "data" / f"{split}-00000-of-00001.parquet")
        assert table.column_names == list(made_once.source.variables)
        for name, values in expected[split].items():
            found = table[name].to_pylist()
            if name == "image":
                assert [one["bytes"] for one in found] == values
            else:
                assert_array_equal(np.array(found, values.dtype), values)


def test_datasets_loads_three_splits(exported, expected, tmp_path):
    datasets = pytest.importorskip(
        "datasets", reason="datasets is not installed: the folder is read by pyarrow only"
    )
    loaded = datasets.load_dataset(str(exported("huggingface")), cache_dir=str(tmp_path))
    assert list(loaded) == list(SPLITS)
    for split in SPLITS:
        rows = loaded[split][:]  # Python's numbers: other formats of the library round float64
        assert len(rows["cell"]) == len(expected[split]["cell"])
        for name, values in expected[split].items():
            if name == "image":
                assert_array_equal(np.stack(rows[name]), [grey(content) for content in values])
            else:
                assert_array_equal(np.array(rows[name], values.dtype), values)
    assert set(loaded["train"]["cell"]).isdisjoint(loaded["test"]["cell"])


def test_datasets_takes_no_split_from_the_shards_themselves(made_once, tmp_path):
    """Shards hold all splits: a tool that loads them as `train` would train on the test cells."""
    datasets = pytest.importorskip("datasets", reason="datasets is not installed")
    assert list(datasets.load_dataset(str(made_once.folder), cache_dir=str(tmp_path))) == ["unsplit"]


# --------------------------------------------------------------------------------------------- croissant


def test_mlcroissant_reads_every_row_without_errors(exported, expected, made_once):
    # Mlcroissant reads every row
    croissant = pytest.importorskip("mlcroissant", reason="mlcroissant is not installed")
    dataset = croissant.Dataset(jsonld=str(exported("croissant") / "croissant.json"))
    rows = {}
    for record in dataset.records("rows"):
        split = record["rows/split"]
        rows.setdefault(split.decode() if isinstance(split, bytes) else split, []).append(record)
    assert set(rows) == set(SPLITS)
    for split in SPLITS:
        for name in ("force_distribution_N", "feature", "total_force_ft_N", "depth_mm"):
            found = np.array([np.array(one[f"rows/{name}"], float) for one in rows[split]])
            wanted = np.asarray(expected[split][name], float)
            assert_array_equal(found.reshape(wanted.shape), wanted)
        shown = [np.array(one["rows/image"]) for one in rows[split]]
        assert_array_equal(shown, [grey(content) for content in expected[split]["image"]])

    # Croissant of the export and of the shards has no errors
    for file in (exported("croissant") / "croissant.json", made_once.folder / "croissant.json"):
        found = croissant.Dataset(jsonld=str(file)).metadata
        assert not found.issues.errors
        assert found.ctx.conforms_to.value.endswith("croissant/1.1")


def test_croissant_names_columns_and_files(exported, made_once):
    pytest.importorskip("pyarrow")
    folder = exported("croissant")
    content = json.loads((folder / "croissant.json").read_text())
    files = [one for one in content["distribution"] if one["@type"] == "cr:FileObject"]
    for one in files:
        assert one["sha256"] == hashlib.sha256((folder / one["contentUrl"]).read_bytes()).hexdigest()
    fields = {one["name"]: one for one in content["recordSet"][1]["field"]}
    assert list(fields) == list(made_once.source.variables)
    assert fields["force_distribution_N"]["arrayShape"] == "25,3"


# ----------------------------------------------------------------------------------------------- lerobot
def every_press(source):
    return source.read(source.presses)


def test_lerobot_layout_is_whole(exported, made_once):
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    folder, source = exported("lerobot"), made_once.source
    info = json.loads((folder / "meta" / "info.json").read_text())
    episodes = pq.read_table(folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pydict()
    data = pq.read_table(folder / info["data_path"].format(chunk_index=0, file_index=0))
    assert info["codebase_version"] == "v3.0"
    assert data.column_names == list(info["features"])
    assert info["total_frames"] == len(data) == episodes["dataset_to_index"][-1]
    assert episodes["length"] == [len(press.rows) for press in source.presses]
    # the ranges of episodes are the splits
    for split, episodes_of in info["splits"].items():
        start, end = map(int, episodes_of.split(":"))
        assert set(episodes["split"][start:end]) == {split}
    rows = every_press(source)
    assert_array_equal(data["observation.forces_3d"].to_pylist(), rows["force_distribution_N"])
    stats = json.loads((folder / "meta" / "stats.json").read_text())
    assert stats["observation.forces_3d"]["min"] == rows["force_distribution_N"].min(axis=0).tolist()
    np.testing.assert_allclose(
        stats["observation.forces_3d"]["std"],
        rows["force_distribution_N"].std(axis=0, dtype=float),
        atol=1e-9,
    )
    shown = np.stack([grey(content) for content in rows["image"]]) / 255
    image = stats["observation.images.tactile"]
    np.testing.assert_allclose(
        [image["mean"], image["std"]], np.reshape([shown.mean(), shown.std()], (2, 1, 1, 1))
    )


def test_lerobot_loads_forces_wrench_and_images(exported, made_once, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    reason = "lerobot is not installed: the layout is read by pyarrow only"
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason=reason)
    dataset = lerobot.LeRobotDataset("gelforge/small", root=exported("lerobot"))
    source = made_once.source
    rows = every_press(source)
    assert len(dataset) == len(rows["cell"])
    assert dataset.num_episodes == len(source.presses)
    resultant = wrench(rows["force_distribution_N"], rows["total_force_fem_N"], source.sensor)
    for number in range(0, len(dataset), 7):
        row = dataset[number]
        assert_array_equal(row["observation.forces_3d"].numpy(), rows["force_distribution_N"][number])
        assert_array_equal(row["observation.wrench"].numpy(), resultant[number].astype(np.float32))
        shown = np.rint(255 * row["observation.images.tactile"].numpy()[0])
        assert_array_equal(shown, grey(rows["image"][number]))
    test = json.loads((exported("lerobot") / "meta" / "info.json").read_text())["splits"]["test"]
    start, end = map(int, test.split(":"))
    part = lerobot.LeRobotDataset(
        "gelforge/small", root=exported("lerobot"), episodes=list(range(start, end))
    )
    assert len(part) == source.counts["test"]


# --------------------------------------------------------------------------------------------- robomimic
def test_robomimic_has_demonstrations_and_masks_and_other_images_become_png(exported, made_once, tmp_path):
    # Robomimic demonstrations and masks
    source = made_once.source
    with h5py.File(exported("robomimic") / "demonstrations.hdf5") as file:
        assert file["data"].attrs["total"] == len(source.rows)
        for split, mask in (("train", "train"), ("validation", "valid"), ("test", "test")):
            names = file[f"mask/{mask}"].asstr()[:]
            presses = source.of_split(split)
            assert len(names) == len(presses) > 0
            for name, press in zip(names, presses):
                demonstration, rows = file["data"][name], source.read([press])
                assert demonstration.attrs["num_samples"] == len(press.rows)
                assert demonstration["dones"][:].tolist() == [False] * (len(press.rows) - 1) + [True]
                for column, variable in source.variables.items():
                    if variable.kind == "text":
                        assert_array_equal(demonstration[f"about/{column}"].asstr()[:], rows[column])
                    elif variable.kind == "image":
                        shown = [grey(content) for content in rows[column]]
                        assert_array_equal(demonstration["obs/image"][..., 0], shown)
                    else:
                        assert_array_equal(demonstration[f"obs/{column}"][:], rows[column])

    # An image of another kind becomes png without loss
    from gelforge.dataset.exports.images import RowImages
    from gelforge.files import file_sha256

    folder = tmp_path / "recordings" / "s" / "images"
    folder.mkdir(parents=True)
    shown = np.arange(300, dtype=np.uint8).reshape(10, 10, 3)
    Image.fromarray(shown).save(folder / "a.tiff")
    images = RowImages([{"file": str(folder / "a.tiff"), "sha256": file_sha256(folder / "a.tiff")}])
    encoded = images.encoded("s", "a.tiff")
    assert Image.open(io.BytesIO(encoded)).format == "PNG"
    assert_array_equal(pixels(encoded), shown)


# ---------------------------------------------------------------------------------------- mcap, ro-crate
def test_mcap_holds_forces_wrench_and_images(exported, made_once):
    mcap = pytest.importorskip("mcap.reader", reason="mcap is not installed: pip install 'gelforge[export]'")
    source = made_once.source
    for split in SPLITS:
        rows = source.read(source.of_split(split))
        with open(exported("mcap") / f"{split}.mcap", "rb") as file:
            reader = mcap.make_reader(file, validate_crcs=True)
            found = {}
            for _, channel, message in reader.iter_messages():
                found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
        assert [one["force_N"] for _, one in found["/tactile/forces_3d"]] == rows[
            "force_distribution_N"
        ].tolist()
        assert [round(t / 1e8) for t, _ in found["/tactile/state"]] == list(range(len(rows["cell"])))
        resultant = wrench(rows["force_distribution_N"], rows["total_force_fem_N"], source.sensor)
        torque = [[one["torque"][axis] for axis in "xyz"] for _, one in found["/tactile/wrench"]]
        assert_array_equal(torque, resultant[:, 3:] / 1000)
        assert [base64.b64decode(one["data"]) for _, one in found["/tactile/image"]] == rows["image"]


def test_rocrate_names_every_file(exported):
    rocrate = pytest.importorskip("rocrate.rocrate", reason="rocrate is not installed")
    pytest.importorskip("pyarrow")
    folder = exported("rocrate")
    crate = rocrate.ROCrate(str(folder))
    parts = {one.id: one for one in crate.root_dataset["hasPart"]}
    present = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert set(parts) == present - {"SHA256SUMS", "ro-crate-metadata.json"}
    for name, part in parts.items():
        assert part["sha256"] == hashlib.sha256((folder / name).read_bytes()).hexdigest()
    assert {one["name"] for one in crate.root_dataset["variableMeasured"]} >= {
        "force_distribution_N",
        "image",
    }
    assert "SYNTHETIC" in crate.description


def test_rerun_holds_forces_and_images(exported, made_once):
    rerun = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed")
    source = made_once.source
    for split in SPLITS:
        rows = source.read(source.of_split(split))
        found = {"forces": {}, "image": {}}
        for chunk in rerun.RrdReader(str(exported("rerun") / f"{split}.rrd")).stream():
            batch = chunk.to_record_batch().to_pydict()
            for kind, column in (("forces", "Tensor:data"), ("image", "EncodedImage:blob")):
                if column in batch:
                    found[kind] |= dict(zip(batch["row"], batch[column]))
        count = len(rows["cell"])
        forces = [found["forces"][row][0]["buffer"] for row in range(count)]
        assert_array_equal(np.reshape(forces, (count, 25, 3)), rows["force_distribution_N"])
        assert [bytes(found["image"][row][0]) for row in range(count)] == rows["image"]
