"""Refitted effects against the readings that were set aside: their forces there, predictive scores, and what these tell."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd

from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.holdout import FEW_SITES, Blocks, gain, predictive_scores, split
from gelforge.mismatch.identifiability import RIVAL
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import Refitted, refitted
from gelforge.mismatch.screen import Screened


class NotSolved(NotConverged):
    """Refitted effects that do not converge at readings to which they were not fitted."""

    def __init__(self, name: str, failure: NotConverged):
        super().__init__(str(failure))
        self.name = name


def told_of(
    problem: Problem, blocks: Blocks, fits: Mapping[str, Refitted], promising: Collection[str] = ()
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Return the evidence for refitted effects, and the forces (R, 3) [N] with those that were solved everywhere for it.

    The readings set aside count too, by their predictive log score: theirs is then the evidence of all readings (chain
    rule), as is that of the screen beside them. Put there exactly are those within RIVAL of the best, the promising ones and
    those that need no solver; those farther behind are taken for linear. Amounts follow the training readings alone.
    Raises NotSolved.
    """
    told = {name: fit.log_bayes_factor for name, fit in fits.items()}
    reach = max(told.values()) - RIVAL
    free = [name for name, fit in fits.items() if not any(map(problem.solves, fit.parts))]
    near = [name for name, value in told.items() if value > reach or name in promising or name in free]
    if not blocks.held_out.any():
        return told, {}
    forces = {name: forces_of(problem, fits[name]) for name in near}
    gains = {}
    for name, fit in fits.items():
        change = (
            problem.observations.flat(forces[name] - problem.base) if name in forces else linear_change(fit)
        )
        scores = scores_of(problem, blocks, problem.residual - change, fit)
        gains[name] = float(scores["after"]["score"].sum() - scores["before"]["score"].sum())
    return {name: value + gains[name] for name, value in told.items()}, forces


def linear_change(fit: Refitted) -> np.ndarray:
    """Return the change (n,) [N] of all entries by refitted effects to first order."""
    return np.column_stack([part.columns for part in fit.parts]) @ np.concatenate(fit.amounts)


def forces_of(problem: Problem, fit: Refitted) -> np.ndarray:
    """Return the forces (R, 3) [N] at all readings with refitted effects. Raises NotSolved."""
    try:
        return problem.forces_with(fit.parts, fit.amounts, np.ones(len(problem.base), bool))
    except NotConverged as failure:
        raise NotSolved(fit.name, failure) from failure


def scores_of(problem: Problem, blocks: Blocks, left: np.ndarray, fit: Refitted) -> dict[str, pd.DataFrame]:
    """Return predictive scores, "before" and "after", of what was set aside; left (n,) [N]: by the fit. None of nothing."""
    if not blocks.held_out.any():
        return {}
    whole = np.column_stack([*(part.columns for part in fit.parts), fit.ways])
    labels = problem.labels
    covariance, amounts = problem.covariance, np.concatenate(fit.amounts)
    errors = covariance.errors(problem.errors_of(fit.parts, amounts))
    change = problem.residual - left
    believed = problem.believing(fit.parts, amounts).covariance
    return {
        "before": predictive_scores(
            problem.residual, covariance, blocks, labels, change=change, errors=errors
        ),
        "after": predictive_scores(left, believed, blocks, labels, whole, fit.spread),
    }


def folds_of(problem: Problem, winner: Screened) -> dict:
    """Return, where sites are few, how the answer fitted to the others meets each of them."""
    labels, found = problem.labels, {}
    sites = problem.observations.table["site"].unique()
    if not 1 < len(sites) < FEW_SITES:
        return found
    for turn, site in enumerate(np.sort(sites), start=1):
        blocks = split(labels, 0, turn)
        try:
            fit = refitted(problem, winner, blocks.train)
            after = forces_of(problem, fit)
        except NotConverged:  # without this fold nothing is shown, and nothing is lost
            continue
        left = problem.observations.flat(problem.observations.force - after)
        scores = scores_of(problem, blocks, left, fit)
        x, y = problem.observations.sites[site]
        found[f"site ({x:g}, {y:g}) mm"] = (blocks, left, gain(scores["before"], scores["after"]), scores)
    return found
