"""The tangent with all terms of contact, which is not symmetric, factorised and solved for many right-hand sides at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from gelforge.mechanics.linear.sparse import Pardiso
from gelforge.mechanics.linear.sparsity import Pattern


class PardisoLU(Pardiso):
    """LU of a structurally symmetric matrix in float64 by MKL PARDISO.

    In float32 its displacements would be right to 1e-4; friction's springs make forces of them that are a thousand times
    as large as what the material answers with.
    """

    KIND, PIVOT = 1, 13
    NUMBER = np.float64

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, n) of right-hand sides (P, n)."""
        rhs = np.ascontiguousarray(rhs)
        solution = np.zeros_like(rhs)
        if len(rhs):
            self._call(self.SOLVE, rhs, solution)
        return solution


class SciPyLU:
    """The same by SciPy's SuperLU, for machines without MKL."""

    def __init__(self, pattern: FullPattern):
        self._pattern = pattern

    def factor(self, values: np.ndarray) -> None:
        """Factorise; values (nnz,) in the pattern's order."""
        p = self._pattern
        matrix = sp.csr_matrix((values, p.indices, p.indptr), shape=(p.size, p.size))
        self._lu = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.1)

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, n) of right-hand sides (P, n)."""
        return np.ascontiguousarray(self._lu.solve(np.ascontiguousarray(rhs.T)).T)


@dataclass(frozen=True)
class FullPattern:
    """Both triangles of a pattern."""

    indptr: np.ndarray  # (n + 1,) int32
    indices: np.ndarray  # (nnz,) int32, sorted in every row
    size: int


class UnsymmetricTangent:
    """The tangent of a pattern's free degrees of freedom with unsymmetric blocks at the surface nodes."""

    def __init__(self, pattern: Pattern, nodes: np.ndarray, solver: str):
        """nodes: those of the blocks; solver: "pardiso" or "superlu"."""
        upper = sp.csr_matrix(
            (np.arange(1, len(pattern.indices) + 1), pattern.indices, pattern.indptr),
            shape=(pattern.size, pattern.size),
        )
        full = (upper + sp.triu(upper, 1).T).tocsr()
        full.sort_indices()
        self._from_upper = full.data - 1  # (nnz,) the upper value that every value of both triangles equals
        self.pattern = FullPattern(full.indptr.astype(np.int32), full.indices.astype(np.int32), pattern.size)
        self._slots = _block_slots(self.pattern, pattern.equation[nodes])
        self._solver = PardisoLU(self.pattern) if solver == "pardiso" else SciPyLU(self.pattern)

    def factor(self, upper: np.ndarray, blocks: np.ndarray) -> None:
        """Factorise upper-triangular values of the body and blocks (S, 3, 3) [N/mm] of the surface nodes."""
        values = upper[self._from_upper]
        held = self._slots >= 0
        values[self._slots[held]] += blocks[held]
        self._solver.factor(values)

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, n) of right-hand sides (P, n)."""
        return self._solver.solve(rhs)


def _block_slots(pattern: FullPattern, equation: np.ndarray) -> np.ndarray:
    """Return where the blocks (S, 3, 3) of nodes with equations (S, 3) lie among the values, -1 where one is fixed."""
    row, column = np.broadcast_arrays(equation[:, :, None], equation[:, None, :])
    free = (row >= 0) & (column >= 0)
    n = np.int64(pattern.size)
    place = np.repeat(np.arange(n), np.diff(pattern.indptr)) * n + pattern.indices  # increasing
    slots = np.full(row.shape, -1)
    slots[free] = np.searchsorted(place, row[free] * n + column[free])
    return slots
