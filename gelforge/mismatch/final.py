"""The amounts that are told: an answer that the readings set aside have confirmed is fitted once more, to all readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gelforge.mismatch.confirmation import forces_of
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import Refitted, refitted
from gelforge.mismatch.screen import Screened


@dataclass(frozen=True, eq=False)
class Final:
    """Effects at the amounts that are told, which the study takes over."""

    fit: Refitted
    after: np.ndarray  # (R, 3) [N] forces with them


def fitted_to_all(problem: Problem, winner: Screened, fit: Refitted) -> Final:
    """Return a winner fitted to all readings, from where a fit to the training readings ended. Raises NotConverged.

    Its effects are known by now, so that their amounts have the plausible widths, not the scale that had most evidence. A
    place that has been found stays; what it leaves open of the amounts is added.
    """
    parts = tuple(replace(part, widths=problem.own(part).widths) for part in winner.parts)
    start = replace(winner, parts=parts, amounts=np.concatenate(fit.amounts))
    found = refitted(problem.drafted(), start, np.ones(len(problem.labels), bool))
    spread = found.spread.copy()
    p = len(start.amounts)
    along = fit.spread[:p, p:]
    if along.size and not found.ways.size:
        spread[:p, :p] += along @ np.linalg.solve(fit.spread[p:, p:], along.T)
    return Final(replace(found, spread=spread), forces_of(problem, found))
