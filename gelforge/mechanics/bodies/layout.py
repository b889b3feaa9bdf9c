"""Where a block of elements has its quantities while the loops compute them: a room of lanes, record by record.

Every point has a record; what belongs to the elements follows. A record begins with the same places for every element and
ends with the gradients of its nodes.
"""

from __future__ import annotations

from itertools import accumulate

import numba as nb
import numpy as np

from gelforge.mechanics.laws.lanes import LANES, ONCE, PART, PARTS, load, store

# Where the quantities of a point lie among its lanes, by their sizes; those of an element follow those of its points.
(
    RATIO, VOLUME,  # J; w, then w J
    DEFORMATION, SQUARE, DIRECTIONS,  # F (9,); F F^T (6,), then its eigenvalues (3,); eigenvectors (9,)
    STRESS, TOTAL, MODULUS,  # Kirchhoff, without and with the element's pressure, and its spatial modulus, times w
    GRADIENT,  # (A, 3), spatial
) = accumulate((1, 1, 9, 6, 9, 6, 6, 21), initial=0)  # fmt: skip
# Places of a point's modulus times the gradient of a node, before the blocks of the tangent: nine for each of three
# directions, of which three are found in two places (node_sums.py).
SUMS = 24
# What belongs to the elements, after the records of their points: u (A, 3), dv/du (A, 3), forces (A, 3), then these numbers.
# K (theta - 1); energy; det F; extension; (K - kappa) / V
PRESSURE, ENERGY, SMALLEST, LARGEST, STIFF = range(5)


@nb.njit(inline="always")
def moved_at(NODES, POINTS):
    """Return where the displacements (A, 3) of the nodes lie; dv/du, forces and the elements' numbers follow."""
    return POINTS * (GRADIENT + 3 * NODES)


@nb.njit(inline="always")
def load3(room, k):
    return load(room, k), load(room, k + 1), load(room, k + 2)


@nb.njit(inline="always")
def load6(room, k):
    return (*load3(room, k), *load3(room, k + 3))


@nb.njit(inline="always")
def load9(room, k):
    return (*load6(room, k), *load3(room, k + 6))


@nb.njit(inline="always")
def store3(room, k, x):
    store(room, k, x[0])
    store(room, k + 1, x[1])
    store(room, k + 2, x[2])


@nb.njit(inline="always")
def store6(room, k, x):
    store3(room, k, x[:3])
    store3(room, k + 3, x[3:])


@nb.njit(inline="always")
def store9(room, k, x):
    store6(room, k, x[:6])
    store3(room, k + 6, x[6:])


@nb.njit(**ONCE)
def rooms(points, sums):
    """Return room for `points` lanes (PARTS, ...) and for `sums` parts of lanes, where a register's reads begin in line."""
    raw = np.empty(points * LANES + (sums + 1) * PART)
    first = (-raw.ctypes.data % (8 * PART)) // 8
    middle = first + points * LANES
    return raw[first:middle].reshape(PARTS, points * PART), raw[middle : middle + sums * PART]
