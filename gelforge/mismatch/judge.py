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
from gelforge.mismatch.screen import Candidate, Screened, believing, normalised, probabilities, screened
from gelforge.mismatch.verdict import ADEQUATE_P, ALARM_P, NAMED_ODDS, NAMED_PROBABILITY

MOST_EFFECTS = 3  # at once
CERTAIN_P = 1e-3  # of the tests, below which chance is no longer an explanation
NOTICED = 0.1  # standard deviations of a change's own error, below which it moves no evidence
FELT_SNR = 0.5  # of a plausible amount; below it nothing can be said for or against
LIKELY = 0.5  # probability below which a group is no answer
MOST_MEMBERS = 4  # of a group that is widened by rivals


class NotSolved(NotConverged):
    """Refitted effects that do not converge at readings to which they were not fitted."""

    def __init__(self, name: str, failure: NotConverged):
        super().__init__(str(failure))
        self.name = name


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

    winner: Screened  # by all readings, with refitted amounts and changes
    fit: Refitted
    ranked: tuple[Screened, ...]  # all that were tried beside it, refitted ones with their new evidence
    refits: tuple[Refitted, ...]
    groups: tuple[Group, ...]  # one per effect of the answer
    probability: Mapping[str, float]
    adequacy: Remains  # of the training readings
    everywhere: Remains  # of all readings, but for what other amounts of the same effects could take up
    after: np.ndarray  # (R, 3) [N] forces with the effects
    gain: Gain | None
    scores: Mapping[str, pd.DataFrame]  # before and after: predictive scores of what was set aside
    folds: Mapping[str, tuple[Blocks, np.ndarray, Gain, Mapping[str, pd.DataFrame]]]
    # of few sites, each set aside in turn: blocks, residual (n,) after a fit to the others, gain, scores

    @property
    def refuted(self) -> bool:
        """Return whether the readings set aside speak against it: by their gain, or by what is left with them."""
        return self.everywhere.p < CERTAIN_P or (self.gain is not None and self.gain.refutes)


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

    @property
    def refuted(self) -> bool:
        """Return whether something is certainly there and the readings set aside speak against the best answer to it."""
        return self.answer is not None and _refuted(self.mismatch, self.answer)


def judge(problem: Problem, settings: Mismatch, seed: int, turn: int = 0) -> Judgement:
    """Return the judgement on a problem.

    Whether there is a mismatch, and where, is asked of all readings; what could explain it, and by how much, of the training
    readings; among the last few those set aside help to choose.
    """
    labels, rng = problem.labels, np.random.default_rng([seed, 5])
    blocks = split(labels, seed, turn)
    everything = np.ones(len(labels), bool)
    mismatch = remains(problem, problem.residual, everything, settings, rng)
    singles = _screened(problem, blocks.train, problem.candidates)
    probability = probabilities(testable(singles))
    if mismatch.p >= ALARM_P:
        state = "null" if _could_have_seen(testable(singles)) else "insufficient"
        return Judgement(state, blocks, mismatch, tuple(singles), probability, None, ())
    answer, notes = _explained(problem, blocks, settings, rng)
    return Judgement(
        _state(problem, mismatch, answer), blocks, mismatch, tuple(singles), probability, answer, tuple(notes)
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
        answer = _round(problem, blocks, settings, rng, known_false, None, notes)
        answer = answer if answer is not None and answer.winner.log_bayes_factor > 0 else None
    candidates = [c for c in problem.candidates if answer is None or c.name not in problem.first]
    while answer is None or len(answer.fit.parts) < MOST_EFFECTS:
        if answer is not None and answer.adequacy.p > ADEQUATE_P:
            break
        more = _round(problem, blocks, settings, rng, candidates, answer, notes)
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
    before: Answer | None,
    notes: list[str],
) -> Answer | None:
    """Return the best answer of one more effect beside those of the answer before; None where none can be had.

    Refitted are the most probable ones: those that cost no solution all, of the others 1 + settings.rivals, and more as
    long as the next one promises more than any refit has kept.
    """
    given, paid = ((), 0.0) if before is None else (before.winner.parts, before.winner.paid)
    ranked = testable(_screened(problem, blocks.train, candidates, given, paid))
    if not ranked:
        return None
    leaders = [s for s in ranked if s.log_bayes_factor > ranked[0].log_bayes_factor - RIVAL]
    fits: dict[str, Refitted] = {}

    def costs(answer: Screened | Refitted) -> bool:
        return any(problem.solves(part) for part in answer.parts)

    for leader in leaders:
        best = max((fit.log_bayes_factor for fit in fits.values()), default=-np.inf)
        solved = sum(costs(fit) for fit in fits.values())
        enough = solved > settings.rivals and best >= leader.log_bayes_factor
        if enough and costs(leader):
            continue
        try:
            fits[leader.name] = refitted(problem, _unmasked(problem, leader), blocks.train)
        except (NotConverged, ConfigError) as failure:  # ConfigError: effects that do not go together
            notes.append(f"{leader.name} could not be solved at its fitted amount: {failure}")
    while fits:
        try:
            told, forces = _told(problem, blocks, fits)
            best = max(told, key=told.get)
            after = forces[best] if best in forces else forces_of(problem, fits[best])
        except NotSolved as failure:  # at other readings than those of the fit
            notes.append(
                f"{failure.name} could not be solved at its fitted amount for all readings: {failure}"
            )
            del fits[failure.name]
            continue
        everywhere = testable(_screened(problem, np.ones(len(problem.labels), bool), candidates, given, paid))
        return _answer(problem, blocks, settings, rng, everywhere, fits, told, after, candidates)
    return None


def _screened(
    problem: Problem,
    mask: np.ndarray,
    candidates: Sequence[Candidate],
    given: tuple[Candidate, ...] = (),
    paid: float = 0.0,
) -> list[Screened]:
    """Return effects judged by entries (n,) bool beside those given, best first, errors of their own changes included.

    paid: log evidence that those given have lost to the choice of their shapes and scales.
    """
    residual, covariance, _ = problem.part(mask)
    tried = [candidate.restricted(mask) for candidate in candidates]
    ranked = screened(residual, covariance, tried, tuple(part.restricted(mask) for part in given))
    again = []
    for judged in ranked:
        if max(map(problem.error_of, judged.parts)) * judged.snr > NOTICED:
            wider = problem.believing(_unmasked(problem, judged).parts, judged.amounts)
            judged = believing(judged, residual, covariance, wider.covariance.restricted(mask))
        again.append(replace(judged, log_bayes_factor=judged.log_bayes_factor + paid))
    return sorted(again, key=lambda judged: -judged.log_bayes_factor)


def _no_better(answer: Answer, more: Answer) -> bool:
    """Return whether one more effect has no more evidence than those before it."""
    return more.winner.log_bayes_factor <= answer.winner.log_bayes_factor


def _unmasked(problem: Problem, judged: Screened) -> Screened:
    """Return a screened answer whose parts are the problem's own candidates, of all entries."""
    return replace(judged, parts=tuple(_whole(problem, part) for part in judged.parts))


def _whole(problem: Problem, part: Candidate) -> Candidate:
    """Return a part of an answer with its columns of all entries."""
    own = next(c for c in problem.candidates if c.name == part.name and dict(c.shape) == dict(part.shape))
    return replace(part, columns=own.columns)


def _answer(
    problem: Problem,
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
    ranked: Sequence[Screened],
    fits: Mapping[str, Refitted],
    told: Mapping[str, float],
    after: np.ndarray,
    candidates: Sequence[Candidate],
) -> Answer:
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
    left = problem.observations.flat(problem.observations.force - after)
    believed = problem.believing(best.parts, np.concatenate(best.amounts))
    every, columns = np.ones(len(left), bool), np.column_stack([part.columns for part in best.parts])
    adequacy = remains(believed, left[blocks.train], blocks.train, settings, rng, best.columns)
    everywhere = remains(believed, left, every, settings, rng, columns)
    scores = _scores(problem, blocks, left, best)
    return Answer(
        winner,
        best,
        tuple(judged_again),
        tuple(fits.values()),
        _groups(problem, judged_again, probability, candidates),
        probability,
        adequacy,
        everywhere,
        after,
        gain(scores["before"], scores["after"]) if blocks.held_out.any() else None,
        scores,
        _folds(problem, winner),
    )


def _folds(problem: Problem, winner: Screened) -> dict:
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
        scores = _scores(problem, blocks, left, fit)
        x, y = problem.observations.sites[site]
        found[f"site ({x:g}, {y:g}) mm"] = (blocks, left, gain(scores["before"], scores["after"]), scores)
    return found


def _told(
    problem: Problem, blocks: Blocks, fits: Mapping[str, Refitted]
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Return the evidence for refitted effects, and the forces (R, 3) [N] with those that were solved everywhere for it.

    Of those within RIVAL of the best the readings set aside count too, by their predictive log score: theirs is then the
    evidence of all readings (chain rule), as is that of the screen beside them. Amounts follow the training readings alone.
    Raises NotSolved.
    """
    told = {name: fit.log_bayes_factor for name, fit in fits.items()}
    reach = max(told.values()) - RIVAL
    near = [name for name, value in told.items() if value > reach]
    if not blocks.held_out.any():
        return told, {}
    forces = {name: forces_of(problem, fits[name]) for name in near}
    gains = {}
    for name, after in forces.items():
        left = problem.observations.flat(problem.observations.force - after)
        scores = _scores(problem, blocks, left, fits[name])
        gains[name] = float(scores["after"]["score"].sum() - scores["before"]["score"].sum())
    most = max(gains.values())  # those farther behind keep their distance
    return {name: value + gains.get(name, most) for name, value in told.items()}, forces


def forces_of(problem: Problem, fit: Refitted) -> np.ndarray:
    """Return the forces (R, 3) [N] at all readings with refitted effects. Raises NotSolved."""
    try:
        return problem.forces_with(fit.parts, fit.amounts, np.ones(len(problem.base), bool))
    except NotConverged as failure:
        raise NotSolved(fit.name, failure) from failure


def _with_refit(judged: Screened, fit: Refitted | None, best: Screened, behind: float) -> Screened:
    """Return a screened effect with the amounts of its refit and its evidence relative to the best one's of the screen."""
    if fit is None:
        return judged
    amounts = np.concatenate(fit.amounts)
    change = np.column_stack([part.columns for part in fit.parts]) @ amounts
    return replace(
        judged,
        parts=fit.parts,
        amounts=amounts,
        covariance=fit.covariance,
        change=change,
        log_bayes_factor=best.log_bayes_factor + behind,
        best_log_bayes_factor=best.log_bayes_factor + behind - judged.paid,
    )


def _groups(
    problem: Problem,
    ranked: Sequence[Screened],
    probability: Mapping[str, float],
    candidates: Sequence[Candidate],
) -> tuple[Group, ...]:
    """Return the group of every effect of the winner: of one of several, what could stand in its place beside the others."""
    winner, covariance = ranked[0], problem.covariance
    every = np.ones(len(covariance), bool)
    if len(winner.parts) == 1:
        return (_grouped(ranked, covariance, probability),)
    groups = []
    for own in winner.parts:
        others = tuple(part for part in winner.parts if part is not own)
        first = [candidate for candidate in problem.candidates if candidate.name in problem.first]
        rivals = first if own.name in problem.first else candidates
        beside = testable(_screened(problem, every, rivals, others))
        alone = [_last_alone(judged) for judged in beside]
        here = next((judged for judged in alone if judged.name == own.name), None)
        if here is None:  # beside the others these readings do not feel it
            groups.append(Group((own.name,), 0.0, np.inf, {own.name: 1.0}, ()))
            continue
        alone = [here, *(judged for judged in alone if judged is not here)]
        chances = normalised({judged.name: judged.log_bayes_factor for judged in alone})
        groups.append(_grouped(alone, covariance, chances))
    return tuple(groups)


def _grouped(ranked: Sequence[Screened], covariance: Covariance, probability: Mapping[str, float]) -> Group:
    """Return the group of the best of some effects, its odds with or without errors of changes, whichever say less.

    One effect is exact and another errs: of two that are alike that alone would decide.
    """
    group = _widened(group_of_winner(ranked, covariance, probability), probability)
    exact = normalised({judged.name: judged.log_bayes_factor - judged.error_cost for judged in ranked})
    others = sum(exact[name] for name in group.members[1:])
    return replace(group, odds=min(group.odds, exact[group.members[0]] / others)) if others > 0 else group


def _last_alone(judged: Screened) -> Screened:
    """Return the last effect of several as one of its own, with its share of the change."""
    last = judged.parts[-1]
    p = last.columns.shape[1]
    amounts = judged.amounts[-p:]
    own = judged.covariance[-p:, -p:]
    return replace(judged, parts=(last,), amounts=amounts, covariance=own, change=last.columns @ amounts)


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
    covariance, amounts = problem.covariance, np.concatenate(fit.amounts)
    errors = covariance.errors(problem.errors_of(fit.parts, amounts))
    change = problem.residual - left
    believed = problem.believing(fit.parts, amounts).covariance
    return {
        "before": predictive_scores(
            problem.residual, covariance, blocks, labels, change=change, errors=errors
        ),
        "after": predictive_scores(left, believed, blocks, labels, whole, fit.covariance),
    }


def in_range(problem: Problem, fit: Refitted) -> bool:
    """Return whether all amounts are physical and off their bounds."""
    return all(
        part.switch or problem.effects[part.name].in_range(amounts)
        for part, amounts in zip(fit.parts, fit.amounts)
    )


def _refuted(mismatch: Remains, answer: Answer) -> bool:
    return mismatch.p < CERTAIN_P and answer.refuted


def _state(problem: Problem, mismatch: Remains, answer: Answer | None) -> str:
    """Return named, group, open or insufficient of an answer to a mismatch that is there.

    Where the mismatch is certain and the readings set aside refute the best answer, something unknown is there. What rests
    on a refit that has not converged is not named: its amounts and evidence are not final. A group that is less likely
    than not says nothing.
    """
    if answer is None or answer.adequacy.p <= ADEQUATE_P or not in_range(problem, answer.fit):
        return "open"
    if _refuted(mismatch, answer):
        return "open"
    if answer.gain is None or not answer.gain.clear:
        return "insufficient"
    sure = all(
        group.probability >= NAMED_PROBABILITY and (len(group.members) == 1 or group.odds >= NAMED_ODDS)
        for group in answer.groups
    )
    if sure and answer.fit.converged:
        return "named"
    likely = all(group.probability >= LIKELY for group in answer.groups)
    return "group" if likely and any(len(group.members) > 1 for group in answer.groups) else "insufficient"
