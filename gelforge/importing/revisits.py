"""How well a stage comes back to a position, from a log of where it pressed."""

from __future__ import annotations

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

# The scatter of 0.015 mm of a SYNTHETIC robot is found (tests/importing/test_add_session.py):
MOST_POSITIONS = 3000  # compared: every pair is, and some thousand show the scatter as well as all
# Of which a scatter is found at all. Two distances of one kind are needed below a gap to see that it is one
# (tests/importing/test_add_session.py).
LEAST_REVISITS = 3
# Between distances of one commanded position and those of different ones: a scatter of 0.015 mm is found
# (tests/importing/test_add_session.py).
CLEAR_GAP = 10.0


def repeatability_mm(places: np.ndarray) -> float | None:
    """Return the standard deviation along x and y [mm] of the positions (n, 2) [mm] that were meant to be one.

    Positions that single linkage joins well below the other distances were meant to be one. None where nothing is revisited,
    where no gap parts the two kinds of distances, and where revisited positions are equal: such a log holds commanded
    positions, which do not show what the stage did.
    """
    places = np.reshape(places, (-1, 2))[:MOST_POSITIONS]
    if len(places) <= LEAST_REVISITS:
        return None
    tree = linkage(places, "single")
    height = tree[:, 2]  # (n - 1,) increasing
    below = np.arange(LEAST_REVISITS, len(height))  # edges below the gap, one kind each
    below = below[height[below - 1] > 0]
    if not len(below):
        return None
    ratio = height[below] / height[below - 1]
    if ratio.max() < CLEAR_GAP:
        return None
    count = below[ratio.argmax()]
    group = fcluster(tree, np.sqrt(height[count - 1] * height[count]), "distance") - 1
    size = np.bincount(group)
    mean = np.stack([np.bincount(group, axis) / size for axis in places.T], axis=1)
    squares = ((places - mean[group]) ** 2).sum()
    return float(np.sqrt(squares / (2 * (len(places) - len(size)))))
