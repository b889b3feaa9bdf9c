"""A plane through a mesh of tetrahedra: the polygons that it cuts, and values there from values at the nodes."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

# A 10-node tetrahedron as eight flat ones: four at its corners, four around the diagonal (4, 9) of the octahedron between.
TET10_PARTS = np.array([
    [0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 9, 8], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5], [4, 9, 5, 6],
])  # fmt: skip
_SIDES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def plane_cut(X: np.ndarray, elements: np.ndarray, y: float) -> tuple[np.ndarray, np.ndarray, sp.csr_matrix]:
    """Return polygons (Q, 4), the element (Q,) of each and the matrix (P, N) of values at their corners from nodal values.

    The plane is y = const [mm] through nodes X (N, 3) of elements (E, 10). A triangle repeats its last corner.
    """
    tetrahedra = elements[:, TET10_PARTS].reshape(-1, 4)
    element = np.repeat(np.arange(len(elements)), len(TET10_PARTS))
    height = X[:, 1] - y
    height = np.where(np.abs(height) < 1e-9, 1e-9, height)  # a node on the plane counts as beyond it
    above = height[tetrahedra] > 0
    cut = above.any(axis=1) & ~above.all(axis=1)
    tetrahedra, element, above = tetrahedra[cut], element[cut], above[cut]
    sides = np.sort(tetrahedra[:, _SIDES], axis=-1)  # (T, 6, 2)
    crossed = above[:, _SIDES[:, 0]] != above[:, _SIDES[:, 1]]
    ends, number = np.unique(sides[crossed], axis=0, return_inverse=True)
    name = np.full(crossed.shape, -1)
    name[crossed] = number.ravel()
    a, b = ends.T
    t = height[a] / (height[a] - height[b])
    P = len(ends)
    values = sp.csr_matrix(
        (np.concatenate([1 - t, t]), (np.tile(np.arange(P), 2), np.concatenate([a, b]))), shape=(P, len(X))
    )
    polygons = np.array([_ring(row) for row in name.tolist()]).reshape(-1, 4)
    return polygons, element, values


def _ring(row: list[int]) -> list[int]:
    """Return the corners on the crossed sides 01, 02, 03, 12, 13, 23 in order around the polygon."""
    edges = [k for k in range(6) if row[k] >= 0]
    if len(edges) == 3:
        return [row[k] for k in edges] + [row[edges[-1]]]
    # Two nodes on each side of the plane: the two sides that are not crossed are opposite ones.
    a, b, c, d = edges
    order = {(1, 2, 3, 4): (1, 2, 4, 3), (0, 2, 3, 5): (0, 2, 5, 3), (0, 1, 4, 5): (0, 1, 5, 4)}[a, b, c, d]
    return [row[k] for k in order]
