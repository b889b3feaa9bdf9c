"""The join: right rows in, and nothing joined that is missing, damaged or of other settings."""

import json
import os
import subprocess
import sys
import tracemalloc

import h5py
import numpy as np
import pytest
from edited_file import edited
from small_dataset import (
    DEPTHS,
    DWELL,
    cell_of,
    feature_rows,
    label,
    sample_table,
    small_study,
    write_cells,
    write_features,
)

from gelforge.dataset.join import join_shard
from gelforge.dataset.schema import COLUMNS, DatasetError
from gelforge.dataset.shard import ShardDataset, lineage, shard_attributes
from gelforge.indentation.cells.cell_file import Cell, CellError, write_cell
from gelforge.indentation.planning.plan import plan_cells


def rows_of(path, *names):
    rows = ShardDataset([path])
    return rows.read(np.arange(len(rows)), names or list(COLUMNS))


def test_every_image_has_its_row_with_label_features_and_readings(made):
    rows = rows_of(made.join())
    expected = {
        (session, press, index): (cell, depth, image)
        for session in made.study.sessions
        for session, press, cell, depth, image, index in sample_table(made.study, session)[
            ["session", "press", "cell", "depth_mm", "image", "image_index"]
        ].itertuples(index=False)
    }
    found = {
        (s, p, i): (c, d, image)
        for s, p, i, c, d, image in zip(
            *(rows[name] for name in ("session", "press", "image_index", "cell", "depth_mm", "image"))
        )
    }
    assert found == expected
    assert len(rows["cell"]) == len(expected)

    # Rows hold label features and readings of their press
    planned = plan_cells(made.study)
    for i in range(len(rows["cell"])):
        true = label(planned[rows["cell"][i]], rows["depth_mm"][i])
        # labels are stored in single precision
        np.testing.assert_allclose(rows["force_distribution_N"][i], true, rtol=1e-6)
        np.testing.assert_allclose(rows["total_force_fem_N"][i], true.sum(axis=0), rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(
            rows["total_force_ft_N"][i], 1.1 * true.sum(axis=0), rtol=1e-12, atol=1e-15
        )
    table = sample_table(made.study, "day2")
    features = dict(zip(zip(table["press"], table["image_index"]), feature_rows(table)))
    for i in np.flatnonzero(rows["session"] == "day2"):
        np.testing.assert_array_equal(rows["feature"][i], features[rows["press"][i], rows["image_index"][i]])

    # Untouched rows have zero label and measured features
    untouched = rows["untouched"]
    assert untouched.sum() == len(made.names) * len(DEPTHS)
    assert (rows["force_distribution_N"][untouched] == 0).all()
    assert (rows["total_force_fem_N"][untouched] == 0).all()
    assert (rows["depth_mm"][untouched] <= 0).all()
    assert (rows["depth_mm"][~untouched] > 0).all()
    assert (rows["feature"][untouched, :16] > 0).any(axis=1).all()


def test_the_same_inputs_give_the_same_bytes_in_chunks_and_in_any_order(made):
    # The same inputs give the same bytes
    assert made.join("a.h5").read_bytes() == made.join("b.h5").read_bytes()

    # Shards of chunks are the whole in parts
    whole = rows_of(made.join("whole.h5"), "cell", "feature")
    parts = [rows_of(made.join(f"part{i}.h5", made.names[i::2]), "cell", "feature") for i in range(2)]
    assert sorted(whole["cell"]) == sorted(np.concatenate([part["cell"] for part in parts]))
    for part, first in zip(parts, (0, 1)):
        chosen = np.isin(whole["cell"], made.names[first::2])
        np.testing.assert_array_equal(part["feature"], whole["feature"][chosen])

    # Reading keeps the order asked for
    rows = ShardDataset([made.join("a.h5", made.names[:4]), made.join("b.h5", made.names[4:])])
    everything = rows.read(np.arange(len(rows)), ["cell", "image", "feature"])
    index = np.random.default_rng(0).integers(0, len(rows), 50)  # with repetitions
    some = rows.read(index, ["cell", "image", "feature"])
    for name in some:
        np.testing.assert_array_equal(some[name], everything[name][index])


def test_rows_in_any_order_are_joined(made):
    names = ("session", "press", "image_index", "feature")
    expected = rows_of(made.join("ordered.h5"), *names)
    by_image = dict(zip(zip(*(expected[name] for name in names[:3])), expected["feature"]))
    table = sample_table(made.study, "day1")
    shuffled = table.sample(frac=1, random_state=3)
    write_features(made.features["day1"], made.study, shuffled, feature=feature_rows(table)[shuffled.index])
    found = rows_of(made.join("shuffled.h5"), *names)
    assert len(found["press"]) == len(by_image)
    for *key, feature in zip(*(found[name] for name in names)):
        np.testing.assert_array_equal(feature, by_image[tuple(key)])


def test_labels_only_without_sessions(tmp_path):
    study = small_study(tmp_path, sessions=())
    names = list(plan_cells(study))
    out = tmp_path / "shard.h5"
    assert join_shard(study, names, write_cells(study, tmp_path), {}, out) == len(names) * len(DEPTHS)
    assert shard_attributes(out)["labels_only"] is True
    rows = ShardDataset([out])
    assert (rows.read(np.arange(len(rows)), ["depth_mm"])["depth_mm"] == np.tile(DEPTHS, len(names))).all()
    with pytest.raises(DatasetError, match="labels only"):
        rows.read(np.arange(2), ["feature"])


# ------------------------------------------------------------------------------------------ what stops it
def rewrite_cell(made, name, arrays=(), **attributes):
    cell = cell_of(plan_cells(made.study)[name])
    write_cell(made.cells[name], Cell(cell.arrays | dict(arrays), cell.attributes | attributes))


def without(made, **where):
    """Rewrite the first session without the rows whose columns have these values."""
    table = sample_table(made.study, "day1")
    lost = np.logical_and.reduce([table[name] == value for name, value in where.items()])
    assert lost.any()
    write_features(made.features["day1"], made.study, table[~lost])


def test_what_tests_of_the_session_excluded_is_left_out_without_an_error(made):
    """The image at depth that was excluded is no row, and an excluded force is NaN in `total_force_ft_N`."""
    without(made, press="p002", image_index=DWELL)
    with edited(made.features["day1"]) as file:
        file.attrs["excluded_images"] = json.dumps({"p002": 1})
        force = file["force_N"][()]
        force[file["press"].asstr()[()] == "p002"] = np.nan
        file["force_N"][...] = force
    rows = rows_of(made.join(), "press", "session", "total_force_ft_N")
    hit = (rows["press"] == "p002") & (rows["session"] == "day1")
    assert hit.sum() == DWELL  # the zero image and two of three
    assert np.isnan(rows["total_force_ft_N"][hit]).all()
    assert np.isfinite(rows["total_force_ft_N"][~hit]).all()


@pytest.mark.parametrize(("offset", "joins"), [(0.009, True), (0.02, False)])
def test_depths_join_within_a_hundredth(made, offset, joins):
    table = sample_table(made.study, "day1")
    table["depth_mm"] += np.where(table["phase"] == "dwell", offset, 0.0)
    write_features(made.features["day1"], made.study, table)
    if joins:
        assert set(rows_of(made.join(), "depth_mm")["depth_mm"]) == {
            0.0,
            *DEPTHS,
        }  # the planned depth, not the recorded
    else:
        with pytest.raises(DatasetError, match="depth 0.52 mm is 0.02 mm from the nearest depth"):
            made.join()


def of_bins(wrong):
    def spoil(made):
        with edited(made.cells["x1_y1"]) as file:
            file["bin_force_N"][1, 3, 2] += wrong

    return spoil


def of_features(change=lambda table: None, **columns):
    """Return a spoiler that writes features of day1 with another table or other columns, functions of the table."""

    def spoil(made):
        table = sample_table(made.study, "day1")
        change(table)
        write_features(
            made.features["day1"], made.study, table, **{name: make(table) for name, make in columns.items()}
        )

    return spoil


def not_finite(table):
    feature = feature_rows(table)
    feature[5, 3] = np.nan  # an image at depth of the second press
    return feature


def without_cell(table):
    table.loc[table["press"] == "p001", "cell"] = ""


NO_SEAL = "(holds no checksum|damaged or edited)"
SPOILT = {
    "missing cell": (lambda made: made.cells["x1_y1"].unlink(), r"x1_y1\.h5.*no such file"),
    **{
        f"cell cut to {kept} bytes": (
            lambda made, kept=kept: os.truncate(made.cells["x1_y1"], kept),
            rf"x1_y1\.h5.*{NO_SEAL}",
        )
        for kept in (0, 100, 3000)
    },
    "cell of other settings": (
        lambda made: rewrite_cell(made, "x1_y1", inputs_digest="another"),
        "x1_y1.*other settings",
    ),
    "cell of another position": (
        lambda made: rewrite_cell(made, "x1_y1", x_mm=16.2),
        r"x1_y1 lies at \(16\.2",
    ),
    "file of another cell": (
        lambda made: made.cells["x1_y1"].write_bytes(made.cells["x0_y1"].read_bytes()),
        r"x1_y1\.h5: holds site 'x0_y1'",
    ),
    "cell of other depths": (
        lambda made: rewrite_cell(made, "x1_y1", {"depth_mm": np.array([0.5, 1.1])}),
        r"x1_y1 has depths \[0\.5, 1\.1\]",
    ),
    "bins that do not sum to the force": (of_bins(1e-3), "x1_y1: bins and total force differ"),
    "a bin that is no number": (of_bins(np.nan), "x1_y1: bins and total force differ"),
    "missing features": (lambda made: made.features["day1"].unlink(), r"day1\.h5: no such file"),
    "truncated features": (
        lambda made: os.truncate(made.features["day1"], made.features["day1"].stat().st_size // 2),
        rf"day1\.h5: {NO_SEAL}",
    ),
    "features of other settings": (
        lambda made: made.feature_digests.update(day1="digest of now"),
        "day1 was made with other settings",
    ),
    "features of other regions": (
        of_features(feature=lambda table: np.zeros((len(table), 18), np.float32)),
        "18 features a row, expected 32",
    ),
    "missing image in the middle": (
        lambda made: without(made, press="p002", image_index=2),
        r"indentation p002 .*image_index \[2\] missing",
    ),
    "missing last image": (
        lambda made: without(made, press="p002", image_index=DWELL),
        "indentation p002 .*2 images at depth, 3 in most indentations",
    ),
    "missing zero image": (
        lambda made: without(made, press="p002", image_index=0),
        r"indentation p002 .*image_index \[0\] missing",
    ),
    "press without its cell": (of_features(without_cell), "indentation p001.*site '' is not in the plan"),
    "features that are not finite": (
        of_features(feature=not_finite),
        r"image p001_1.png: features are not finite",
    ),
}


@pytest.mark.parametrize("name", SPOILT)
def test_inputs_that_do_not_fit_are_refused(made, name):
    spoil, message = SPOILT[name]
    spoil(made)
    with pytest.raises((CellError, DatasetError), match=message):
        made.join()


def test_an_error_leaves_the_old_shard_and_a_failed_cell_is_left_out_by_name(made):
    # An error leaves the old shard
    path = made.join()
    before = path.read_bytes()
    made.cells["x2_y2"].unlink()
    with pytest.raises(CellError):
        made.join()
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]

    # A failed cell is left out by name
    failed = made.names[4]
    write_cells(made.study, made.folder, failed=[failed])
    path = made.join()
    assert shard_attributes(path)["failed_cells"] == {failed: "no equilibrium at 1 mm"}
    assert set(rows_of(path, "cell")["cell"]) == set(made.names) - {failed}


# ----------------------------------------------------------------------------------- memory, workers, origin
def peak_of_join(tmp_path, spacing):
    study = small_study(tmp_path, ("day1",), spacing, features={"regions": 20})
    cells = write_cells(study, tmp_path)
    path = write_features(tmp_path / "features" / "day1.h5", study, sample_table(study, "day1"))
    tracemalloc.start()
    rows = join_shard(study, list(cells), cells, {"day1": path}, tmp_path / "shard.h5")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return rows, peak


@pytest.mark.thorough
def test_memory_does_not_grow_with_the_rows(tmp_path):
    """Features alone would be 3.2 kB a row; what may grow are names and row numbers of the shard's own presses."""
    few, small = peak_of_join(tmp_path / "few", 11.0)
    many, large = peak_of_join(tmp_path / "many", 2.75)
    assert many > 8 * few
    assert (large - small) / (many - few) < 800


READ_IN_WORKER = """
import sys, pickle
from multiprocessing import get_context
import numpy as np
from gelforge.dataset.shard import ShardDataset

def total(rows_and_index):
    rows, index = rows_and_index
    return float(rows.read(index, ["feature"])["feature"].sum())

if __name__ == "__main__":
    rows = ShardDataset(sys.argv[1:])
    here = total((rows, np.arange(len(rows))))  # opens the files in this process first
    with get_context("fork").Pool(2) as pool:
        parts = pool.map(total, [(rows, part) for part in np.array_split(np.arange(len(rows)), 8)])
    assert abs(sum(parts) - here) < 1e-3 * abs(here), (parts, here)
"""


def test_rows_are_read_in_worker_processes(made, tmp_path):
    script = tmp_path / "read_in_worker.py"
    script.write_text(READ_IN_WORKER)
    subprocess.run([sys.executable, str(script), str(made.join())], check=True, timeout=60)


def test_lineage_units_and_descriptions_are_stored(made):
    path = made.join()
    rows = rows_of(path, "cell", "image", "session")
    found = lineage(path, 7)
    assert found["cell"] == rows["cell"][7]
    assert found["image"] == rows["image"][7]
    assert found["label"]["file"].endswith(f"{rows['cell'][7]}.h5")
    assert found["label"]["inputs_digest"] == f"digest of {rows['cell'][7]}"
    assert found["recording"]["features"].endswith(f"{rows['session'][7]}.h5")
    assert found["synthetic"] is True
    json.dumps(found)
    with pytest.raises(DatasetError, match="row 100000 does not exist"):
        lineage(path, 100000)

    # Axis zero is the sample with units and description
    with h5py.File(made.join()) as file:
        count = file.attrs["rows"]
        assert {len(file[name]) for name in file} == {count}
        assert all(file[name].attrs["units"] and file[name].attrs["description"] for name in file)
        assert file["feature"].chunks[0] <= 256
