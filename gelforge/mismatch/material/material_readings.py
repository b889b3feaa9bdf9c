"""Rows of material tests beside a nominal model, reduced, with every error that is no missing physics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.linalg import solve_triangular

from gelforge.mismatch.evidence.covariance import Covariance

FORCE_CLASS = (
    5e-3  # of a test's largest stress: an ordinary load cell's class, and what a digitised point is off by
)
FORM_ERROR = 0.05  # of the mismatch: what a formula with few values misses of what it stands for
FORM_LENGTH = 0.3  # of a branch, over which that error keeps its sign
LAW_LENGTH = 0.15  # of the range of strain, over which a law's misfit keeps its sign


class Dense(Covariance):
    """A covariance (n, n) of some hundred entries as it is, whitened by its Cholesky factor."""

    matrix: np.ndarray

    def __init__(self, matrix: np.ndarray):
        super().__init__(np.diag(matrix))
        object.__setattr__(self, "matrix", matrix)

    def whiten(self, v: np.ndarray) -> np.ndarray:
        """Return W v for v (n,) or (n, k), where W C W' = I."""
        return solve_triangular(self._root, v, lower=True, check_finite=False)

    @property
    def log_det(self) -> float:
        """Return the logarithm of the determinant."""
        return 2 * float(np.log(np.diag(self._root)).sum())

    def restricted(self, mask: np.ndarray) -> Dense:
        """Return the covariance of some entries, by a mask (n,) bool or by numbers."""
        return Dense(self.matrix[mask][:, mask])

    @cached_property
    def _root(self) -> np.ndarray:
        return np.linalg.cholesky(self.matrix)


@dataclass(frozen=True)
class Readings:
    """n reduced rows of material tests beside the nominal model.

    fixed and shared: the covariance of measured minus a prediction f that lacks nothing is fixed + S * outer(t, t), S the
    shared errors (of sample, law, strain: shares of the stress that is there) and t = |f / base|, 1 at most. Taken of the
    measured stress instead, they would pull every fit below the readings (Peelle's puzzle; D'Agostini 1994,
    doi:10.1016/0168-9002(94)90719-6): a smaller prediction has a smaller misfit of shape, and the size is a shared error.

    table: sample, branch (load, unload, hold), segment (number, unique), progress (0..1 along it), at (stretch, shear, or
    position in mm), share (of the base's range), time_s, is_base (fitted by the nominal model), words of each.
    """

    table: pd.DataFrame
    measured: np.ndarray  # (n,) nominal stress [MPa], or force [N]
    base: np.ndarray  # (n,)
    fixed: np.ndarray  # (n, n)
    noise: np.ndarray  # (n,) standard deviation of a row by the instrument alone
    law: np.ndarray  # (n,) standard deviation that the nominal model's parameters and misfit bring
    zero: float  # standard deviation of the zero of stress or force
    cannot_know: tuple[str, ...] = ()
    # (n,) bool: between plates, which cannot pull whatever the material does
    pushed: np.ndarray | None = None
    shared: np.ndarray | None = None  # (n, n); None: all errors are fixed

    def covariance_of(self, prediction: np.ndarray) -> Dense:
        """Return the covariance of measured minus a prediction (n,)."""
        if self.shared is None:
            return Dense(self.fixed)
        there = np.clip(np.abs(prediction) / np.maximum(np.abs(self.base), 1e-12), 0.0, 1.0)
        return Dense(self.fixed + self.shared * np.outer(there, there))

    @cached_property
    def covariance(self) -> Dense:
        """Return the covariance of measured minus base if nothing is missing."""
        return self.covariance_of(self.base)

    def saying(self, *more: str) -> Readings:
        """Return the readings with more sentences on what they cannot show."""
        return replace(self, cannot_know=(*self.cannot_know, *more))

    def with_form_error(self) -> Readings:
        """Return the readings with the error allowed for every formula: along one branch, over FORM_LENGTH of it.

        It is the same for all sets of effects: an error in proportion to the change would favour what misses most.
        """
        segment, x = self.table["segment"].to_numpy(), self.table["progress"].to_numpy()
        near = np.exp(-np.abs(x[:, None] - x) / FORM_LENGTH)  # of all scales: a formula also misses a corner
        off, sample = self.measured - self.base, self.table["sample"].to_numpy()
        # of each test's stress: where effects cancel, their formulas' errors do not
        share = np.zeros(len(off))
        for name in np.unique(sample):
            own = sample == name
            share[own] = min(float(np.linalg.norm(off[own]) / np.linalg.norm(self.measured[own])), 1.0)
        d = FORM_ERROR * np.hypot(off, share * self.measured)
        return replace(self, fixed=self.fixed + np.outer(d, d) * near * (segment[:, None] == segment))


def binned(x: np.ndarray, rows: np.ndarray, count: int, low: float | None = None) -> list[np.ndarray]:
    """Return row numbers (k,) in at most so many groups, in the order of time: equal bins of their values x (k,).

    low: where the first bin begins; at the least value where none is given.
    """
    if len(rows) <= count:
        return list(rows[:, None])
    x = x - (x.min() if low is None else low)
    number = np.minimum((count * x / max(x.max(), 1e-300)).astype(int), count - 1)
    return sorted((rows[number == k] for k in np.unique(number)), key=lambda group: group[0])


def means(groups: list[np.ndarray], values: np.ndarray) -> np.ndarray:
    """Return values (m, ...) averaged over groups of their rows (k, ...)."""
    return np.array([values[group].mean(axis=0) for group in groups])


def row_noise(values: np.ndarray) -> float:
    """Return the standard deviation of one row about the line through its neighbours (robust), 0 for few rows."""
    if len(values) < 5:
        return 0.0
    return float(1.4826 * np.median(np.abs(values[1:-1] - (values[:-2] + values[2:]) / 2)) / np.sqrt(1.5))


def misfit_covariance(share: np.ndarray, misfit: float) -> np.ndarray:
    """Return the covariance (n, n) of a law's misfit at shares (n,) of its range, which keeps its sign over LAW_LENGTH."""
    return misfit**2 * np.exp(-np.abs(share[:, None] - share) / LAW_LENGTH)
