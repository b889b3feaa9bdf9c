"""Cells of a box grid halved where a smaller size is wanted; neighbours differ by one halving, hanging nodes are tied.

Only the structure is made here: which cells, which corners, which corner hangs between which others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import maximum_filter

# of meshio's hexahedron
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
# Corners between which a node of a halved neighbour may hang (tests/mechanics/test_meshes.py).
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
# The same in the middle of a face (tests/mechanics/test_meshes.py).
FACES = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


@dataclass(frozen=True)
class Octree:
    """Hexahedra of a grid whose cells were halved."""

    X: np.ndarray  # (N, 3) nodes
    hexahedra: np.ndarray  # (E, 8) int32
    base_cell: np.ndarray  # (E, 3) the cell of the base grid in which each lies
    ties: sp.csr_matrix  # (N, N): values at all nodes from those at the nodes that do not hang


def halved_lines(lines: np.ndarray, times: int) -> np.ndarray:
    """Return the lines with every interval halved a number of times."""
    n = len(lines) - 1
    return np.interp(np.arange(n * 2**times + 1) / 2**times, np.arange(n + 1), lines)


def octree(
    lines: tuple[np.ndarray, np.ndarray, np.ndarray],
    present: np.ndarray,
    wanted: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    halvings: int,
) -> Octree:
    """Return the cells of the grid with these lines (x, y, z), halved up to `halvings` times where wanted.

    present (nx, ny, nz) bool are the base cells that exist. wanted(x, y, z) is given the lines of a level and returns which
    of its cells (nx, ny, nz) are too large; a cell is halved too where a neighbour (across a face, an edge or a corner)
    would otherwise be two halvings smaller.
    """
    leaves, origins = [], []
    for level, cells in enumerate(_leaves(lines, present, wanted, halvings)):
        origin = np.argwhere(cells)
        step = 2 ** (halvings - level)
        leaves.append((origin[:, None] + CORNERS) * step)  # (e, 8, 3) in units of the smallest cell
        origins.append(origin >> level)
    corner = np.concatenate(leaves)
    fine = [halved_lines(line, halvings) for line in lines]
    shape = tuple(len(line) for line in fine)
    key = np.ravel_multi_index(np.moveaxis(corner, -1, 0), shape)
    used, hexahedra = np.unique(key, return_inverse=True)
    hexahedra = hexahedra.reshape(key.shape)
    X = np.stack([line[i] for line, i in zip(fine, np.unravel_index(used, shape))], axis=-1)
    return Octree(
        X, hexahedra.astype(np.int32), np.concatenate(origins), _ties(corner, hexahedra, used, shape)
    )


def _leaves(lines, present, wanted, halvings) -> list[np.ndarray]:
    """Return per level the cells (nx, ny, nz) bool that exist and are not halved."""
    too_large = [
        wanted(*(halved_lines(line, level) for line in lines)) & _upsampled(present, level)
        for level in range(halvings)
    ]
    split = too_large
    for level in range(halvings - 2, -1, -1):
        around = maximum_filter(split[level + 1], size=3, mode="constant")
        split[level] = (split[level] | _coarsened(around)) & _upsampled(present, level)
    exists, leaves = present, []
    for level in range(halvings + 1):
        halved = split[level] & exists if level < halvings else np.zeros_like(exists)
        leaves.append(exists & ~halved)
        exists = _upsampled(halved, 1)
    return leaves


def _upsampled(cells: np.ndarray, times: int) -> np.ndarray:
    for axis in range(3):
        cells = np.repeat(cells, 2**times, axis=axis)
    return cells


def _coarsened(cells: np.ndarray) -> np.ndarray:
    """Return which cells of the coarser level hold any of the finer cells."""
    nx, ny, nz = (n // 2 for n in cells.shape)
    return np.any(cells.reshape(nx, 2, ny, 2, nz, 2), axis=(1, 3, 5))


def _ties(corner, hexahedra, used, shape) -> sp.csr_matrix:
    """Return the ties of all nodes: 1 at nodes of their own, 1/2 and 1/4 at the ends of the edge or face they hang on."""
    rows, columns, weights = [], [], []
    hangs = np.zeros(len(used), bool)
    for groups in (EDGES, FACES):  # an edge's middle belongs to the edge, not to a face beyond it
        for group in groups:
            middle = corner[:, group].sum(axis=1)
            divisible = (middle % len(group) == 0).all(axis=1)  # the smallest cells have no node at a middle
            middle = np.ravel_multi_index(np.moveaxis(middle[divisible] // len(group), -1, 0), shape)
            place = np.clip(np.searchsorted(used, middle), 0, len(used) - 1)
            midpoint = (used[place] == middle) & ~hangs[place]
            place, first = np.unique(place[midpoint], return_index=True)
            masters = hexahedra[divisible][midpoint][first][:, group]
            hangs[place] = True
            rows.append(np.repeat(place, len(group)))
            columns.append(masters.ravel())
            weights.append(np.full(masters.size, 1 / len(group)))
    free = np.flatnonzero(~hangs)
    row, column, weight = (
        np.concatenate([*parts, more])
        for parts, more in ((rows, free), (columns, free), (weights, np.ones(len(free))))
    )
    ties = sp.csr_matrix((weight, (row, column)), shape=(len(used), len(used)))
    while hangs[ties.indices].any():  # a master that hangs itself hands its value on
        ties = (ties @ ties).tocsr()
    ties.sort_indices()
    return ties
