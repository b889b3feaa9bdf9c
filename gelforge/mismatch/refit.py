"""Effects at their own amounts in the real model: Gauss-Newton steps from the linear answer, and the evidence there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.covariance import Covariance
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.screen import Candidate, Screened

MOST_STEPS, MOST_CHEAP_STEPS = 4, 12  # where something is solved, and where nothing is
DIFFERENCE = 1e-3  # of a plausible amount: for columns taken anew where nothing is solved
ENOUGH = 0.15  # of a posterior standard deviation: a step that no interval would show
INSIDE = 1e-3  # of a bound's distance from zero that amounts keep from it


@dataclass(frozen=True, eq=False)
class Refitted:
    """Effects fitted in the real model."""

    parts: tuple[Candidate, ...]
    amounts: tuple[np.ndarray, ...]  # per part
    covariance: np.ndarray  # (p, p) of all of them
    columns: np.ndarray  # (m, p) [N per unit], of the entries that were fitted, at these amounts
    log_bayes_factor: float  # Laplace, against none, on these entries; shapes and scales are paid for
    converged: bool  # the next step would be below ENOUGH

    @property
    def name(self) -> str:
        return " + ".join(part.name for part in self.parts)


def refitted(problem: Problem, start: Screened, mask: np.ndarray) -> Refitted:
    """Return the effects of a screened answer fitted to the entries (n,) bool. Raises NotConverged at the first solution.

    After the first step the columns follow the model's own change (Broyden 1965, doi:10.1090/S0025-5718-1965-0198670-6);
    where nothing is solved they are taken anew.
    """
    residual = problem.residual[mask]
    covariance = problem.believing(start.parts, start.amounts).covariance.restricted(mask)
    parts = tuple(part.restricted(mask) for part in start.parts)
    switch = np.concatenate([np.full(part.columns.shape[1], part.switch) for part in parts])
    widths = np.concatenate([np.broadcast_to(part.widths, part.columns.shape[1]) for part in parts])
    signs = np.concatenate([np.broadcast_to(part.signs, part.columns.shape[1]) for part in parts])
    low, high = _bounds(problem, parts)
    J = np.column_stack([part.columns for part in parts])
    a = np.where(switch, 1.0, np.clip(start.amounts, low, high))
    change = _change(problem, start.parts, parts, a, mask)
    free, converged, steps = ~switch, bool(switch.all()), 0
    solved = any(problem.solves(part) for part in parts)
    most = MOST_STEPS if solved else MOST_CHEAP_STEPS
    while not converged:
        cost = _cost(residual - change, a, covariance, widths)
        Jw = covariance.whiten(J[:, free])
        H = Jw.T @ Jw + np.diag(1 / widths[free] ** 2)
        gradient = Jw.T @ covariance.whiten(residual - change) - a[free] / widths[free] ** 2
        to = np.clip(a[free] + np.linalg.solve(H, gradient), low[free], high[free])
        delta = to - a[free]
        converged = bool(np.all(np.abs(delta) <= ENOUGH * np.sqrt(np.diag(np.linalg.inv(H)))))
        if converged or steps == most:
            break
        trial, moved = a.copy(), None
        for share in (1.0, 0.5, 0.25):  # the solver may not reach the whole step
            trial[free] = a[free] + share * delta
            try:
                moved = _change(problem, start.parts, parts, trial, mask)
                break
            except NotConverged:
                continue
        if moved is None:
            break
        if not solved and _cost(residual - moved, trial, covariance, widths) > cost - ENOUGH:
            converged = True  # what is computed from images has a grain: there is nothing better to be seen
            break
        if solved:
            d = (trial - a)[free] / widths[free]
            J[:, free] += (
                np.outer(moved - change - J[:, free] @ (trial - a)[free], d / (d @ d)) / widths[free]
            )
        else:
            J = _columns_at(problem, start.parts, parts, trial, moved, widths, mask)
        a, change, steps = trial, moved, steps + 1
    covariance = problem.believing(start.parts, a).covariance.restricted(mask)
    factor, spread = _evidence(residual - change, covariance, J, a, free, widths, signs)
    factor -= problem.covariance.restricted(mask).log_density(residual)
    factor += start.log_bayes_factor - start.best_log_bayes_factor
    splits = np.cumsum([part.columns.shape[1] for part in parts])[:-1]
    return Refitted(start.parts, tuple(np.split(a, splits)), spread, J, factor, converged)


def _change(
    problem: Problem, whole: Sequence[Candidate], parts, a: np.ndarray, mask: np.ndarray
) -> np.ndarray:
    """Return the change (m,) [N] of the chosen entries with amounts a (p,)."""
    splits = np.cumsum([part.columns.shape[1] for part in parts])[:-1]
    forces = problem.forces_with(whole, np.split(a, splits), problem.readings_of(mask))
    return problem.observations.flat(forces - problem.base)[mask]


def _cost(left: np.ndarray, a: np.ndarray, covariance: Covariance, widths: np.ndarray) -> float:
    """Return minus the log posterior of amounts a (p,) that leave a residual (m,), but for a constant."""
    white = covariance.whiten(left)
    return 0.5 * float(white @ white + np.sum((a / widths) ** 2))


def _columns_at(problem: Problem, whole, parts, a, change, widths, mask: np.ndarray) -> np.ndarray:
    """Return the columns (m, p) [N per unit] at amounts a (p,), whose change is known, by differences."""
    columns = []
    for k, width in enumerate(widths):
        beside = a.copy()
        beside[k] += DIFFERENCE * width
        columns.append((_change(problem, whole, parts, beside, mask) - change) / (DIFFERENCE * width))
    return np.column_stack(columns)


def _bounds(problem: Problem, parts: Sequence[Candidate]) -> tuple[np.ndarray, np.ndarray]:
    low, high = [], []
    for part in parts:
        for parameter in problem.effects[part.name].parameters:
            lo, hi = parameter.bounds
            lo = max(lo, 0.0) if parameter.sign > 0 else lo
            hi = min(hi, 0.0) if parameter.sign < 0 else hi
            low.append(lo * (1 - INSIDE) if np.isfinite(lo) else lo)
            high.append(hi * (1 - INSIDE) if np.isfinite(hi) else hi)
    return np.array(low), np.array(high)


def _evidence(
    left: np.ndarray,
    covariance: Covariance,
    J: np.ndarray,
    a: np.ndarray,
    free: np.ndarray,
    widths: np.ndarray,
    signs: np.ndarray,
) -> tuple[float, np.ndarray]:
    """Return the log evidence of what is left (m,) by Laplace's approximation, and the covariance (p, p) of the amounts.

    Where an amount's sign holds it at none, the posterior's slope there tells how little of it lies on the allowed side.
    """
    factor = covariance.log_density(left)
    spread = np.zeros((len(a), len(a)))
    if free.any():
        w = widths[free]
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
