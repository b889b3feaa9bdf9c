"""What an answer is worth on held-out readings: its values by the others alone, and the predictive score there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.screen import Screened, judged_under
from gelforge.mismatch.inference.posterior import Posterior
from gelforge.mismatch.terms.holdout import Blocks, Gain, gain, predictive_scores, selection_penalty_of, split
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted
from gelforge.mismatch.thresholds import FEW_SITES


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
    change = problem.residual - after
    scores = {
        "before": predictive_scores(
            problem.residual, problem.covariance, blocks, problem.labels, change=change
        ),
        "after": predictive_scores(after, uncertain, blocks, problem.labels, columns, spread),
    }
    return Proof(blocks, after, gain(scores["before"], scores["after"]), scores)


def _training_step(
    covariance: Covariance, fit: Refitted, left: np.ndarray, train: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the step (q,) from a fit to all readings to that to the training readings, and its covariance (q, q)."""
    q, free = fit.columns.shape[1], np.diag(fit.spread) > 0
    part = covariance.restricted(train)
    J = part.whiten(fit.columns[train][:, free])
    H = J.T @ J + np.diag(fit.prior_sd[free] ** -2.0)
    step, spread = np.zeros(q), np.zeros((q, q))
    spread[np.ix_(free, free)] = np.linalg.inv(H)
    # About the fit to all the gradient of what was held out is what is missing to the training readings' own.
    whole = covariance.whiten(np.column_stack([fit.columns[:, free], left]))
    step[free] = np.linalg.solve(H, J.T @ part.whiten(left[train]) - whole[:, :-1].T @ whole[:, -1])
    return step, spread


def after_penalty(proof: Proof, problem: Problem, posterior: Posterior) -> Proof:
    """Return a proof that pays for what the readings held out had to say in choosing the answer."""
    every, sets = np.ones(len(problem.labels), bool), [*posterior.sets.values()]
    trained, reported = (_evidence(problem, sets, mask) for mask in (proof.blocks.train, every))
    return replace(proof, gain=replace(proof.gain, selection_penalty=selection_penalty_of(trained, reported)))


def _evidence(problem: Problem, sets: Sequence[Screened], mask: np.ndarray) -> np.ndarray:
    """Return the log evidence (k,) of sets by some entries (n,) bool, by their linear changes at their best shapes."""
    covariance, residual = problem.covariance.restricted(mask), problem.residual[mask]

    def evidence(one: Screened) -> float:
        parts = [replace(part, columns=part.columns[mask]) for part in one.parts]
        return judged_under(covariance, residual, parts).log_bayes_factor

    return np.array([evidence(one) for one in sets])


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
