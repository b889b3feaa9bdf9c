"""A strong defect is put where the finite elements fit it best, before sets of effects are weighed.

Places are tried on a grid. What a strong defect between them leaves is larger than many an effect, and would call for two
or three others beside it: so it is placed first, and the linear pass made again about it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.screen import Screened, screened
from gelforge.mismatch.inference.fits import forces_of
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import refitted
from gelforge.mismatch.thresholds import STRONG_SNR
from gelforge.progress import stage


def placed(problem: Problem, real: Problem) -> tuple[Problem, str]:
    """Return the problem with the candidate of a strong defect at its place, and why it could not be placed.

    real: the same, solved at few sites. A defect is placed where it alone, errors of its change aside, is likelier than any
    other effect alone; else the problem stays as it is.
    """
    start = screened(problem.residual, problem.covariance, problem.candidates)[0]
    if not _is_strong_defect(problem, start):
        return problem, ""
    stage(f"place of the {start.name.replace('_', ' ')}")
    try:
        fit = refitted(real.with_linear_history(), start, np.ones(len(problem.labels), bool))
        change = problem.observations.flat(forces_of(real, fit) - problem.base)
    except (NotConverged, ConfigError) as failure:
        return problem, f"{start.name.replace('_', ' ')} could not be placed: {failure}"
    ((part,), (amounts,)) = fit.parts, fit.amounts
    if part.moved_from is None or not np.any(amounts):
        return problem, ""
    own, (amount,) = problem.tried(part), amounts
    there = replace(part, columns=change[:, None] / amount, prior_sd=own.prior_sd)
    return replace(problem, candidates=[there if one is own else one for one in problem.candidates]), ""


def _is_strong_defect(problem: Problem, one: Screened) -> bool:
    """Return whether a single effect has a place, is solved, and is seen clearly."""
    (part,) = one.parts
    return "x_mm" in part.shape and problem.solves(part) and one.snr > STRONG_SNR
