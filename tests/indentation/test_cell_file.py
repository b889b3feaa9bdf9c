"""Cell files: what is written comes back, what is broken is named."""

import h5py
import numpy as np
import pytest
from edited_file import edited

from gelforge.indentation.cells.cell_file import (
    DATASETS,
    OPTIONAL,
    SECTION,
    Cell,
    CellError,
    read_cell,
    write_cell,
)

rng = np.random.default_rng(1)


def invented_cell() -> Cell:
    """Return a cell of invented numbers with every mandatory array, large and small ones."""
    arrays = {name: rng.normal(size=(2, 3)) for name in DATASETS if name not in OPTIONAL} | {
        "depth_mm": np.array([0.5, 1.0]),
        "total_force_N": rng.normal(size=(2, 3)),
        "bin_force_N": rng.normal(size=(2, 2500, 3)),
        "node_state": rng.integers(0, 3, (2, 30)).astype(np.int8),
        "node_displacement_mm": rng.normal(size=(2, 30, 3)).astype(np.float32),
    }
    attributes = {"cell": "x0_y0", "status": "converged", "reason": "", "x_mm": 5.0, "iterations": [3, 4]}
    return Cell(arrays, attributes | {"regions": ["gel", "skin"]})


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "cells" / "x0_y0.h5"
    write_cell(path, invented_cell())
    return path


def test_round_trip_of_what_is_asked_for_in_any_order(tmp_path, path):
    # Round trip with units and of what is asked for
    cell = invented_cell()
    write_cell(tmp_path / "a.h5", cell)
    back = read_cell(tmp_path / "a.h5")
    assert set(back.arrays) == set(cell.arrays)
    for name, array in cell.arrays.items():
        assert np.array_equal(back.arrays[name], array)
        assert back.arrays[name].dtype == array.dtype
    assert back.attributes["x_mm"] == 5.0
    assert list(back.attributes["iterations"]) == [3, 4]
    assert list(back.attributes["regions"]) == ["gel", "skin"]
    assert back.converged

    # Only what is asked for is read
    assert set(read_cell(path, ["depth_mm"]).arrays) == {"depth_mm"}

    # Every dataset has unit and description
    with h5py.File(path) as file:
        for name, data in file.items():
            assert (data.attrs["units"], data.attrs["description"]) == DATASETS[name]

    # The order of the arrays changes no byte. Names in a set come in another order in each process, as of the bars
    # of a mirrored cell once
    cell = read_cell(path)
    write_cell(tmp_path / "one.h5", cell)
    write_cell(tmp_path / "other.h5", Cell(dict(reversed(cell.arrays.items())), cell.attributes))
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "other.h5").read_bytes()


@pytest.mark.parametrize("wrong", [np.nan, -np.inf])
@pytest.mark.parametrize(
    "name", ["total_force_N", "bin_force_N", "node_displacement_mm", "bin_sigma_mesh_N", "sensitivity_total"]
)
def test_no_number_that_is_none_is_written(path, name, wrong):
    before, cell = path.read_bytes(), invented_cell()
    cell.arrays[name] = np.array(cell.arrays.get(name, np.ones((2, 5, 3))))
    cell.arrays[name][1, 2] = wrong
    with pytest.raises(
        CellError, match=rf"x0_y0\.h5: \d of \d+ numbers of {name} are not finite, the first is {wrong}"
    ):
        write_cell(path, cell)
    assert path.read_bytes() == before


def test_a_refused_write_leaves_no_file_and_the_old_one_whole(tmp_path, path, monkeypatch):
    # Attributes are finite but for what is not known. NaN: the share of volume outside the range of a law that came
    # without one
    cell = invented_cell()
    unknown = {"volume_outside_valid_range": np.array([[np.nan, 0.0]])}
    write_cell(tmp_path / "a.h5", Cell(cell.arrays, cell.attributes | unknown))
    with pytest.raises(
        CellError, match="1 of 2 numbers of energy_mJ are not finite, the first is nan at .1."
    ):
        write_cell(tmp_path / "b.h5", Cell(cell.arrays, cell.attributes | {"energy_mJ": [0.1, np.nan]}))
    assert not (tmp_path / "b.h5").exists()

    # An interrupted write leaves the old file and no remains
    before, files = path.read_bytes(), sorted(path.parent.iterdir())
    cell.arrays["unknown_name"] = np.zeros(3)  # a name that DATASETS does not know stops the write half-way
    with pytest.raises(KeyError):
        write_cell(path, cell)
    assert path.read_bytes() == before
    assert sorted(path.parent.iterdir()) == files


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_named(path, share):
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CellError, match=r"x0_y0\.h5: (holds no checksum|damaged or edited).*snakemake -R"):
        read_cell(path)


def test_what_is_missing_is_named_unless_a_mirrored_cell_needs_it_not(tmp_path, path):
    # A missing file or dataset is named
    with pytest.raises(CellError, match=r"gone\.h5: no such file; simulate it again"):
        read_cell(tmp_path / "gone.h5")

    # A missing dataset is named
    with pytest.raises(CellError, match=r"x0_y0\.h5: datasets \['gel_hex'\] are missing"):
        read_cell(path, ["depth_mm", "gel_hex"])

    # A mirrored cell needs no section of its own
    cell = invented_cell()
    arrays = {name: array for name, array in cell.arrays.items() if name not in SECTION}
    write_cell(path, Cell(arrays, cell.attributes | {"source": "x1_y0"}))
    assert set(read_cell(path).arrays) == set(arrays)


@pytest.mark.parametrize("name", sorted(set(DATASETS) - OPTIONAL))
def test_every_mandatory_dataset_is_missed(path, name):
    with edited(path) as file:
        del file[name]
    with pytest.raises(CellError, match=rf"x0_y0\.h5: datasets \['{name}'\] are missing"):
        read_cell(path)


@pytest.mark.parametrize("wrong", ["gelforge-cell-0", None])
def test_another_format_is_refused(path, wrong):
    with edited(path) as file:
        del file.attrs["format"]
        if wrong:
            file.attrs["format"] = wrong
    with pytest.raises(CellError, match=r"x0_y0\.h5: format .* expected 'gelforge-cell-1'"):
        read_cell(path)
