"""Effects at their own values and places in the real model: bounded least squares, and the evidence there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import evidence
from gelforge.mismatch.evidence.problem import Problem, secant
from gelforge.mismatch.evidence.screen import Candidate, Screened, Term, displaced, terms_of
from gelforge.mismatch.model.effect import ON_BOUND
from gelforge.mismatch.thresholds import OBSERVABLE_SNR

# Of a bound's distance from zero that values keep from it, where it is not physical itself.
INSIDE = ON_BOUND / 2


@dataclass(frozen=True, eq=False)
class Refitted:
    """Effects fitted in the real model."""

    parts: tuple[Candidate, ...]  # what has a place lies where it fits best, between those that were tried
    theta: tuple[np.ndarray, ...]  # per part
    # (m, q) [N per unit, N/mm] of the entries that were fitted: of all values, then of places
    columns: np.ndarray
    spread: np.ndarray  # (q, q) covariance of the same
    prior_sd: np.ndarray  # (q,) of the same
    log_bayes_factor: (
        float  # Laplace, against none, on these entries; hyperparameters and scales are paid for
    )
    converged: bool  # not stopped by the number of its steps

    @property
    def name(self) -> str:
        return " + ".join(part.name for part in self.parts)

    @property
    def terms(self) -> list[Term]:
        """Return each part with its values."""
        return list(zip(self.parts, self.theta))

    @property
    def effects(self) -> frozenset[str]:
        """Return the names of its effects, whatever their order."""
        return frozenset(part.name for part in self.parts)

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (p, p) of all values, whatever the places."""
        p = sum(len(a) for a in self.theta)
        return self.spread[:p, :p]


def refitted(problem: Problem, start: Screened, mask: np.ndarray, placing: bool = False) -> Refitted:
    """Return the effects of a screened answer fitted to some entries.

    A place is fitted too, as far as the next that was tried, and so is a ball's size: along axes along which the readings
    see it. Columns follow the solved change (`secant`); where nothing is solved they are taken anew.

    Parameters
    ----------
    problem : Problem
        n entries.
    start : Screened
        The effects, at the values from which the fit begins.
    mask : numpy.ndarray
        (n,) bool, entries that are fitted.
    placing : bool
        Fit places from where an earlier refit has put them; else these stay.

    Returns
    -------
    Refitted
        Values and places with their covariance, and the log Bayes factor on these entries.

    Raises
    ------
    NotConverged
        At the first solution.
    """
    variables = variables_of(problem, start, mask, placing)
    residual, prior_sd, free = problem.residual[mask], variables.prior_sd, ~variables.binary
    at, bounds = variables.first(), variables.bounds
    low, high = (bound[free] / prior_sd[free] for bound in bounds)

    def with_free(values: np.ndarray) -> np.ndarray:
        """Return the variables (q,) of free ones in units of their priors; what is at a bound is that number."""
        a, inside = at.copy(), values * prior_sd[free]
        a[free] = np.where(values <= low, bounds[0][free], np.where(values >= high, bounds[1][free], inside))
        return a

    first = np.clip(at[free] / prior_sd[free], low, high)
    at = with_free(first)
    covariance, changes = variables.covariance(at), {at.tobytes(): variables.change(at)}
    solved = any(problem.solves(part) for part in start.parts)
    J = variables.columns()
    if solved:
        J = secant(J, changes[at.tobytes()] - J @ at, at, prior_sd) if at.any() else J
        J = _along_ways(J, changes[at.tobytes()], at, variables)

    def misfit(values: np.ndarray) -> np.ndarray:
        a = with_free(values)
        if a.tobytes() not in changes:
            try:
                changes[a.tobytes()] = variables.change(a)
            except NotConverged:  # a shorter step is tried
                return np.full(len(residual) + len(values), np.inf)
        return np.r_[covariance.whiten(residual - changes[a.tobytes()]), values]

    def slope(values: np.ndarray) -> np.ndarray:
        nonlocal J, at
        a = with_free(values)
        change, step = changes[a.tobytes()], a - at
        if not solved:
            J = _columns_at(variables, a, change)
        elif step.any():
            J = secant(J, change - changes[at.tobytes()] - J @ step, step, prior_sd)
        at = a
        return np.vstack([-covariance.whiten(J[:, free]) * prior_sd[free], np.eye(len(values))])

    converged = True
    if free.any():
        # Of a place, whose columns are secants: gains of the cost (some 1,000) below a seventh of a standard deviation, and
        # steps below a hundredth of where it is from the start, are not waited for; each costs a solution.
        limits = {"ftol": 1e-5, "xtol": 1e-2} if variables.moves and solved else {}
        fit = least_squares(misfit, first, slope, (low, high), "dogbox", max_nfev=16, **limits)
        converged, at = fit.status > 0, with_free(fit.x)
    left = residual - changes[at.tobytes()]
    factor, spread = _evidence(left, variables, J, at)
    against = -problem.covariance.restricted(mask).log_density(residual)
    against += start.log_bayes_factor - start.best_log_bayes_factor
    parts, theta = zip(*variables.terms(at))
    return Refitted(parts, theta, J, spread, prior_sd, factor + against, converged)


def _along_ways(J: np.ndarray, change: np.ndarray, a: np.ndarray, variables: Variables) -> np.ndarray:
    """Return columns (m, q) of which those of the ways are solved differences about a (q,), where that converges."""
    J = J.copy()
    for k, move in enumerate(variables.moves, start=variables.n_theta):
        moved_a = a.copy()
        moved_a[k] += 0.25 * (move.half if move.high > 0 else -move.half)
        try:
            J[:, k] = (variables.change(moved_a) - change) / (moved_a[k] - a[k])
        except NotConverged:
            continue
    return J


def _columns_at(variables: Variables, a: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return the columns (m, q) [N per unit] at a (q,), whose change is known, by differences."""
    steps = 1e-3 * np.diag(variables.prior_sd)
    return np.column_stack([(variables.change(a + step) - change) / step.sum() for step in steps])


def _evidence(
    left: np.ndarray, variables: Variables, J: np.ndarray, a: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the log evidence of what is left (m,) by Laplace's approximation, and the covariance (q, q) of what is free."""
    covariance, free = variables.covariance(a), ~variables.binary
    white = covariance.whiten(np.column_stack([left + J[:, free] @ a[free], J[:, free]]))
    factor, prior_sd = covariance.log_density_of_white(white[:, 0]), variables.prior_sd[free]
    spread = np.zeros((len(a), len(a)))
    if free.any():
        factor += evidence(white[:, 0], white[:, 1:], prior_sd, variables.signs[free])[0]
        scaled = white[:, 1:] * prior_sd
        inverse = np.linalg.inv(np.eye(len(prior_sd)) + scaled.T @ scaled)
        spread[np.ix_(free, free)] = prior_sd[:, None] * inverse * prior_sd
    return factor, spread


@dataclass(frozen=True, eq=False)
class Move:
    """A part's way along an axis from the place that was tried."""

    part: int
    axis: str
    slope: np.ndarray  # (n,) [N/mm] of the change by the part
    half: float  # mm, half-way to the next place
    low: float  # mm
    high: float
    at: float = 0.0  # mm, where it starts


@dataclass(frozen=True, eq=False)
class Variables:
    """q numbers: the values of an answer's parts in turn, and then the moves [mm] of those that have a place."""

    problem: Problem
    start: Screened
    moves: tuple[Move, ...]
    mask: np.ndarray  # (n,) bool, the m entries that are fitted

    @property
    def n_theta(self) -> int:
        """Return how many of them are values."""
        return len(self.start.theta)

    @cached_property
    def binary(self) -> np.ndarray:
        """Return (q,) bool: what is on and not fitted."""
        return self._of_all("binary", [False for _ in self.moves]).astype(bool)

    @cached_property
    def prior_sd(self) -> np.ndarray:
        """Return the standard deviations (q,) of the priors; of a place that of an even spread half-way to the next."""
        return self._of_all("prior_sd", [move.half / np.sqrt(3) for move in self.moves])

    @cached_property
    def signs(self) -> np.ndarray:
        """Return (q,) 1 or -1: the only physical sign; 0: both."""
        return self._of_all("signs", [0.0 for _ in self.moves])

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds (q,)."""
        parameters = [p for part in self.start.parts for p in self.problem.effects[part.name].parameters]
        ends = np.array([p.bounds for p in parameters])
        inside = np.array([0.0 if p.closed else INSIDE for p in parameters])[:, None]
        ends = np.where(np.isfinite(ends), ends * (1 - inside), ends)
        moves = np.array([(move.low, move.high) for move in self.moves]).reshape(-1, 2)
        low, high = np.concatenate([ends, moves]).T
        return low, high

    def first(self) -> np.ndarray:
        """Return (q,) the numbers of the screened answer, within their bounds."""
        a = np.concatenate([self.start.theta, [move.at for move in self.moves]])
        return np.where(self.binary, 1.0, np.clip(a, *self.bounds))

    def columns(self) -> np.ndarray:
        """Return the screen's columns (m, q) [N per unit, N/mm]."""
        every = [part.columns for part in self.start.parts] + [move.slope[:, None] for move in self.moves]
        return np.column_stack(every)[self.mask]

    def terms(self, a: np.ndarray) -> list[Term]:
        """Return the parts at their places, with their linear change there, and the values of each."""
        parts = list(self.start.parts)
        for k in {move.part for move in self.moves}:
            by = {move.axis: x for move, x in zip(self.moves, a[self.n_theta :]) if move.part == k}
            parts[k] = self.problem.at_its_place(displaced(parts[k], by))
        return terms_of(parts, a[: self.n_theta])

    def change(self, a: np.ndarray) -> np.ndarray:
        """Return the change (m,) [N] of the fitted entries at a (q,). Raises NotConverged."""
        forces = self.problem.forces_with(self.terms(a), self.problem.readings_of(self.mask))
        return self.problem.observations.flat(forces - self.problem.base)[self.mask]

    def covariance(self, a: np.ndarray) -> Covariance:
        """Return the covariance of the fitted entries, errors of the change at a (q,) included."""
        return self.problem.with_model_error(self.terms(a)).covariance.restricted(self.mask)

    def _of_all(self, name: str, of_moves: list) -> np.ndarray:
        of_parts = [np.broadcast_to(getattr(part, name), part.columns.shape[1]) for part in self.start.parts]
        return np.concatenate([*of_parts, of_moves])


def variables_of(problem: Problem, start: Screened, mask: np.ndarray, placing: bool = False) -> Variables:
    """Return what is varied in a refit of a screened answer: of places the ways that the fitted entries see.

    What an earlier refit has placed stays there, and its value alone is fitted, unless it is placing: it then goes on.
    """
    parts = tuple(_tried(problem, part) if placing else part for part in start.parts)
    moves, covariance = [], problem.covariance.restricted(mask)
    for k, (before, (part, theta)) in enumerate(zip(start.parts, terms_of(parts, start.theta))):
        slopes = problem.slopes_of(part) if part.moved_from is None else {}
        for axis, slope in slopes.items():
            way = slope.columns @ theta
            moved = float(before.hyperparameters[axis]) - float(part.hyperparameters[axis])
            if moved or np.linalg.norm(covariance.whiten(way[mask])) * slope.half > OBSERVABLE_SNR:
                moves.append(Move(k, axis, way, slope.half, slope.low, slope.high, moved))
    return Variables(problem, replace(start, parts=parts), tuple(moves), mask)


def _tried(problem: Problem, part: Candidate) -> Candidate:
    """Return a part that a refit has moved, at the place that was tried."""
    if part.moved_from is None:
        return part
    there = replace(part, hyperparameters=part.moved_from)
    return replace(there, moved_from=None, columns=problem.columns_at(there))
