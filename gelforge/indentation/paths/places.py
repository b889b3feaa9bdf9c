"""When two positions, or two depths, count as the same: one rule for plans, recordings, splits and verdicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

# The least tolerance of a position, that of a stage that repeats to 0.002 mm (planning/tolerance.py); PlannedCell.within_mm
# is that of a site.
POSITION_MATCH_MM = 0.01
# Recorded depths join a planned one within this: by Hertz's law a force at 1.5 mm is then off by 3/2 x 0.01 / 1.5 = 1 %.
DEPTH_MATCH_MM = 0.01
# Decimals of positions and depths [mm] in files: a nanometre, far below the 0.002 mm to which a stage repeats
# (planning/tolerance.py).
DIGITS = 6
ROUNDING_MM = 10.0**-DIGITS  # a gap of exactly the tolerance is within it


def within(gap_mm, tolerance_mm=POSITION_MATCH_MM):
    """Return whether gaps are no larger than a tolerance, which itself is still within.

    Parameters
    ----------
    gap_mm : float or array
        Distances [mm].
    tolerance_mm : float or array
        Largest distance that counts as the same place [mm].

    Examples
    --------
    >>> within(0.01), within(0.0102)
    (True, False)
    """
    return gap_mm <= tolerance_mm + ROUNDING_MM


def gaps_to(places: ArrayLike, place: ArrayLike) -> np.ndarray:
    """Return the distances of positions from one position.

    Parameters
    ----------
    places : array_like
        (n, 2) [mm].
    place : array_like
        (2,) [mm].

    Returns
    -------
    numpy.ndarray
        (n,) [mm].
    """
    return np.hypot(*(np.reshape(places, (-1, 2)) - np.asarray(place, float)).T)


def pairs_within(places: np.ndarray, tolerance_mm: float) -> np.ndarray:
    """Return the pairs (p, 2) of positions (n, 2) that lie within a tolerance of each other, smaller number first."""
    tree = cKDTree(np.reshape(places, (-1, 2)))
    return tree.query_pairs(tolerance_mm + ROUNDING_MM, output_type="ndarray")


def chained(places: np.ndarray, tolerance_mm: float) -> np.ndarray:
    """Return for each position the number of the first one of its group: single linkage.

    Two positions within the tolerance of each other are of one group, and so are those that a chain of such pairs joins.

    Parameters
    ----------
    places : numpy.ndarray
        (n, 2) [mm].
    tolerance_mm : float
        Largest distance of a pair.

    Returns
    -------
    numpy.ndarray
        (n,) int.
    """
    count = len(places)
    if not count:
        return np.zeros(0, int)
    i, j = pairs_within(places, tolerance_mm).T
    _, group = connected_components(coo_array((np.ones(len(i)), (i, j)), (count, count)), directed=False)
    _, first = np.unique(group, return_index=True)
    return first[group]


def visited(places: np.ndarray, tolerance_mm: float, names: list[str] | None = None) -> np.ndarray:
    """Return for each position the number of the one whose site it is: the site's first position.

    A position belongs to the nearest earlier site within the tolerance, or begins a site of its own. No member lies
    farther than the tolerance from its site, and no two sites lie within it.

    Parameters
    ----------
    places : array_like
        (n, 2) [mm] in the order visited.
    tolerance_mm : float
        Largest distance of a member from its site.
    names : list of str, optional
        Positions with different names, both not empty, are never of one site.

    Returns
    -------
    numpy.ndarray
        (n,) int.
    """
    places = np.reshape(places, (-1, 2))
    if not len(places):
        return np.zeros(0, int)
    site = np.arange(len(places))
    named = list(names) if names else [""] * len(places)  # a site takes the first name that a member has
    near = cKDTree(places).query_ball_point(places, tolerance_mm + ROUNDING_MM)
    for number, around in enumerate(near):
        first = [k for k in around if k < number and site[k] == k]
        if known := [k for k in first if not (named[k] and named[number]) or named[k] == named[number]]:
            nearest = min(known, key=lambda k: (float(gaps_to(places[k], places[number])[0]), k))
            site[number], named[nearest] = nearest, named[nearest] or named[number]
    return site
