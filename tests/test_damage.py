"""Damage to HDF5 files of `python -m benchmarks.faults products`: datasets in groups are damaged as those outside."""

import h5py
import numpy as np
import pytest

from benchmarks.fault_kinds import damage


@pytest.mark.parametrize("kind", [damage.missing_dataset, damage.reshaped_dataset, damage.other_values])
def test_files_with_groups_are_damaged_too(tmp_path, kind):
    said = set()
    for seed in range(12):
        path = tmp_path / f"{seed}.h5"
        with h5py.File(path, "w") as file:
            file["outside"], file["truth/inside"], file["truth/scalar"] = np.ones((2, 2)), np.ones(4), 1.0
        said.add(kind(path, np.random.default_rng(seed)))
    assert {
        name for name in ("outside", "truth/inside", "truth/scalar") if any(name in one for one in said)
    } == {
        "outside",
        "truth/inside",
        "truth/scalar",
    }


def test_a_file_without_datasets_has_no_such_damage(tmp_path):
    path = tmp_path / "empty.h5"
    with h5py.File(path, "w") as file:
        file.create_group("truth")
    assert damage.missing_dataset(path, np.random.default_rng(0)) == ""
