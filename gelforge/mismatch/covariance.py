"""What the readings may differ by for known reasons: their covariance, exactly whitened without a dense matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from gelforge.mismatch.context import Context


@dataclass(frozen=True, eq=False)
class Draws:
    """Standard normal draws, q for each group of entries: they add directions[rows of the group] @ draw."""

    group: np.ndarray  # (n,) int, entries of one group share their draws
    directions: np.ndarray  # (n, q) one standard deviation each


@dataclass(frozen=True, eq=False)
class Covariance:
    """C = diag(variance) + the sum over levels and groups of U U', U a group's directions: block-diagonal plus low rank.

    Groups of a level lie inside groups of the next one (presses in sites in all), so a level's correction keeps the
    blocks of the levels after it, and whitening takes the levels in turn: with W of the levels before and V = W U, the
    next W is (I + V V')^(-1/2) W (Woodbury, symmetric root), exact whatever the sizes.
    """

    variance: np.ndarray  # (n,) of what is independent from entry to entry
    levels: tuple[Draws, ...] = ()

    def __post_init__(self):
        bad = ~(np.isfinite(self.variance) & (self.variance > 0))
        if bad.any():
            raise ValueError(
                f"entry {np.argmax(bad)}: variance {self.variance[np.argmax(bad)]:g}; every reading needs noise above 0,"
                " give the force sensor's resolution"
            )
        for fine, coarse in zip(self.levels, self.levels[1:]):
            _, first, number = np.unique(fine.group, return_index=True, return_inverse=True)
            if np.any(coarse.group != coarse.group[first][number.ravel()]):
                raise ValueError(
                    "a group of draws is spread over two groups of the next level; order the levels from"
                    " fine to coarse (press, site, all) and give every press one site"
                )

    def __len__(self) -> int:
        return len(self.variance)

    def whiten(self, v: np.ndarray) -> np.ndarray:
        """Return W v for v (n,) or (n, k), where W C W' = I."""
        x = v / (self._sd if v.ndim == 1 else self._sd[:, None])
        for step in self._steps:
            x = step(x)
        return x

    @property
    def log_det(self) -> float:
        """Return the logarithm of the determinant."""
        return float(np.log(self.variance).sum() + sum(step.log_det for step in self._steps))

    def log_density(self, r: np.ndarray) -> float:
        """Return the logarithm of the normal density N(r; 0, C) of r (n,)."""
        return float(-0.5 * (np.sum(self.whiten(r) ** 2) + self.log_det + len(self) * np.log(2 * np.pi)))

    @property
    def standard_deviation(self) -> np.ndarray:
        """Return the square root (n,) of the diagonal of C."""
        return np.sqrt(self.variance + sum((level.directions**2).sum(axis=1) for level in self.levels))

    @property
    def instrument(self) -> Covariance:
        """Return the independent part alone."""
        return Covariance(self.variance)

    def restricted(self, mask: np.ndarray) -> Covariance:
        """Return the covariance of some entries, by a mask (n,) bool or by numbers."""
        return Covariance(
            self.variance[mask],
            tuple(Draws(level.group[mask], level.directions[mask]) for level in self.levels),
        )

    def extended(self, directions: np.ndarray) -> Covariance:
        """Return C + U U' with further directions U (n, q) that all entries share."""
        every = np.zeros(len(self), dtype=int)
        return Covariance(self.variance, (*self.levels, Draws(every, directions)))

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return draws (n, count) of N(0, C)."""
        found = self._sd[:, None] * rng.standard_normal((len(self), count))
        for level in self.levels:
            U = _spread(level.group, level.directions)
            found += U @ rng.standard_normal((U.shape[1], count))
        return found

    @cached_property
    def _sd(self) -> np.ndarray:
        return np.sqrt(self.variance)

    @cached_property
    def _steps(self) -> list[_Step]:
        steps = []
        for level in self.levels:
            V = level.directions / self._sd[:, None]
            for step in steps:
                V = step(V)
            steps.append(_step(level.group, V))
        return steps


@dataclass(frozen=True, eq=False)
class _Step:
    """(I + V V')^(-1/2) = I + V M V' for every group: M = -E diag(1 / (c + c^2)) E', c^2 = 1 + l, V'V = E diag(l) E'."""

    V: sp.csr_array  # (n, G q), a group's columns in its own rows
    M: np.ndarray  # (G, q, q)
    log_det: float  # of I + V V'

    def __call__(self, x: np.ndarray) -> np.ndarray:
        k = 1 if x.ndim == 1 else x.shape[1]
        inner = self.M @ (self.V.T @ x).reshape(*self.M.shape[:2], k)  # (G, q, k)
        return x + (self.V @ inner.reshape(-1, k)).reshape(x.shape)


def _step(group: np.ndarray, V: np.ndarray) -> _Step:
    spread, q = _spread(group, V), V.shape[1]
    l, E = np.linalg.eigh((spread.T @ V).reshape(-1, q, q))
    c = np.sqrt(1 + np.maximum(l, 0))
    M = -np.einsum("gij,gj,gkj->gik", E, 1 / (c + c**2), E)
    return _Step(spread, M, float(2 * np.log(c).sum()))


def _spread(group: np.ndarray, directions: np.ndarray) -> sp.csr_array:
    """Return directions (n, q) as (n, G q): the columns of its own group in every row."""
    n, q = directions.shape
    number = np.unique(group, return_inverse=True)[1].ravel()
    columns = number[:, None] * q + np.arange(q)
    shape = (n, q * (number.max(initial=-1) + 1))
    return sp.csr_array((directions.ravel(), columns.ravel(), np.arange(0, n * q + 1, q)), shape=shape)


def readings_covariance(context: Context, law: np.ndarray, floor_N: np.ndarray) -> Covariance:
    """Return the covariance of the n entries that were read, without any effect.

    Independent: noise_N. Per press: the subtracted zero, one draw per axis; the depth's zero, one draw along the slope of
    the base (where zero_by says so, one per session in place of one per press). Shared by all: law (R, 3, q) [N], one
    standard deviation of the base for each uncertain direction of the material fit. The discretisation of the base has
    the pattern and sign of floor_N (R, 3): half its variance is a draw per site, half is common to all.
    """
    observations = context.observations
    labels, flat = observations.labels(), observations.flat
    axis, reading = labels["axis"].to_numpy(), labels["reading"].to_numpy()
    touchdown = flat(observations.touchdown_mm[:, None] * context.slope())
    by_session = np.asarray(observations.zero_by)[reading] == "session"
    floor = flat(floor_N)[:, None] / np.sqrt(2)
    press = np.column_stack(
        [np.eye(3)[axis] * flat(observations.zero_N)[:, None], np.where(by_session, 0, touchdown)]
    )
    session = np.where(by_session[:, None], touchdown[:, None] * _indicators(labels["session"]), 0.0)
    session = session[:, session.any(axis=0)]
    common = np.column_stack([flat(law), floor, session])
    return Covariance(
        flat(observations.noise_N) ** 2,
        (
            Draws(_numbered(labels["press"]), press),
            Draws(_numbered(labels["site"]), floor),
            Draws(np.zeros(len(labels), dtype=int), common),
        ),
    )


def _numbered(values: Sequence) -> np.ndarray:
    return np.unique(np.asarray(values), return_inverse=True)[1].ravel()


def _indicators(values: Sequence) -> np.ndarray:
    """Return (n, k), 1 in the column of each distinct value."""
    number = _numbered(values)
    return np.eye(number.max(initial=-1) + 1)[number]
