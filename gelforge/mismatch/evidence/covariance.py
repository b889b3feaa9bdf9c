"""What the readings may differ by for known reasons: their covariance, exactly whitened without a dense matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from gelforge.mismatch.model.effect import Context
from gelforge.mismatch.readings.observations import Observations


@dataclass(frozen=True, eq=False)
class Draws:
    """Standard normal draws, q for each group of entries: they add directions[rows of the group] @ draw."""

    group: np.ndarray  # (n,) int, entries of one group share their draws
    directions: np.ndarray  # (n, q) one standard deviation each


@dataclass(frozen=True, eq=False)
class Estimated:
    """How the independent variances are known: entries of one group share an estimate."""

    group: np.ndarray  # (n,) int, 0..G-1
    repeats: np.ndarray  # (G,) degrees of freedom of the estimate; inf: known
    tails: np.ndarray  # (G,) variance of a squared draw over that of a normal one, 1 or more


@dataclass(frozen=True, eq=False)
class Covariance:
    """C = diag(variance) + the sum over levels and groups of U U', U a group's directions: block-diagonal plus low rank.

    Groups of a level lie inside groups of the next one (indentations in sites in all), so a level's correction keeps the
    blocks of the levels after it, and whitening takes the levels in turn: with W of the levels before and V = W U, the
    next W is (I + V V')^(-1/2) W (Woodbury, symmetric root), exact whatever the sizes.
    """

    variance: np.ndarray  # (n,) of what is independent from entry to entry
    levels: tuple[Draws, ...] = ()
    estimated: Estimated | None = None  # None: the variance is known
    # Steps of whitening by the first levels, where another covariance has them too; `replace` takes none over.
    taken: tuple[_Step, ...] = field(default=(), init=False)

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
                    " fine to coarse (press, site, all) and give every indentation one site"
                )

    def __len__(self) -> int:
        return len(self.variance)

    def whiten(self, v: np.ndarray) -> np.ndarray:
        """Return W v for v (n,) or (n, k), where W C W' = I."""
        return self._through(v, self._steps)

    @property
    def log_det(self) -> float:
        """Return the logarithm of the determinant."""
        return float(np.log(self.variance).sum() + sum(step.log_det for step in self._steps))

    def log_density(self, r: np.ndarray) -> float:
        """Return the logarithm of the normal density N(r; 0, C) of r (n,)."""
        return self.log_density_of_white(self.whiten(r))

    def log_density_of_white(self, white: np.ndarray) -> float:
        """Return the same of what is whitened already, W r."""
        return float(-0.5 * (np.sum(white**2) + self.log_det + len(self) * np.log(2 * np.pi)))

    @property
    def standard_deviation(self) -> np.ndarray:
        """Return the square root (n,) of the diagonal of C."""
        return np.sqrt(self.variance + sum((level.directions**2).sum(axis=1) for level in self.levels))

    def restricted(self, mask: np.ndarray) -> Covariance:
        """Return the covariance of some entries, by a mask (n,) bool or by numbers."""
        if mask.dtype == bool and mask.all():
            return self
        return Covariance(
            self.variance[mask],
            tuple(
                replace(level, group=level.group[mask], directions=level.directions[mask])
                for level in self.levels
            ),
            self.estimated and replace(self.estimated, group=self.estimated.group[mask]),
        )

    def extended(self, directions: np.ndarray) -> Covariance:
        """Return C + U U' with further directions U (n, q) that all entries share."""
        every = np.zeros(len(self), dtype=int)
        return replace(self, levels=(*self.levels, Draws(every, directions)))

    def erring(self, directions: np.ndarray) -> Covariance:
        """Return C with errors along directions (n, q) of a standard deviation each, as a mesh errs.

        Half of their variance is common to all, half is drawn for each group of the level before the last: readings of one
        solution.
        """
        finer = self.levels[:-2]
        wider = [
            Draws(level.group, np.column_stack([level.directions, more.directions]))
            for level, more in zip(self.levels[-2:], self.erring_draws(directions))
        ]
        wider_covariance = replace(self, levels=(*finer, *wider))
        object.__setattr__(wider_covariance, "taken", tuple(self._finer_steps))
        return wider_covariance

    def erring_draws(self, directions: np.ndarray) -> tuple[Draws, Draws]:
        """Return the draws that `erring` adds, (n, q) each."""
        half = directions / np.sqrt(2)
        solved, common = self.levels[-2:]
        return Draws(solved.group, half), Draws(common.group, half)

    def scattering(self, variance: np.ndarray) -> Covariance:
        """Return C with a further variance (n,) of what errs at each entry on its own."""
        return replace(self, variance=self.variance + variance)

    def errors(self, directions: np.ndarray) -> np.ndarray:
        """Return the columns (n, k) of these errors, one standard normal draw each: `erring` adds their products to C."""
        draws = self.erring_draws(directions)
        return np.column_stack([_spread(one.group, one.directions).toarray() for one in draws])

    @cached_property
    def _sd(self) -> np.ndarray:
        return np.sqrt(self.variance)

    @cached_property
    def _steps(self) -> list[_Step]:
        return self._further(self._finer_steps, self.levels)

    @cached_property
    def _finer_steps(self) -> list[_Step]:
        return self._further(self.taken, self.levels[:-2])

    def _further(self, steps: Sequence[_Step], levels: Sequence[Draws]) -> list[_Step]:
        """Return the steps by these levels, the first of which are known."""
        known = list(steps)
        for level in levels[len(known) :]:
            known.append(_step(level.group, self._through(level.directions, known)))
        return known

    def _through(self, v: np.ndarray, steps: Sequence[_Step]) -> np.ndarray:
        x = v / (self._sd if v.ndim == 1 else self._sd[:, None])
        for step in steps:
            x = step(x)
        return x


@dataclass(frozen=True, eq=False)
class _Step:
    """(I + V V')^(-1/2) = I + V M V' for every group: M = -E diag(1 / (c + c^2)) E', c^2 = 1 + l, V'V = E diag(l) E'."""

    # (n, G q), a group's columns in its own rows; of one group dense, which is much faster
    V: sp.csr_array | np.ndarray
    M: np.ndarray  # (G, q, q)
    log_det: float  # of I + V V'

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if not x.size:  # no columns
            return x
        k = 1 if x.ndim == 1 else x.shape[1]
        inner = self.M @ (self.V.T @ x).reshape(*self.M.shape[:2], k)  # (G, q, k)
        return x + (self.V @ inner.reshape(-1, k)).reshape(x.shape)


def _step(group: np.ndarray, V: np.ndarray) -> _Step:
    spread, q = (V if len(set(group.tolist())) == 1 else _spread(group, V)), V.shape[1]
    l, E = np.linalg.eigh((spread.T @ V).reshape(-1, q, q))
    c = np.sqrt(1 + np.maximum(l, 0))
    M = -np.einsum("gij,gj,gkj->gik", E, 1 / (c + c**2), E)
    return _Step(spread, M, float(2 * np.log(c).sum()))


def _spread(group: np.ndarray, directions: np.ndarray) -> sp.csr_array:
    """Return directions (n, q) as (n, G q): the columns of its own group in every row; groups without any have none."""
    n, q = directions.shape
    drawn = np.isin(group, group[directions.any(axis=1)])
    number = np.unique(group[drawn], return_inverse=True)[1].ravel()
    columns = number[:, None] * q + np.arange(q)
    shape = (n, q * (number.max(initial=-1) + 1))
    return sp.csr_array(
        (directions[drawn].ravel(), columns.ravel(), np.cumsum([0, *(q * drawn)])), shape=shape
    )


def readings_covariance(
    context: Context, law: np.ndarray, floor_N: np.ndarray, solution: np.ndarray | None = None
) -> Covariance:
    """Return the covariance of the n entries that were read, without any effect.

    Independent: noise_N. Per depth of an indentation: its rounding, one draw per axis. Per press: the subtracted zero and
    its drift since, one draw per axis each; the depth, one draw along the slope of the base. Per session: its contact point,
    one draw along that slope; the zero's trend, one draw per axis. Shared by all: the law. Of the discretisation's variance,
    half is common to all and half is drawn for readings of one solution.

    Parameters
    ----------
    context : Context
        Base forces at R readings.
    law : numpy.ndarray
        (R, 3, q) [N], one standard deviation of the base for each uncertain direction of the material fit.
    floor_N : numpy.ndarray
        (R, 3), standard deviation of the base's discretisation.
    solution : numpy.ndarray, optional
        (R,), equal for readings of one solution: of an indentation and its mirror images. By default those of one site.

    Returns
    -------
    Covariance
        (n, n) [N^2], block-diagonal plus low rank.
    """
    observations = context.observations
    labels, flat = observations.labels(), observations.flat
    axis, reading = labels["axis"].to_numpy(), labels["reading"].to_numpy()
    slope = context.slope()
    floor = discretisation(context, floor_N) / np.sqrt(2)
    per_axis = np.eye(3)[axis]
    drift = per_axis * flat(observations.drift_N)[:, None]
    contact = flat(observations.press_depth_mm[:, None] * slope)  # the last column: see flow_covariance
    zero = per_axis * flat(observations.zero_N)[:, None]
    press = np.column_stack([zero, drift[:, drift.any(axis=0)], contact])
    session = np.eye(labels["session"].nunique())[_numbered(labels["session"])]
    shared = flat(observations.session_depth_mm[:, None] * slope)[:, None] * session
    trend = per_axis * flat(observations.trend_N)[:, None]
    of_sessions = np.column_stack([shared, *(trend[:, [k]] * session for k in range(3))])
    common = np.column_stack([flat(law), floor, of_sessions[:, of_sessions.any(axis=0)]])
    solved = labels["site"] if solution is None else np.asarray(solution)[reading]
    levels = [
        Draws(_numbered(labels["press"]), press),
        Draws(_numbered(solved), floor),
        Draws(np.zeros(len(labels), dtype=int), common),
    ]
    rounding = flat(observations.rounding_N)
    if rounding.any():
        depth = labels.groupby(["press", "phase", "depth_mm"]).ngroup().to_numpy()
        levels.insert(0, Draws(depth, per_axis * rounding[:, None]))
    return Covariance(flat(observations.noise_N) ** 2, tuple(levels), estimated_noise(observations))


def estimated_noise(observations: Observations) -> Estimated:
    """Return how the noise of the n entries is known: each session's axes have an estimate of their own."""
    labels = observations.labels()
    names = [name for name in ("channel", "session", "axis") if name in labels]
    group = labels.groupby(names).ngroup().to_numpy()
    reading = labels["reading"].to_numpy()[np.unique(group, return_index=True)[1]]
    return Estimated(group, observations.repeats[reading], observations.tails[reading])


def discretisation(context: Context, floor_N: np.ndarray) -> np.ndarray:
    """Return the directions (n, 4) [N] in which the base's discretisation errs, floor_N (R, 3) one standard deviation.

    Pressing and sideways forces err on their own, each as a share of the force that changes slowly with depth.
    """
    size = np.hypot(context.force, floor_N)
    # +-1, fading where the force is as small as its error
    steady = context.force / np.maximum(size, np.finfo(float).tiny)
    directions = [
        np.where(np.isin(range(3), axes), floor_N * steady, 0.0) * share[:, None]
        for axes in ([2], [0, 1])
        for share in slowly(context.observations.table["depth_mm"].to_numpy())
    ]
    return context.observations.flat(np.stack(directions, axis=-1))


def slowly(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two shares (n,), of squares that add up to 1, by which an error changes slowly with depth (n,)."""
    turn = np.pi / 2 * depth / max(depth.max(initial=0.0), np.finfo(float).tiny)
    return np.cos(turn), np.sin(turn)


def _numbered(values: Sequence | np.ndarray) -> np.ndarray:
    return np.unique(np.asarray(values), return_inverse=True)[1].ravel()
