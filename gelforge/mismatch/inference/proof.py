"""What an answer is worth on held-out readings: its values by the others alone, and the predictive score there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.screen import Screened, judged_by
from gelforge.mismatch.inference.posterior import Posterior
from gelforge.mismatch.terms.holdout import (
    FEW_SITES,
    Blocks,
    Gain,
    gain,
    predictive_scores,
    selection_penalty_of,
    split,
)
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted


@dataclass(frozen=True, eq=False)
class Proof:
    """Held-out readings, predicted by the base and by an answer that was fitted to the others."""

    blocks: Blocks
    left: np.ndarray  # (n,) [N] measured less the answer's prediction
    gain: Gain
    scores: Mapping[str, pd.DataFrame]  # "before" and "after"


def proof_of(problem: Problem, fit: Refitted, left: np.ndarray, blocks: Blocks) -> Proof:
    """Return how an answer fitted to the training readings predicts the others.

    fit: of all readings, left (n,) [N] what it leaves; its values, and places, by the training readings alone follow by one
    linear step about it, as its columns are those of the real model there.
    """
    amounts = np.concatenate(fit.amounts)
    uncertain = problem.with_model_error(fit.parts, amounts).covariance
    columns = fit.columns
    step, spread = _training_step(uncertain, fit, left, blocks.train)
    after = left - columns @ step
    errors = problem.covariance.errors(problem.errors_of(fit.parts, amounts))
    change = problem.residual - after
    scores = {
        "before": predictive_scores(
            problem.residual, problem.covariance, blocks, problem.labels, change=change, errors=errors
        ),
        "after": predictive_scores(after, uncertain, blocks, problem.labels, columns, spread),
    }
    return Proof(blocks, after, gain(scores["before"], scores["after"]), scores)


def _training_step(
    covariance: Covariance, fit: Refitted, left: np.ndarray, train: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the step (q,) from a fit to all readings to that to the training readings, and its covariance (q, q)."""
    q, free = fit.columns.shape[1], np.diag(fit.spread) > 0
    prior = _prior_of(fit, covariance, free)
    part = covariance.restricted(train)
    J = part.whiten(fit.columns[train][:, free])
    H = J.T @ J + prior
    step, spread = np.zeros(q), np.zeros((q, q))
    spread[np.ix_(free, free)] = np.linalg.inv(H)
    # About the fit to all the gradient of what was held out is what is missing to the training readings' own.
    whole = covariance.whiten(np.column_stack([fit.columns[:, free], left]))
    slope = J.T @ part.whiten(left[train]) - whole[:, :-1].T @ whole[:, -1]
    step[free] = np.linalg.solve(H, slope)
    return step, spread


def _prior_of(fit: Refitted, covariance: Covariance, free: np.ndarray) -> np.ndarray:
    """Return the precision (f, f) that the priors gave a fit: that of its spread less that of its columns."""
    J = covariance.whiten(fit.columns[:, free])
    precision = np.linalg.inv(fit.spread[np.ix_(free, free)]) - J.T @ J
    return np.diag(np.maximum(np.diag(precision), 0.0))


def after_penalty(proof: Proof, problem: Problem, posterior: Posterior) -> Proof:
    """Return a proof that pays for what the readings held out had to say in choosing the answer."""
    every, sets = np.ones(len(problem.labels), bool), [*posterior.sets.values()]
    trained, reported = (_evidence(problem, sets, mask) for mask in (proof.blocks.train, every))
    return replace(proof, gain=replace(proof.gain, selection_penalty=selection_penalty_of(trained, reported)))


def _evidence(problem: Problem, sets: Sequence[Screened], mask: np.ndarray) -> np.ndarray:
    """Return the log evidence (k,) of sets by some entries (n,) bool, by their linear changes at their best shapes."""
    covariance = problem.covariance.restricted(mask)
    r, white = covariance.whiten(problem.residual[mask]), {}
    found = []
    for one in sets:
        for part in one.parts:
            if id(part.columns) not in white:
                white[id(part.columns)] = covariance.whiten(part.columns[mask])
        found.append(
            judged_by(r, one.parts, [white[id(part.columns)] for part in one.parts]).log_bayes_factor
        )
    return np.array(found)


def folds_of(problem: Problem, fit: Refitted, left: np.ndarray) -> dict[str, Proof]:
    """Return, where sites are few, how the answer fitted to the others predicts each of them."""
    sites = np.sort(problem.observations.table["site"].unique())
    if not 1 < len(sites) < FEW_SITES:
        return {}
    found = {}
    for turn, site in enumerate(sites, start=1):
        x, y = problem.observations.sites[site]
        found[f"site ({x:g}, {y:g}) mm"] = proof_of(problem, fit, left, split(problem.labels, 0, turn))
    return found
