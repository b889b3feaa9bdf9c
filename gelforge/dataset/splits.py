"""Which cells train and which test: by cell, so that no image of a press is on both sides."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def split_cells(cells: Iterable[str], test_fraction: float, seed: int) -> dict[str, str]:
    """Return "train" or "test" for each cell: a seeded draw of test_fraction of them, at least one of two or more.

    The draw depends on the set of names and the seed only, not on their order. Mirrored cells are different cells:
    their positions and images differ, but the label of one may be the mirror image of a label on the other side.
    """
    names = sorted(set(cells))
    count = min(max(round(test_fraction * len(names)), 1), len(names) - 1)
    drawn = np.random.default_rng(seed).permutation(len(names))[: max(count, 0)]
    test = {names[i] for i in drawn}
    return {name: "test" if name in test else "train" for name in names}
