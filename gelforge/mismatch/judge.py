"""The judge: is there a mismatch, where, which physics was left out, does it hold on data not seen, what else remains."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from gelforge.config import ConfigError
from gelforge.config.mismatch import Mismatch
from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.alternatives import Alternatives, effects_of, probabilities
from gelforge.mismatch.flow_scan import patterns
from gelforge.mismatch.groups import grouped, last_alone
from gelforge.mismatch.holdout import FEW_SITES, Blocks, Gain, gain, predictive_scores, split
from gelforge.mismatch.identifiability import DETECTED_SNR, RIVAL, Group
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import Refitted, refitted
from gelforge.mismatch.scan import GlobalTest, Scan, global_test, scan
from gelforge.mismatch.screen import Candidate, Screened, believing, screened
from gelforge.mismatch.verdict import ADEQUATE_P, ALARM_P, NAMED_ODDS, NAMED_PROBABILITY

MOST_EFFECTS = 3  # at once
BEAM = 4  # best answers of a round, beside each of which one more effect is tried
CERTAIN_P = 1e-3  # of the tests, below which chance is no longer an explanation
NOTICED = 0.1  # standard deviations of a change's own error, below which it moves no evidence
FELT_SNR = 0.5  # of a plausible amount; below it nothing can be said for or against
LIKELY = 0.5  # probability below which a group is no answer


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
    groups: tuple[Group, ...]  # one per effect of the answer; none while the search goes on
    alternatives: Alternatives  # all that was tried, with one more effect beside the best too
    told: float  # log evidence of the winner's refit on all readings
    problem: Problem  # with columns through what was solved
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
    """Return the most probable answer, or the best of those that leave more than noise, and what went wrong.

    One effect more is tried as long as noise is not all that is left, the readings set aside refute the answer, or some
    answer with one more would be much likelier. What the base assumes and cannot be true (problem.first) is put right before
    amounts are fitted in a model known to be false; it stays out where that does not help.
    """
    names = {c.name for c in problem.candidates}
    answer, notes = None, []
    if names & problem.first:
        answer = _round(problem, blocks, settings, rng, names & problem.first, None, notes)
        answer = answer if answer is not None and answer.winner.log_bayes_factor > 0 else None
        names -= problem.first if answer is not None else set()
    while answer is None or (len(answer.fit.parts) < MOST_EFFECTS and _wanting(answer)):
        more = _round(problem, blocks, settings, rng, names, answer, notes)
        if more is None:
            break
        if answer is not None and _weight(more) <= _weight(answer) + _margin(answer):
            answer = replace(answer, alternatives=more.alternatives)
            break
        answer = more
    if answer is not None:
        answer = replace(answer, groups=_groups(answer, names))
    return answer, notes


def _wanting(answer: Answer) -> bool:
    """Return whether an answer is not all that can be said: an answer with one effect more is wanted, or likelier."""
    likelier = answer.alternatives.likelier_of(len(answer.fit.parts) + 1, _weight(answer) + _margin(answer))
    return not _margin(answer) or likelier


def _margin(answer: Answer) -> float:
    """Return the log odds that an answer with one effect more needs.

    None where this one leaves more than noise or is refuted. Else it must be out of its reach: one large amount can as well
    be two smaller ones of effects that are alike.
    """
    wanted = answer.adequacy.p <= ADEQUATE_P or answer.refuted
    return 0.0 if wanted else RIVAL


def _weight(answer: Answer) -> float:
    """Return the log of prior times evidence of an answer."""
    return answer.alternatives.weight(effects_of(answer.winner), answer.winner.log_bayes_factor)


def _round(
    problem: Problem,
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
    names: Collection[str],
    before: Answer | None,
    notes: list[str],
) -> Answer | None:
    """Return the best answer of one more effect, of those named, beside the best of before; None where none can be had.

    Refitted are the most probable ones: those that cost no solution all, of the others 1 + settings.rivals, and more of
    single ones as long as the next promises more than any refit has kept.
    """
    problem = problem if before is None else before.problem
    ranked = _beside(problem, blocks.train, names, before and before.ranked)
    if not ranked:
        return None
    leaders = [s for s in ranked if s.log_bayes_factor > ranked[0].log_bayes_factor - RIVAL]
    fits: dict[str, Refitted] = {}

    def costs(answer: Screened | Refitted) -> bool:
        return any(problem.solves(part) for part in answer.parts)

    for leader in leaders:
        best = max((fit.log_bayes_factor for fit in fits.values()), default=-np.inf)
        solved = sum(costs(fit) for fit in fits.values())
        enough = solved > settings.rivals and (before is not None or best >= leader.log_bayes_factor)
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
        for name, with_it in forces.items():
            if len(fits[name].parts) == 1:
                problem = problem.seated(fits[name].parts[0], fits[name].amounts[0], with_it)
        return _answer(problem, blocks, settings, rng, names, before, fits, told, after)
    return None


def _beside(
    problem: Problem, mask: np.ndarray, names: Collection[str], before: Sequence[Screened] | None
) -> list[Screened]:
    """Return answers with one more effect, of those named, than the best before, judged by entries (n,) bool, best first.

    Of what puts a false base right only the first is kept.
    """
    candidates = [c for c in problem.candidates if c.name in names]
    if before is None:
        return testable(_screened(problem, mask, candidates))
    width = 1 if any(part.name in problem.first for part in before[0].parts) else BEAM
    best: dict[frozenset[str], Screened] = {}
    for given in before[:width]:
        for judged in testable(_screened(problem, mask, candidates, given.parts, given.paid)):
            judged = _moved(judged, given.refit_gain)
            known = best.get(effects_of(judged))
            if known is None or judged.log_bayes_factor > known.log_bayes_factor:
                best[effects_of(judged)] = judged
    return sorted(best.values(), key=lambda judged: -judged.log_bayes_factor)


def _moved(judged: Screened, by: float) -> Screened:
    """Return a screened answer with as much more evidence as refits have given."""
    return replace(
        judged,
        log_bayes_factor=judged.log_bayes_factor + by,
        best_log_bayes_factor=judged.best_log_bayes_factor + by,
        refit_gain=judged.refit_gain + by,
    )


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


def _unmasked(problem: Problem, judged: Screened) -> Screened:
    """Return a screened answer whose parts are the problem's own candidates, of all entries."""
    return replace(judged, parts=tuple(_whole(problem, part) for part in judged.parts))


def _whole(problem: Problem, part: Candidate) -> Candidate:
    """Return a part of an answer with the problem's columns of all entries."""
    return replace(part, columns=problem.own(part).columns)


def _answer(
    problem: Problem,
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
    names: Collection[str],
    before: Answer | None,
    fits: Mapping[str, Refitted],
    told: Mapping[str, float],
    after: np.ndarray,
) -> Answer:
    """Return the best of some refits beside all else of its round, judged by all readings.

    Evidence of refits differs from one to the next, and from the answer before, as it is told; of the others as screened.
    """
    fit = fits[max(told, key=told.get)]
    fit = replace(fit, parts=tuple(_whole(problem, part) for part in fit.parts))
    every = np.ones(len(problem.labels), bool)
    screen = _beside(problem, every, names, before and before.ranked)
    own = frozenset(part.name for part in fit.parts)
    promised = next(one.log_bayes_factor for one in screen if effects_of(one) == own)
    kept = promised if before is None else before.winner.log_bayes_factor + told[fit.name] - before.told
    refits = {frozenset(part.name for part in one.parts): one for one in fits.values()}
    ranked = []
    for one in screen:
        refit = refits.get(effects_of(one))
        if refit is None:
            ranked.append(_moved(one, kept - promised))
        else:
            more = kept + told[refit.name] - told[fit.name] - one.log_bayes_factor
            ranked.append(_moved(_with_refit(problem, one, refit), more))
    winner = next(one for one in ranked if effects_of(one) == own)
    ranked = sorted(ranked, key=lambda one: (one is not winner, -one.log_bayes_factor))
    known = len({c.name for c in problem.candidates})
    alternatives = (Alternatives({}, known) if before is None else before.alternatives).joined(ranked)
    if len(fit.parts) < MOST_EFFECTS:
        rest = {c.name for c in problem.candidates} - problem.first if own & problem.first else names
        alternatives = alternatives.joined(_beside(problem, every, rest, ranked))
    left = problem.observations.flat(problem.observations.force - after)
    believed = problem.believing(fit.parts, np.concatenate(fit.amounts))
    columns = np.column_stack([part.columns for part in fit.parts])
    adequacy = remains(believed, left[blocks.train], blocks.train, settings, rng, fit.columns)
    everywhere = remains(believed, left, every, settings, rng, columns)
    scores = _scores(problem, blocks, left, fit)
    return Answer(
        winner,
        fit,
        tuple(ranked),
        tuple(fits.values()),
        (),
        alternatives,
        told[fit.name],
        problem,
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


def _with_refit(problem: Problem, judged: Screened, fit: Refitted) -> Screened:
    """Return a screened answer with the amounts of its refit."""
    amounts = np.concatenate(fit.amounts)
    parts = tuple(_whole(problem, part) for part in fit.parts)
    change = np.column_stack([part.columns for part in parts]) @ amounts
    return replace(judged, parts=parts, amounts=amounts, covariance=fit.covariance, change=change)


def _groups(answer: Answer, names: Collection[str]) -> tuple[Group, ...]:
    """Return the group of every effect of the winner: of one of several, what could stand in its place beside the others."""
    problem, winner = answer.problem, answer.winner
    if len(winner.parts) == 1:
        return (grouped(answer.ranked, problem.covariance, answer.alternatives),)
    every, groups = np.ones(len(problem.labels), bool), []
    for own in winner.parts:
        others = tuple(part for part in winner.parts if part is not own)
        rivals = problem.first if own.name in problem.first else names
        candidates = [c for c in problem.candidates if c.name in rivals]
        alone = [last_alone(one) for one in testable(_screened(problem, every, candidates, others))]
        here = next((one for one in alone if one.name == own.name), None)
        if here is None:  # beside the others these readings do not feel it
            groups.append(Group((own.name,), 0.0, np.inf, {own.name: 1.0}, ()))
            continue
        alone = [here, *(one for one in alone if one is not here)]
        groups.append(grouped(alone, problem.covariance, answer.alternatives))
    return tuple(groups)


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
