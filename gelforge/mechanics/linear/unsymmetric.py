"""The tangent with all terms of contact, which is not symmetric, solved for many right-hand sides at once.

Only the blocks of nodes in contact are not symmetric: the body's part is condensed to these nodes, and what is solved there
is small and dense.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from gelforge.mechanics.linear.sparse import Pardiso
from gelforge.mechanics.linear.sparsity import Pattern


class PardisoSchur(Pardiso):
    """LDL^T in float64 of what is eliminated, by MKL PARDISO, and the dense Schur complement of what is kept.

    In float32 displacements would be right to 4e-4. A refinement costs as much as float64 does more.
    """

    KIND = -2  # symmetric: at a large bulk modulus what is eliminated need not be positive definite
    NUMBER = np.float64
    FORWARD, BACKWARD = 331, 333

    def __init__(self, pattern: Pattern, kept: np.ndarray):
        """kept (k,): sorted numbers of the equations that may get unsymmetric terms."""
        self._kept = kept
        super().__init__(pattern, condensed=kept if len(kept) else None)

    def factor_with(self, values: np.ndarray, block: np.ndarray) -> None:
        """Factorise the upper values (nnz,) plus a block (k, k) of the kept equations.

        Raises NotPositiveDefinite for a zero pivot.
        """
        k = len(self._kept)
        self._values[:] = values
        self._schur = np.zeros((k, k))
        self._call(self.FACTOR, self._zeros(), self._schur if k else self._zeros())
        self._schur += block

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, n) of right-hand sides (P, n)."""
        if not len(self._kept):
            return self._phase(self.SOLVE, rhs)
        partly = self._phase(self.FORWARD, rhs)
        partly[:, self._kept] = self._dense(partly)
        return self._phase(self.BACKWARD, partly)

    def solve_kept(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, k) at the kept equations alone, at half the cost."""
        return self._dense(self._phase(self.FORWARD, rhs)) if len(self._kept) else np.empty((len(rhs), 0))

    def _dense(self, partly: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self._schur, partly[:, self._kept].T).T

    def _phase(self, phase: int, rhs: np.ndarray) -> np.ndarray:
        rhs = np.ascontiguousarray(rhs)
        solution = np.zeros_like(rhs)
        if len(rhs):
            self._call(phase, rhs, solution)
        return solution


class SciPyLU:
    """LU of the whole by SciPy's SuperLU, for machines without MKL."""

    def __init__(self, pattern: Pattern, kept: np.ndarray):
        self._pattern, self._kept = pattern, kept

    def factor_with(self, values: np.ndarray, block: np.ndarray) -> None:
        """Factorise the upper values (nnz,) plus a block (k, k) of the kept equations."""
        body = self._pattern.symmetric(values)
        row, column = np.nonzero(block)
        added = sp.csr_matrix((block[row, column], (self._kept[row], self._kept[column])), shape=body.shape)
        self._lu = splu((body + added).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.1)

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, n) of right-hand sides (P, n)."""
        return np.ascontiguousarray(self._lu.solve(np.ascontiguousarray(rhs.T)).T)

    def solve_kept(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, k) at the kept equations alone."""
        return self.solve(rhs)[:, self._kept]


class UnsymmetricTangent:
    """The tangent of a pattern's free degrees of freedom with unsymmetric blocks at some nodes."""

    def __init__(self, pattern: Pattern, nodes: np.ndarray, solver: str):
        """nodes (k,): sorted, none of which hangs; solver: "pardiso" or "superlu"."""
        self._equation = pattern.equation[nodes]
        self._free = self._equation >= 0  # (k, 3)
        kept = self._equation[self._free]
        kind = PardisoSchur if solver == "pardiso" else SciPyLU
        self._solver: PardisoSchur | SciPyLU = kind(pattern, kept)

    def factor(self, upper: np.ndarray, blocks: np.ndarray) -> None:
        """Factorise upper-triangular values of the body and blocks (k, 3, 3) [N/mm] of the nodes."""
        k = len(blocks)
        spread = np.zeros((k, 3, k, 3))
        spread[np.arange(k), :, np.arange(k)] = blocks
        free = self._free.ravel()
        self._solver.factor_with(upper, spread.reshape(3 * k, 3 * k)[np.ix_(free, free)])

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, n) of right-hand sides (P, n)."""
        return self._solver.solve(rhs)

    def solve_at_nodes(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (P, k, 3) at the nodes alone, zero where they are fixed."""
        solutions = np.zeros((len(rhs), *self._free.shape))
        solutions[:, self._free] = self._solver.solve_kept(rhs)
        return solutions
