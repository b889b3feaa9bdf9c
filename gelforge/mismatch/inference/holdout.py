"""What a model says of readings that it did not see: blocks held out, predictive log score, its gain and error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.refit import Refitted
from gelforge.mismatch.evidence.screen import Screened, judged_under
from gelforge.mismatch.inference.posterior import Posterior
from gelforge.mismatch.result.scores import HeldOut, score
from gelforge.mismatch.thresholds import FEW_SITES, HELD_OUT


@dataclass(frozen=True, eq=False)
class Blocks:
    """Training entries (n,) bool, and those held out by name: "positions", "deepest"."""

    train: np.ndarray
    held: Mapping[str, np.ndarray]

    @property
    def held_out(self) -> np.ndarray:
        """Return (n,) bool: what was held out, for whatever reason."""
        return ~self.train


def split(labels: pd.DataFrame, seed: int, turn: int = 0) -> Blocks:
    """Return which readings train and which are held out.

    Held out are all readings at about a quarter of the sites, drawn by the seed. So are those in the deepest quarter of the
    depths at the other sites. Another turn sets other sites aside. Of fewer than FEW_SITES sites a quarter is none: turn 0
    sets the deepest quarter aside, turn k the k-th site and nothing else. Enough is then left to learn from. A single site,
    or a single depth, is not held out.

    Parameters
    ----------
    labels : pandas.DataFrame
        n rows with columns `site` and `depth_mm`.
    seed : int
        Of the draw.
    turn : int
        From 0.

    Returns
    -------
    Blocks
        (n,) bool each.
    """
    site = labels["site"].to_numpy()
    sites = np.random.default_rng(seed).permutation(np.unique(site))
    few = len(sites) < FEW_SITES
    if few:
        chosen = np.sort(sites)[turn - 1 : turn] if turn and len(sites) > 1 else sites[:0]
    else:
        count = round(HELD_OUT * len(sites))
        chosen = np.roll(sites, -turn * count)[:count]
    depth = labels["depth_mm"].to_numpy(float).round(6)
    levels = np.unique(depth)
    deepest = levels[len(levels) - int(np.ceil(HELD_OUT * len(levels))) :] if len(levels) > 1 else levels[:0]
    positions = np.isin(site, chosen)
    deep = np.isin(depth, [] if few and turn else deepest) & ~positions
    return Blocks(~positions & ~deep, {"positions": positions, "deepest": deep})


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a model fitted to the training readings leaves of all, and how well its values are known."""

    left: np.ndarray  # (n,) [N]
    covariance: Covariance
    columns: np.ndarray | None = None  # (n, p) per unit of its values; None: it has none
    spread: np.ndarray | None = None  # (p, p) of the values


def predictive_scores(
    prediction: Prediction, blocks: Blocks, change: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Return by block the predictive log score, and the squared distance to a model next to this one.

    change (n,): to that model. Blocks are scored in turn, each given the training readings and the blocks before it, so that
    the scores add up to the joint predictive density (Dawid 1984, doi:10.2307/2981683). Draws of an indentation that is held
    out as a whole stay free: nothing of it is fitted.
    """
    if not blocks.train.any():
        raise ValueError("no training readings are left; give more than one site or depth")
    V = prediction.left[:, None]
    if prediction.columns is not None and prediction.spread is not None and prediction.spread.size:
        l, E = np.linalg.eigh(prediction.spread)
        V = np.column_stack([V, prediction.columns @ (E * np.sqrt(np.maximum(l, 0)))])
    V = np.column_stack([V, np.zeros(len(V)) if change is None else change])

    def products(entries: np.ndarray) -> tuple[np.ndarray, float]:
        """Return v' C^-1 w for the columns v, w of V on some entries, and ln det C there."""
        part = prediction.covariance.restricted(entries)
        white = part.whiten(V[entries])
        return white.T @ white, part.log_det

    scores: dict[str, np.ndarray] = {}
    known, sums = blocks.train, np.zeros(2)
    trained, of_trained = products(known)
    for name, entries in blocks.held.items():
        if entries.any():
            known = known | entries
            G, log_det = products(known)
            G = G - trained
            score = _log_score(G[:-1, :-1], log_det - of_trained, int((known & ~blocks.train).sum()))
            total = np.array([score, G[-1, -1] + _variance_of_spread(G[1:-1, 1:-1])])
            scores[name], sums = total - sums, total
    return scores


def gain(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Return the gain of scores `after` (2,) over `before` of the same readings, and its standard error by their noise.

    `before` has the distance of the change between the two, `after` that of its uncertain values. Not from the scatter of
    the blocks' gains: an effect that sits at one place gains at few of them.
    """
    return float(after[0] - before[0]), float(np.sqrt(max(before[1] + after[1], 0.0)))


def held_out_of(problem: Problem, blocks: Blocks, before: Prediction, after: Prediction) -> list[HeldOut]:
    """Return how two predictions meet what was held out: all of it, then block by block. Errors are those of the forces."""
    scores = predictive_scores(before, blocks, before.left - after.left), predictive_scores(after, blocks)
    held = []
    for name, mask in {"all": blocks.held_out, **blocks.held}.items():
        if not mask.any():
            continue
        summed = [np.sum([*one.values()], axis=0) if name == "all" else one[name] for one in scores]
        total, error = gain(*summed)
        errors = (score(problem.labels, one.left, mask & problem.of_force) for one in (before, after))
        held.append(
            HeldOut(block=name, before=next(errors), after=next(errors), gain=total, standard_error=error)
        )
    return held


def selection_penalty_of(trained: np.ndarray, by_all: np.ndarray) -> float:
    """Return what the best of K models has to pay of its gain as the readings held out helped to choose it, 0 or less.

    trained, by_all (K,): log evidence by the training readings and by all. The mean of the models' predictive densities,
    weighted by what the training readings say of each, is fixed without the readings held out; its gain, which chance
    makes large as seldom as that of a single model, is all that the chosen one may claim.
    """
    best = int(np.argmax(by_all))
    return float(min(logsumexp(by_all) - logsumexp(trained) - (by_all[best] - trained[best]), 0.0))


def _log_score(G: np.ndarray, log_det: float, count: int) -> float:
    """Return ln N(r; 0, S + J J') from G, the products v' S^-1 w of r and the columns of J."""
    g, B = G[1:, 0], np.eye(len(G) - 1) + G[1:, 1:]
    square = G[0, 0] - g @ np.linalg.solve(B, g)
    return float(-0.5 * (square + np.linalg.slogdet(B)[1] + log_det + count * np.log(2 * np.pi)))


def _variance_of_spread(B: np.ndarray) -> float:
    """Return the variance of z' B (1 + B)^-1 z / 2, z standard normal: that of a score whose values are uncertain."""
    b = np.maximum(np.linalg.eigvalsh(B), 0.0) if len(B) else np.zeros(0)
    return float(0.5 * np.sum((b / (1 + b)) ** 2))


@dataclass(frozen=True, eq=False)
class Proof:
    """Held-out readings, predicted by the base and by an answer that was fitted to the others."""

    left: np.ndarray  # (n,) [N] measured less the answer's prediction
    held: Sequence[HeldOut]  # all, then block by block


def proof_of(problem: Problem, fit: Refitted, left: np.ndarray, blocks: Blocks) -> Proof:
    """Return how an answer fitted to the training readings predicts the others.

    fit: of all readings, left (n,) [N] what it leaves; its values, and places, by the training readings alone follow by one
    linear step about it, as its columns are those of the real model there.
    """
    uncertain = problem.with_model_error(fit.terms).covariance
    step, spread = _training_step(uncertain, fit, left, blocks.train)
    base = Prediction(problem.residual, problem.covariance)
    answer = Prediction(left - fit.columns @ step, uncertain, fit.columns, spread)
    return Proof(answer.left, held_out_of(problem, blocks, base, answer))


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


def after_penalty(proof: Proof, problem: Problem, posterior: Posterior, train: np.ndarray) -> Proof:
    """Return a proof that pays for what readings held out, all but train (n,) bool, had to say in choosing the answer."""
    every, sets = np.ones(len(problem.labels), bool), [*posterior.sets.values()]
    trained, reported = (_evidence(problem, sets, mask) for mask in (train, every))
    penalty = {"selection_penalty": selection_penalty_of(trained, reported)}
    return replace(proof, held=[proof.held[0].model_copy(update=penalty), *proof.held[1:]])


def _evidence(problem: Problem, sets: Sequence[Screened], mask: np.ndarray) -> np.ndarray:
    """Return the log evidence (k,) of sets by some entries (n,) bool, by linear changes at their best hyperparameters."""
    covariance, residual = problem.covariance.restricted(mask), problem.residual[mask]

    def evidence(one: Screened) -> float:
        parts = [replace(part, columns=part.columns[mask]) for part in one.parts]
        return judged_under(covariance, residual, parts).log_bayes_factor

    return np.array([evidence(one) for one in sets])


def folds_of(problem: Problem, fit: Refitted, left: np.ndarray) -> list[HeldOut]:
    """Return, where sites are few, how the answer fitted to the others predicts each of them."""
    sites = np.sort(problem.observations.table["site"].unique())
    folds = []
    for turn, site in enumerate(sites if 1 < len(sites) < FEW_SITES else (), start=1):
        x, y = problem.observations.sites[site]
        proof = proof_of(problem, fit, left, split(problem.labels, 0, turn))
        folds.append(proof.held[0].model_copy(update={"block": f"site ({x:g}, {y:g}) mm"}))
    return folds
