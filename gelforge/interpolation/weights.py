"""Weights of solved sites and depths at a place and depth between them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

# Coverage of the labels: `python benchmarks/interpolation.py`:
NEAREST = 24  # sites that a label is interpolated from: all within some two spacings
DEPTHS = 4  # neighbouring depths: a cubic


def nearest(places: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the nearest places to a position.

    Parameters
    ----------
    places : numpy.ndarray
        (n, 2) [mm].
    position : numpy.ndarray
        (2,) [mm].

    Returns
    -------
    numpy.ndarray
        Numbers of NEAREST places at most, nearest first; of equals the first.
    """
    away = np.round(np.linalg.norm(places - position, axis=1), 6)
    return np.argsort(away, kind="stable")[:NEAREST]


def place_weights(places: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the weights of values at places for a position between them: quintic radial functions and a quadratic.

    They sum to 1 and reproduce what is quadratic in the place; along an axis with two places or one, what is linear or
    even.

    Parameters
    ----------
    places : numpy.ndarray
        (n, 2) [mm].
    position : numpy.ndarray
        (2,) [mm].

    Returns
    -------
    numpy.ndarray
        (n,).
    """
    scale = max(float(np.ptp(places, axis=0).max()), 1e-9)
    x, at = (places - position) / scale, np.zeros((1, 2))
    lines = [len(np.unique(np.round(along, 6))) for along in x.T]
    powers = [(i, j) for i in range(3) for j in range(3 - i) if i < lines[0] and j < lines[1]]

    def polynomial(points: np.ndarray) -> np.ndarray:
        return np.column_stack([points[:, 0] ** i * points[:, 1] ** j for i, j in powers])

    n, m = len(x), len(powers)
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = -(cdist(x, x) ** 5)
    matrix[:n, n:] = polynomial(x)
    matrix[n:, :n] = matrix[:n, n:].T
    right = np.concatenate([-(cdist(at, x)[0] ** 5), polynomial(at)[0]])
    return np.linalg.lstsq(matrix, right, rcond=None)[0][:n]


def depth_weights(depths: np.ndarray, depth: float) -> tuple[list[int], np.ndarray]:
    """Return the weights of depths for a depth between them: Lagrange's cubic.

    Parameters
    ----------
    depths : numpy.ndarray
        (D,) [mm], increasing.
    depth : float
        [mm].

    Returns
    -------
    list of int
        Numbers of the depths; one where the depth is there.
    numpy.ndarray
        Their weights; they sum to 1.

    Raises
    ------
    ValueError
        For a depth beyond those there are.
    """
    same = np.flatnonzero(np.abs(depths - depth) < 1e-9)
    if len(same):
        return [int(same[0])], np.ones(1)
    if not depths[0] < depth < depths[-1]:
        raise ValueError(f"depth {depth:g} mm lies outside the solved {depths[0]:g} to {depths[-1]:g} mm")
    above = int(np.searchsorted(depths, depth))
    first = int(np.clip(above - DEPTHS // 2, 0, max(len(depths) - DEPTHS, 0)))
    chosen = list(range(first, min(first + DEPTHS, len(depths))))
    at = depths[chosen]
    weights = [
        np.prod([(depth - at[m]) / (at[k] - at[m]) for m in range(len(at)) if m != k]) for k in range(len(at))
    ]
    return chosen, np.array(weights)


def positive_weights(places: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return weights (n,) of error bars at places (n, 2) at a position (2,): positive, sum 1, most to the nearest."""
    away = np.linalg.norm(places - position, axis=1)
    typical = np.sort(away)[min(3, len(away) - 1)] / 2
    weights = 1 / (away**2 + max(typical, 1e-9) ** 2) ** 2
    return weights / weights.sum()
