"""Effects at their own values and places in the real model: Gauss and Newton's steps, and the evidence there."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear
from scipy.special import log_ndtr

from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.terms.problem import SEATED_SNR, Problem, secant
from gelforge.mismatch.terms.variables import Variables, variables_of

MOST_STEPS, MOST_CHEAP_STEPS = 4, 12  # where something is solved, and where nothing is
STEPS_OF_PLACE = 4  # more, where a place is fitted too
DIFFERENCE = 1e-3  # of a plausible value: for columns taken anew where nothing is solved
PART_OF_A_WAY = 0.25  # half-way to the next place: across it the columns of ways are differences
ENOUGH = 0.15  # of a posterior standard deviation: a step that no interval would show


class End(Enum):
    """How a fit ended."""

    AT_REST = "at rest"
    MOVING = "still moving"  # after its last step, or the solver could not follow it


@dataclass(frozen=True, eq=False)
class Refitted:
    """Effects fitted in the real model."""

    parts: tuple[Candidate, ...]  # what has a place lies where it fits best, between those that were tried
    amounts: tuple[np.ndarray, ...]  # per part
    columns: (
        np.ndarray
    )  # (m, q) [N per unit, N/mm] of the entries that were fitted: of all amounts, then of places
    spread: np.ndarray  # (q, q) covariance of the same
    ways: np.ndarray  # (n, q - p) [N/mm] linear change of all entries along the places' ways
    # Laplace, against none, on these entries; shapes and scales are paid for.
    log_bayes_factor: float
    end: End

    @property
    def converged(self) -> bool:
        """Return whether the next step would be below ENOUGH."""
        return self.end is End.AT_REST

    @property
    def name(self) -> str:
        return " + ".join(part.name for part in self.parts)

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (p, p) of all amounts, whatever the places."""
        p = sum(len(a) for a in self.amounts)
        return self.spread[:p, :p]


def refitted(problem: Problem, start: Screened, mask: np.ndarray, placing: bool = False) -> Refitted:
    """Return the effects of a screened answer fitted to the entries (n,) bool. Raises NotConverged at the first solution.

    The place of what has one is fitted too, as far as the next that was tried, and a ball's size, along axes along which the
    readings see it. placing: from where an earlier refit has placed it, which else stays.
    """
    variables = variables_of(problem, start, mask, placing)
    against = -problem.covariance.restricted(mask).log_density(problem.residual[mask])
    against += start.log_bayes_factor - start.best_log_bayes_factor
    a, change, J, end = _fitted(variables)
    left = problem.residual[mask] - change
    factor, spread = _evidence(left, variables, J, a, variables.free)
    parts, amounts = variables.split(a)
    return Refitted(parts, amounts, J, spread, variables.ways, factor + against, end)


def _fitted(variables: Variables) -> tuple[np.ndarray, np.ndarray, np.ndarray, End]:
    """Return the variables (q,) that fit best, the change (m,) [N] there, its columns (m, q), and how the fit ended.

    After the first step the columns follow the model's own change (`secant`);
    where nothing is solved they are taken anew.
    """
    problem, mask = variables.problem, variables.mask
    residual, prior_sd, (low, high) = problem.residual[mask], variables.prior_sd, variables.bounds
    J, a = variables.columns(), variables.first()
    covariance, change = variables.covariance(a), variables.change(a)
    free, steps, reach = variables.free, 0, 1.0
    solved = any(problem.solves(part) for part in variables.start.parts)
    if solved:
        J = _through(change, J, a, variables, covariance)
        J = _along_ways(J, change, a, variables)
    most = MOST_STEPS + STEPS_OF_PLACE * bool(variables.moves) if solved else MOST_CHEAP_STEPS
    if not free.any():
        return a, change, J, End.AT_REST
    while True:
        cost = _cost(residual - change, a, covariance, prior_sd)
        Jw = covariance.whiten(J[:, free])
        H = Jw.T @ Jw + np.diag(1 / prior_sd[free] ** 2)
        gradient = Jw.T @ covariance.whiten(residual - change) - a[free] / prior_sd[free] ** 2
        enough = np.maximum(ENOUGH * np.sqrt(np.diag(np.linalg.inv(H))), variables.enough[free])
        delta = _step(H, gradient, a[free], low[free], high[free], np.ones(len(gradient), bool))
        # A place at rest stays, and the values are those that fit best there.
        at_rest = (np.abs(delta) <= enough) & (variables.enough[free] > 0)
        delta = _step(H, gradient, a[free], low[free], high[free], ~at_rest)
        converged = bool(np.all(np.abs(delta) <= enough))
        delta /= max(1.0, np.max(np.abs(delta) / variables.farthest[free]))
        if converged or steps == most:
            return a, change, J, End.AT_REST if converged else End.MOVING
        trial, found = a.copy(), None
        for share in (1.0, 0.5, 0.25):  # the solver may not reach the whole step
            trial[free] = np.clip(a[free] + share * reach * delta, low[free], high[free])  # rounding
            try:
                found = variables.change(trial)
                break
            except NotConverged:
                continue
        if found is None:
            return a, change, J, End.MOVING
        worse = _cost(residual - found, trial, covariance, prior_sd) - cost
        if not solved and worse > -ENOUGH:
            # What is computed from images has a grain: nothing better can be seen.
            return a, change, J, End.AT_REST
        if solved:
            step = (trial - a)[free]
            J[:, free] = secant(J[:, free], found - change - J[:, free] @ step, step, prior_sd[free])
        else:
            J = _columns_at(variables, trial, found)
        steps += 1
        if solved and worse > ENOUGH**2:
            reach /= 2  # a step too far has taught the columns, and is not taken; the next is shorter
        else:
            a, change, reach = trial, found, min(2 * reach, 1.0)


def _through(
    change: np.ndarray, J: np.ndarray, a: np.ndarray, variables: Variables, covariance: Covariance
) -> np.ndarray:
    """Return columns (m, q) through none at 0 and the first change (m,) solved at a (q,); ways grow as the change does."""
    linear = J @ a
    white = covariance.whiten(np.column_stack([linear, change]))
    if np.linalg.norm(white, axis=0).min() < SEATED_SNR:
        return J
    J = J.copy()
    J[:, variables.amounts :] *= float(white[:, 0] @ white[:, 1] / (white[:, 0] @ white[:, 0]))
    return secant(J, change - linear, a, variables.prior_sd)


def _along_ways(J: np.ndarray, change: np.ndarray, a: np.ndarray, variables: Variables) -> np.ndarray:
    """Return columns (m, q) of which those of the ways are solved differences about a (q,), where that converges."""
    J = J.copy()
    for k, move in enumerate(variables.moves, start=variables.amounts):
        beside = a.copy()
        beside[k] += PART_OF_A_WAY * (move.half if move.high > 0 else -move.half)
        try:
            J[:, k] = (variables.change(beside) - change) / (beside[k] - a[k])
        except NotConverged:
            continue
    return J


def _step(
    H: np.ndarray, gradient: np.ndarray, a: np.ndarray, low: np.ndarray, high: np.ndarray, moving: np.ndarray
) -> np.ndarray:
    """Return Newton's step (q,) of those that move (q,) bool, the others held: the best within bounds.

    What would go beyond a bound stays on it, and the others fit best beside that.
    """
    step = np.zeros(len(a))
    if moving.any():
        L = np.linalg.cholesky(H[np.ix_(moving, moving)])
        room = (low - a)[moving], (high - a)[moving]
        step[moving] = lsq_linear(L.T, solve_triangular(L, gradient[moving], lower=True), room, "bvls").x
    return step


def _cost(left: np.ndarray, a: np.ndarray, covariance: Covariance, prior_sd: np.ndarray) -> float:
    """Return minus the log posterior of variables a (q,) that leave a residual (m,), but for a constant."""
    white = covariance.whiten(left)
    return 0.5 * float(white @ white + np.sum((a / prior_sd) ** 2))


def _columns_at(variables: Variables, a: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return the columns (m, q) [N per unit] at a (q,), whose change is known, by differences."""
    columns = []
    for k, width in enumerate(variables.prior_sd):
        beside = a.copy()
        beside[k] += DIFFERENCE * width
        columns.append((variables.change(beside) - change) / (DIFFERENCE * width))
    return np.column_stack(columns)


def _evidence(
    left: np.ndarray, variables: Variables, J: np.ndarray, a: np.ndarray, free: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the log evidence of what is left (m,) by Laplace's approximation, and the covariance (q, q) of what is free.

    Where a value's sign holds it at none, the posterior's slope there says how little of it lies on the allowed side.
    """
    covariance, prior_sd, signs = variables.covariance(a), variables.prior_sd, variables.signs
    factor = covariance.log_density(left)
    spread = np.zeros((len(a), len(a)))
    if free.any():
        w = prior_sd[free]
        Jw = covariance.whiten(J[:, free]) * w
        H = np.eye(len(w)) + Jw.T @ Jw
        inverse = np.linalg.inv(H)
        factor -= 0.5 * float(np.sum((a[free] / w) ** 2)) + 0.5 * float(np.linalg.slogdet(H)[1])
        slope = np.where(signs[free] != 0, Jw.T @ covariance.whiten(left) - a[free] / w, 0.0)
        held = signs[free] * (a[free] / w + inverse @ slope) < 0
        slope = np.where(held, slope, 0.0)
        further = inverse @ slope  # to where the posterior would be largest
        factor += 0.5 * float(slope @ further)
        sd = np.sqrt(np.diag(inverse))
        for scaled, error, sign in zip(a[free] / w + further, sd, signs[free]):
            if sign:  # the prior lives on one side, and so does the posterior
                factor += float(np.log(2) + log_ndtr(sign * scaled / error))
        spread[np.ix_(free, free)] = w[:, None] * inverse * w
    return factor, spread
