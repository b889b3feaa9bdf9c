"""Sparse direct solvers of the symmetric tangent, chosen in one place.

PARDISO (Intel MKL, x86-64 only) factorises in single precision, which halves its time and memory. The caller restores double
precision by flexible GMRES (solving/corrections.py; `refined_solve` for one tangent alone).
SuperLU (SciPy) works on every machine and is slower.
"""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import splu

from gelforge.mechanics.linear.krylov import flexible_gmres
from gelforge.mechanics.linear.sparsity import Pattern, symmetric_product


class NotPositiveDefinite(ArithmeticError):
    """The tangent could not be factorised as a positive definite matrix."""


@cache
def _math_kernel_library() -> ctypes.CDLL:
    """Return MKL, which pypardiso only finds and opens: its own interface is float64 and one-shot.

    Left to itself it searches every folder of the environment at its import and for every solver, a second each time.
    """
    libraries = sorted(Path(sys.prefix, "lib").glob("libmkl_rt.so*"))
    if libraries:
        os.environ.setdefault("PYPARDISO_MKL_RT", str(libraries[0]))
    from pypardiso import PyPardisoSolver

    return PyPardisoSolver().libmkl


class Pardiso:
    """Cholesky in float32 by MKL PARDISO; the symbolic analysis is done once per pattern."""

    name = "pardiso"
    ANALYSE, FACTOR, SOLVE, RELEASE = 11, 22, 33, -1
    KIND, PIVOT = 2, 8  # positive definite; perturbed pivots are 10^-PIVOT
    NUMBER: type[np.floating] = np.float32

    def __init__(self, pattern: Pattern, threads: int = 1, condensed: np.ndarray | None = None):
        """condensed: equations that are kept, all others being eliminated in a Schur complement."""
        mkl = _math_kernel_library()
        mkl.MKL_Set_Num_Threads(threads)
        self._pardiso = mkl["pardiso"]  # by index: a fresh handle without pypardiso's argument types
        self._indptr, self._indices, self._n = pattern.indptr, pattern.indices, pattern.size
        self._handle = np.zeros(64, dtype=np.int64)
        self._permutation = np.zeros(self._n, dtype=np.int32)
        iparm = np.zeros(64, dtype=np.int32)
        iparm[0] = 1  # no defaults
        iparm[1] = 2  # METIS nested dissection
        iparm[9] = self.PIVOT
        iparm[27] = self.NUMBER == np.float32
        iparm[34] = 1  # zero-based
        if condensed is not None:
            self._permutation[condensed] = 1
            iparm[35] = 2  # the Schur complement, and the factors to solve with
        self._iparm = iparm
        self._values = np.zeros(len(self._indices), dtype=self.NUMBER)
        self._call(self.ANALYSE, self._zeros(), self._zeros())

    def _zeros(self) -> np.ndarray:
        return np.zeros(self._n, dtype=self.NUMBER)

    def _call(self, phase: int, rhs: np.ndarray, solution: np.ndarray) -> None:
        def integer(value):
            return ctypes.byref(ctypes.c_int32(value))

        def pointer(array):
            return array.ctypes.data_as(ctypes.c_void_p)

        error = ctypes.c_int32(0)
        self._pardiso(
            pointer(self._handle), integer(1), integer(1), integer(self.KIND), integer(phase), integer(self._n),
            pointer(self._values), pointer(self._indptr), pointer(self._indices), pointer(self._permutation),
            integer(rhs.size // self._n), pointer(self._iparm), integer(0), pointer(rhs), pointer(solution),
            ctypes.byref(error),
        )  # fmt: skip
        if error.value == -4:
            raise NotPositiveDefinite("zero or negative pivot in PARDISO's factorisation")
        if error.value:
            raise RuntimeError(f"PARDISO phase {phase} returned error {error.value}")

    def factor(self, values: np.ndarray) -> None:
        """Factorise; values (nnz,) float64 in the pattern's order. Raises NotPositiveDefinite."""
        self._values[:] = values
        self._call(self.FACTOR, self._zeros(), self._zeros())

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solution (n,) to single precision."""
        # Scaled to unit size: forces of 1e-12 N and squares of them would leave the range of float32.
        size = np.abs(rhs).max()
        if size == 0:
            return np.zeros(self._n)
        b, x = (rhs / size).astype(np.float32), self._zeros()
        self._call(self.SOLVE, b, x)
        return x.astype(np.float64) * size

    def solve_many(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (m, n) of right-hand sides (m, n) of about unit size, in the precision of the factors."""
        b = np.ascontiguousarray(rhs, dtype=self.NUMBER)
        x = np.zeros_like(b)
        if len(b):
            self._call(self.SOLVE, b, x)
        return x

    def __del__(self):
        if hasattr(self, "_values") and not sys.is_finalizing():
            self._call(self.RELEASE, self._zeros(), self._zeros())


class SuperLU:
    """LU in float64 by SciPy's SuperLU, for machines without MKL: slower than PARDISO."""

    name = "superlu"

    def __init__(self, pattern: Pattern):
        self._pattern = pattern

    def factor(self, values: np.ndarray) -> None:
        """Factorise; values (nnz,) in the pattern's order. Raises NotPositiveDefinite for a singular matrix."""
        full, options = self._pattern.symmetric(values).tocsc(), {"SymmetricMode": True}
        try:
            self._lu = splu(full, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        except RuntimeError as error:
            raise NotPositiveDefinite(str(error)) from None

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solution (n,)."""
        return self._lu.solve(rhs)

    def solve_many(self, rhs: np.ndarray) -> np.ndarray:
        """Return the solutions (m, n) of right-hand sides (m, n)."""
        return np.ascontiguousarray(self._lu.solve(np.ascontiguousarray(rhs.T)).T)


DirectSolver = Pardiso | SuperLU


def direct_solver(pattern: Pattern, choice: str = "auto") -> DirectSolver:
    """Return a direct solver for symmetric tangents.

    Parameters
    ----------
    pattern : Pattern
        Sparsity of the tangent.
    choice : str
        "pardiso", "superlu", or "auto": PARDISO where MKL can be loaded, SuperLU elsewhere.

    Returns
    -------
    DirectSolver
        It factorises values (nnz,) of the pattern and solves.

    Raises
    ------
    ImportError
        For "pardiso" where MKL cannot be loaded.
    """
    if choice in ("auto", "pardiso"):
        try:
            return Pardiso(pattern)
        except ImportError as error:
            if choice == "pardiso":
                raise ImportError(
                    f"PARDISO cannot be loaded ({error}); set linear_solver: superlu"
                ) from error
    return SuperLU(pattern)


def refined_solve(
    solver: DirectSolver, pattern: Pattern, values: np.ndarray, rhs: np.ndarray, tolerance: float, limit: int
) -> tuple[np.ndarray, int]:
    """Return the solution of A x = rhs and the number of GMRES steps, preconditioned by the factorisation.

    Stops when the residual has fallen by tolerance or after limit steps. With a fresh float32 factor each step wins about
    four digits; with an older factor it takes more.

    Parameters
    ----------
    solver : DirectSolver
        Factorised, for this or an earlier tangent.
    pattern : Pattern
        Of A's upper triangle.
    values : numpy.ndarray
        (nnz,) of A.
    rhs : numpy.ndarray
        (n,).
    tolerance : float
        Residual over that of x = 0 (2-norms).
    limit : int
        Largest number of steps.

    Returns
    -------
    numpy.ndarray
        x (n,).
    int
        Steps.
    """

    def product(x: np.ndarray) -> np.ndarray:
        y = np.empty_like(x)
        symmetric_product(pattern.indptr, pattern.indices, values, x, y)
        return y

    return flexible_gmres(product, solver.solve, rhs, tolerance * float(np.linalg.norm(rhs)), limit)
