"""The split: by cell, seeded, of the size asked for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gelforge.dataset.shard import ShardDataset
from gelforge.dataset.splits import split_cells

NAMES = [f"x{i}_y{j}" for i in range(9) for j in range(9)]


def test_a_fifth_of_the_cells_tests():
    split = split_cells(NAMES, 0.2, 0)
    assert list(split) == sorted(NAMES)
    assert sum(side == "test" for side in split.values()) == round(0.2 * 81)


@given(st.integers(2, 40), st.floats(0.01, 0.99), st.integers(0, 9))
def test_both_sides_have_a_cell(count, fraction, seed):
    sides = list(split_cells([f"c{i}" for i in range(count)], fraction, seed).values())
    assert set(sides) == {"train", "test"}


def test_one_cell_trains():
    assert split_cells(["alone"], 0.2, 0) == {"alone": "train"}


def test_the_draw_depends_on_names_and_seed_only():
    assert split_cells(NAMES, 0.2, 3) == split_cells(NAMES[::-1], 0.2, 3)
    assert split_cells(NAMES, 0.2, 3) != split_cells(NAMES, 0.2, 4)


@pytest.mark.parametrize("part", [slice(0, 4), slice(4, 9)])
def test_every_row_of_a_cell_is_on_one_side_in_every_shard(made, part):
    rows = ShardDataset([made.join(names=made.names[part])])
    read = rows.read(np.arange(len(rows)), ["cell", "split", "press"])
    expected = split_cells(made.names, made.study.dataset.test_fraction, made.study.seed)
    assert [expected[cell] for cell in read["cell"]] == list(read["split"])
    assert len(set(zip(read["cell"], read["split"]))) == len(set(read["cell"]))
