"""The judge: is there a mismatch, where, which physics was left out, does it hold on data not seen, what else remains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from gelforge.config import ConfigError
from gelforge.config.mismatch import Mismatch
from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.covariance import Covariance
from gelforge.mismatch.flow_scan import patterns
from gelforge.mismatch.holdout import FEW_SITES, Blocks, Gain, gain, predictive_scores, split
from gelforge.mismatch.identifiability import DETECTED_SNR, RIVAL, Group, group_of_winner
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import Refitted, refitted
from gelforge.mismatch.scan import GlobalTest, Scan, global_test, scan
from gelforge.mismatch.screen import Candidate, Screened, normalised, probabilities, screened
from gelforge.mismatch.verdict import ADEQUATE_P, ALARM_P, NAMED_ODDS, NAMED_PROBABILITY

MOST_EFFECTS = 3  # at once
FELT_SNR = 0.5  # of a plausible amount; below it nothing can be said for or against
MOST_MEMBERS = 4  # of a group that is widened by rivals


@dataclass(frozen=True, eq=False)
class Remains:
    """What a model leaves of some readings, by chance or not."""

    test: GlobalTest
    scan: Scan

    @property
    def p(self) -> float:
        return min(self.test.p, self.scan.p)


@dataclass(frozen=True, eq=False)
class Answer:
    """Effects that were put into the base, and what speaks for them."""

    winner: Screened  # on the training readings, with refitted amounts and changes
    fit: Refitted
    ranked: tuple[Screened, ...]  # all that were tried beside it, refitted ones with their new evidence
    refits: tuple[Refitted, ...]
    groups: tuple[Group, ...]  # one per effect of the answer
    probability: Mapping[str, float]
    adequacy: Remains
    after: np.ndarray  # (R, 3) [N] forces with the effects
    gain: Gain | None
    scores: Mapping[str, pd.DataFrame]  # before and after: predictive scores of what was set aside
    folds: Mapping[str, tuple[Blocks, np.ndarray, Gain, Mapping[str, pd.DataFrame]]]
    # of few sites, each set aside in turn: blocks, residual (n,) after a fit to the others, gain, scores


@dataclass(frozen=True, eq=False)
class Judgement:
    """All that was found, before it is put into words."""

    state: str  # as in verdict.json
    blocks: Blocks
    mismatch: Remains
    singles: tuple[Screened, ...]
    probability: Mapping[str, float]  # of null and of single effects, by the screen
    answer: Answer | None
    notes: tuple[str, ...]  # what went wrong on the way


def judge(problem: Problem, settings: Mismatch, seed: int, turn: int = 0) -> Judgement:
    """Return the judgement on a problem.

    Whether there is a mismatch, and where, is asked of all readings; which effect it is, of the training readings alone.
    """
    labels, rng = problem.labels, np.random.default_rng([seed, 5])
    blocks = split(labels, seed, turn)
    everything = np.ones(len(labels), bool)
    mismatch = remains(problem, problem.residual, everything, settings, rng)
    residual, covariance, candidates = problem.part(blocks.train)
    singles = screened(residual, covariance, candidates)
    probability = probabilities(testable(singles))
    if mismatch.p >= ALARM_P:
        state = "null" if _could_have_seen(testable(singles)) else "insufficient"
        return Judgement(state, blocks, mismatch, tuple(singles), probability, None, ())
    answer, notes = _explained(problem, blocks, settings, rng)
    return Judgement(
        _state(problem, answer), blocks, mismatch, tuple(singles), probability, answer, tuple(notes)
    )


def remains(
    problem: Problem,
    residual: np.ndarray,
    mask: np.ndarray,
    settings: Mismatch,
    rng: np.random.Generator,
    fitted: np.ndarray | None = None,
) -> Remains:
    """Return both tests of a residual (m,) of some entries (n,) bool; fitted (m, p): columns that were fitted to them."""
    covariance = problem.covariance.restricted(mask)
    labels = problem.labels[mask].reset_index(drop=True)
    atoms = patterns(labels, problem.observations.flat(problem.base)[mask]).whitened(covariance, fitted)
    found = scan(covariance.whiten(residual), atoms, rng, settings.draws, covariance.estimated)
    return Remains(global_test(residual, covariance, fitted), found)


def testable(ranked: Sequence[Screened]) -> list[Screened]:
    """Return the effects of which a plausible amount is felt by the readings at all.

    One that they do not feel has evidence 0, which is no evidence and would win over what they refute.
    """
    return [judged for judged in ranked if judged.plausible_snr > FELT_SNR]


def _could_have_seen(singles: Sequence[Screened]) -> bool:
    """Return whether a plausible amount of at least half of the effects that these readings feel would have shown."""
    snr = np.array([judged.plausible_snr for judged in singles])
    return bool(len(snr) and np.mean(snr >= DETECTED_SNR) >= 0.5)


def _explained(
    problem: Problem, blocks: Blocks, settings: Mismatch, rng: np.random.Generator
) -> tuple[Answer | None, list[str]]:
    """Return the simplest answer that leaves noise, or the best of those that do not, and what went wrong.

    What the base assumes and cannot be true (problem.first) is put right before amounts are fitted in a model known to be
    false; it stays out where that does not help.
    """
    known_false = [c for c in problem.candidates if c.name in problem.first]
    answer, notes = None, []
    if known_false:
        answer = _round(problem, blocks, settings, rng, known_false, (), notes)
        answer = answer if answer is not None and answer.winner.log_bayes_factor > 0 else None
    candidates = [c for c in problem.candidates if answer is None or c.name not in problem.first]
    while answer is None or len(answer.fit.parts) < MOST_EFFECTS:
        if answer is not None and answer.adequacy.p > ADEQUATE_P:
            break
        given = () if answer is None else tuple(_whole(problem, part) for part in answer.winner.parts)
        more = _round(problem, blocks, settings, rng, candidates, given, notes)
        if more is None or (answer is not None and _no_better(answer, more)):
            break
        answer = more
    return answer, notes


def _round(
    problem: Problem,
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
    candidates: Sequence[Candidate],
    given: tuple[Candidate, ...],
    notes: list[str],
) -> Answer | None:
    """Return the best answer of one more effect beside those given; None where none can be had."""
    residual, covariance, _ = problem.part(blocks.train)
    tried = [candidate.restricted(blocks.train) for candidate in candidates]
    before = tuple(candidate.restricted(blocks.train) for candidate in given)
    ranked = testable(screened(residual, covariance, tried, given=before))
    if not ranked:
        return None
    leaders = [s for s in ranked if s.log_bayes_factor > ranked[0].log_bayes_factor - RIVAL]
    leaders = leaders[: 1 + settings.rivals]
    mask = telling_apart(problem, blocks.train, leaders, settings.refit_sites)
    fits = {}
    for leader in leaders:
        try:
            fits[leader.name] = refitted(problem, _unmasked(problem, leader), mask)
        except (NotConverged, ConfigError) as failure:  # ConfigError: effects that do not go together
            notes.append(f"{leader.name} could not be solved at its fitted amount: {failure}")
    while fits:
        try:
            return _answer(problem, blocks, settings, rng, ranked, fits, mask, tried)
        except NotConverged as failure:  # at other readings than those of the fit
            best = max(fits, key=lambda name: fits[name].log_bayes_factor)
            notes.append(f"{best} could not be solved at its fitted amount for all readings: {failure}")
            del fits[best]
    return None


def _no_better(answer: Answer, more: Answer) -> bool:
    """Return whether one more effect has no more evidence than those before it."""
    return more.winner.log_bayes_factor <= answer.winner.log_bayes_factor


def telling_apart(problem: Problem, train: np.ndarray, leaders: Sequence[Screened], count: int) -> np.ndarray:
    """Return the training entries (n,) bool at the sites where the leaders' changes are largest and differ most."""
    covariance = problem.covariance.restricted(train)
    changes = covariance.whiten(np.column_stack([leader.change for leader in leaders]))
    first = changes[:, :1]
    along = first * (first.T @ changes) / max(float(np.sum(first**2)), 1e-300)
    told = (first**2).sum(axis=1) / max(len(leaders) - 1, 1) + ((changes - along) ** 2).sum(axis=1)
    site = problem.labels["site"].to_numpy()
    sums = {int(s): told[site[train] == s].sum() for s in np.unique(site[train])}
    chosen = sorted(sums, key=lambda s: -sums[s])[:count]
    return train & np.isin(site, chosen)


def _unmasked(problem: Problem, judged: Screened) -> Screened:
    """Return a screened answer whose parts are the problem's own candidates, of all entries."""
    parts = tuple(_whole(problem, part) for part in judged.parts)
    return Screened(**{**vars(judged), "parts": parts})


def _whole(problem: Problem, part):
    return next(c for c in problem.candidates if c.name == part.name and dict(c.shape) == dict(part.shape))


def _answer(
    problem: Problem,
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
    ranked: Sequence[Screened],
    fits: Mapping[str, Refitted],
    mask: np.ndarray,
    candidates: Sequence[Candidate],
) -> Answer:
    residual, covariance, everything = problem.part(blocks.train)
    told = {name: fit.log_bayes_factor for name, fit in fits.items()}
    if problem.observations.table["site"].nunique() <= settings.refit_sites:
        told = {name: value + _told_by_held_out(problem, blocks, fits[name]) for name, value in told.items()}
    best = fits[max(told, key=told.get)]
    screen = {judged.name: judged for judged in ranked}
    judged_again = sorted(
        (
            _with_refit(
                judged, fits.get(judged.name), screen[best.name], told.get(judged.name, 0.0) - told[best.name]
            )
            for judged in ranked
        ),
        key=lambda judged: -judged.log_bayes_factor,
    )
    probability = normalised(
        {"null": 0.0}
        | {judged.name: judged.log_bayes_factor - np.log(len(ranked)) for judged in judged_again}
    )
    winner = next(judged for judged in judged_again if judged.name == best.name)
    judged_again = [winner, *(judged for judged in judged_again if judged is not winner)]
    after = problem.forces_with(best.parts, best.amounts, np.ones(len(problem.base), bool))
    left = problem.observations.flat(problem.observations.force - after)
    adequacy = remains(problem, left[mask], mask, settings, rng, best.columns)
    scores = _scores(problem, blocks, left, best)
    return Answer(
        winner,
        best,
        tuple(judged_again),
        tuple(fits.values()),
        _groups(problem, judged_again, covariance, probability, residual, candidates, everything),
        probability,
        adequacy,
        after,
        gain(scores["before"], scores["after"]) if blocks.held_out.any() else None,
        scores,
        _folds(problem, winner, settings),
    )


def _folds(problem: Problem, winner: Screened, settings: Mismatch) -> dict:
    """Return, where sites are few, how the answer fitted to the others meets each of them."""
    labels, found = problem.labels, {}
    sites = problem.observations.table["site"].unique()
    if not 1 < len(sites) < FEW_SITES:
        return found
    for turn, site in enumerate(np.sort(sites), start=1):
        blocks = split(labels, 0, turn)
        try:
            fit = refitted(problem, _unmasked(problem, winner), blocks.train)
            after = problem.forces_with(fit.parts, fit.amounts, np.ones(len(problem.base), bool))
        except NotConverged:  # without this fold nothing is shown, and nothing is lost
            continue
        left = problem.observations.flat(problem.observations.force - after)
        scores = _scores(problem, blocks, left, fit)
        x, y = problem.observations.sites[site]
        found[f"site ({x:g}, {y:g}) mm"] = (blocks, left, gain(scores["before"], scores["after"]), scores)
    return found


def _told_by_held_out(problem: Problem, blocks: Blocks, fit: Refitted) -> float:
    """Return what the readings set aside add to the evidence of a short-listed effect: their predictive log score.

    With it the evidence is that of all readings (chain rule). Done where all sites are refitted anyway.
    """
    if not blocks.held_out.any():
        return 0.0
    after = problem.forces_with(fit.parts, fit.amounts, np.ones(len(problem.base), bool))
    scores = _scores(problem, blocks, problem.observations.flat(problem.observations.force - after), fit)
    return float(scores["after"]["score"].sum() - scores["before"]["score"].sum())


def _with_refit(judged: Screened, fit: Refitted | None, best: Screened, behind: float) -> Screened:
    """Return a screened effect with the amounts of its refit and its evidence relative to the best one's of the screen."""
    if fit is None:
        return judged
    amounts = np.concatenate(fit.amounts)
    columns = np.column_stack([part.columns for part in judged.parts])
    change = columns @ amounts
    return Screened(
        **{
            **vars(judged),
            "amounts": amounts,
            "covariance": fit.covariance,
            "change": change,
            "log_bayes_factor": best.log_bayes_factor + behind,
        }
    )


def _groups(
    problem: Problem,
    ranked: Sequence[Screened],
    covariance: Covariance,
    probability: Mapping[str, float],
    residual: np.ndarray,
    candidates: Sequence[Candidate],
    everything: Sequence[Candidate],
) -> tuple[Group, ...]:
    """Return the group of every effect of the winner: of one of several, what could stand in its place beside the others."""
    winner = ranked[0]
    if len(winner.parts) == 1:
        return (_widened(group_of_winner(ranked, covariance, probability), probability),)
    groups = []
    for own in winner.parts:
        others = tuple(part for part in winner.parts if part is not own)
        first = [candidate for candidate in everything if candidate.name in problem.first]
        rivals = first if own.name in problem.first else candidates
        beside = testable(screened(residual, covariance, rivals, given=others))
        alone = [_last_alone(judged) for judged in beside]
        here = next((judged for judged in alone if judged.name == own.name), None)
        if here is None:  # beside the others these readings do not feel it
            groups.append(Group((own.name,), 0.0, np.inf, {own.name: 1.0}, ()))
            continue
        alone = [here, *(judged for judged in alone if judged is not here)]
        chances = normalised({judged.name: judged.log_bayes_factor for judged in alone})
        groups.append(_widened(group_of_winner(alone, covariance, chances), chances))
    return tuple(groups)


def _last_alone(judged: Screened) -> Screened:
    """Return the last effect of several as one of its own, with its share of the change."""
    last = judged.parts[-1]
    p = last.columns.shape[1]
    own = {"parts": (last,), "amounts": judged.amounts[-p:], "covariance": judged.covariance[-p:, -p:]}
    return Screened(**{**vars(judged), **own, "change": last.columns @ judged.amounts[-p:]})


def _widened(group: Group, probability: Mapping[str, float]) -> Group:
    """Return a group with the rivals, most probable first, without which it is not NAMED_PROBABILITY sure.

    They leave another pattern, but these readings are too few to say which it is.
    """
    members, p = list(group.members), group.probability
    for rival in sorted(group.rivals, key=lambda name: -probability[name]):
        if p >= NAMED_PROBABILITY or len(members) >= MOST_MEMBERS:
            break
        members.append(rival)
        p += probability[rival]
    others = sum(probability[name] for name in members[1:])
    odds = probability[members[0]] / others if others > 0 else np.inf
    return replace(group, members=tuple(members), probability=float(p), odds=float(odds))


def _scores(problem: Problem, blocks: Blocks, left: np.ndarray, fit: Refitted) -> dict:
    if not blocks.held_out.any():
        return {}
    whole = np.column_stack([part.columns for part in fit.parts])
    labels = problem.labels
    return {
        "before": predictive_scores(problem.residual, problem.covariance, blocks, labels),
        "after": predictive_scores(
            left, problem.covariance, blocks, labels, whole, fit.covariance, problem.residual
        ),
    }


def in_range(problem: Problem, fit: Refitted) -> bool:
    """Return whether all amounts are physical and off their bounds."""
    return all(
        part.switch or problem.effects[part.name].in_range(amounts)
        for part, amounts in zip(fit.parts, fit.amounts)
    )


def _state(problem: Problem, answer: Answer | None) -> str:
    """Return named, group, open or insufficient of an answer to a mismatch that is there.

    What rests on a refit that has not converged is not named: its amounts and evidence are not final.
    """
    if answer is None or answer.adequacy.p <= ADEQUATE_P or not in_range(problem, answer.fit):
        return "open"
    if answer.gain is None or not answer.gain.clear:
        return "insufficient"
    sure = all(
        group.probability >= NAMED_PROBABILITY and (len(group.members) == 1 or group.odds >= NAMED_ODDS)
        for group in answer.groups
    )
    if sure and answer.fit.converged:
        return "named"
    return "group" if any(len(group.members) > 1 for group in answer.groups) else "insufficient"
