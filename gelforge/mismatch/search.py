"""The search for an answer: effects are weighed, the best refitted and confirmed, one more tried where that is wanted."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from gelforge.config.mismatch import Mismatch
from gelforge.mismatch.alternatives import UNKNOWN, Alternatives, effects_of
from gelforge.mismatch.confirmation import folds_of, scores_of
from gelforge.mismatch.final import Final
from gelforge.mismatch.groups import grouped, last_alone
from gelforge.mismatch.holdout import Blocks, Gain, gain, paid_for_choice
from gelforge.mismatch.identifiability import RIVAL, Group
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import Refitted
from gelforge.mismatch.refits import Refits, Told
from gelforge.mismatch.remains import Remains, remains
from gelforge.mismatch.screen import Screened
from gelforge.mismatch.unknown import Manner, Weighed, weighed_unknown
from gelforge.mismatch.verdict import ADEQUATE_P
from gelforge.mismatch.weighing import (
    moved,
    those_felt,
    weighed,
    weighed_alone,
    weighed_beside,
    whole,
)

MOST_EFFECTS = 3  # at once
CERTAIN_P = 1e-3  # of the tests, below which chance is no longer an explanation


@dataclass(frozen=True, eq=False)
class Terms:
    """On which a search is made."""

    blocks: Blocks
    settings: Mismatch
    rng: np.random.Generator
    known: int  # effects that the readings feel
    manners: Sequence[Manner]  # in which something unknown may act
    unknown: Weighed  # alone


@dataclass(frozen=True, eq=False)
class Answer:
    """Effects that were put into the base, and what speaks for them."""

    winner: Screened  # by all readings, with refitted amounts and changes
    fit: Refitted  # to the training readings
    ranked: tuple[Screened, ...]  # all that were tried beside it, refitted ones with their new evidence
    refits: tuple[Refitted, ...]
    groups: tuple[Group, ...]  # one per effect of the answer; none while the search goes on
    ahead: tuple[Screened, ...]  # one more effect beside the best, by all readings; none beyond MOST_EFFECTS
    alternatives: Alternatives  # all that was tried, what is ahead too, and something unknown alone and beside each winner
    unknown: Mapping[frozenset[str], Weighed]  # something unknown, alone and beside the winner
    told: float  # log evidence of the winner's refit on all readings
    problem: Problem  # with columns through what was solved
    adequacy: Remains  # of the training readings
    everywhere: Remains  # of all readings, but for what other amounts of the same effects could take up
    after: np.ndarray  # (R, 3) [N] forces with the effects, the readings set aside predicted
    final: Final  # what is told: the same until all readings are fitted
    gain: Gain | None
    scores: Mapping[str, pd.DataFrame]  # before and after: predictive scores of what was set aside
    folds: Mapping[str, tuple[Blocks, np.ndarray, Gain, Mapping[str, pd.DataFrame]]]
    # of few sites, each set aside in turn: blocks, residual (n,) after a fit to the others, gain, scores
    after_refuted: bool = False  # one with fewer effects was refuted, so that this one was looked for

    @property
    def refuted(self) -> bool:
        """Return whether the readings set aside speak against it: by their gain, or by what is left with them."""
        return self.everywhere.p < CERTAIN_P or (self.gain is not None and self.gain.refutes)

    @property
    def stranger(self) -> str:
        """Return the manner that something unknown would have, in words."""
        return self.unknown[max(self.unknown, key=self.alternatives.probability.get)].manner


def explained(problem: Problem, terms: Terms) -> tuple[Answer | None, list[str]]:
    """Return the most probable answer, or the best of those that leave more than noise, and what went wrong.

    One effect more is tried as long as noise is not all that is left, the readings set aside refute the answer, or some
    answer with one more would be much likelier. What the base assumes and cannot be true (problem.first) is put right before
    amounts are fitted in a model known to be false; it stays out where that does not help.
    """
    names = {c.name for c in problem.candidates}
    answer, notes = None, []
    if names & problem.first:
        answer = _round(problem, terms, names & problem.first, None, notes)
        answer = answer if answer is not None and answer.winner.log_bayes_factor > 0 else None
        names -= problem.first if answer is not None else set()
    while answer is None or (len(answer.fit.parts) < MOST_EFFECTS and _wanting(answer)):
        more = _round(problem, terms, names, answer, notes)
        if more is None:
            break
        if answer is not None and _weight(more) <= _weight(answer) + _margin(answer):
            answer = replace(answer, alternatives=more.alternatives)
            break
        answer = replace(more, after_refuted=answer is not None and (answer.refuted or answer.after_refuted))
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
    problem: Problem, terms: Terms, names: Collection[str], before: Answer | None, notes: list[str]
) -> Answer | None:
    """Return the best answer of one more effect, of those named, beside the best of before; None where none can be had.

    Refitted are the most probable ones by the training readings: those that cost no solution all, of the others
    1 + settings.rivals, and more of single ones as long as the next promises more than any refit has kept; then, at most
    settings.rivals times, what all readings find likelier than the best of these.
    """
    problem = problem if before is None else before.problem
    blocks, rivals = terms.blocks, terms.settings.rivals
    if before is None:
        ranked = weighed_alone(problem, blocks.train, names)
    else:
        ranked = weighed_beside(problem, blocks.train, names, before.ranked)
    refits = Refits(problem, blocks, notes)
    for leader in ranked:
        if leader.log_bayes_factor <= ranked[0].log_bayes_factor - RIVAL:
            break
        enough = refits.solved > rivals and (before is not None or refits.best >= leader.log_bayes_factor)
        if not (enough and refits.costs(leader)):
            refits.add(leader)
    promising: list[str] = []  # to all readings
    while (told := refits.told(promising)) is not None:
        problem = refits.seat(told.forces)
        by_all = _ranked_by_all(problem, names, before, refits.fits, told)
        overlooked = _overlooked(by_all, refits.tried, ranked)
        if overlooked is None or len(promising) == rivals:
            return _answer(problem, terms, names, before, by_all, refits.fits, told)
        promising.append(overlooked.name)
        refits.add(overlooked, whatever=True)
    return None


def _overlooked(
    by_all: Sequence[Screened], tried: Collection[frozenset[str]], ranked: Sequence[Screened]
) -> Screened | None:
    """Return the best of what all readings find likelier than the winner, their first, and no refit has tried, or None.

    As the training readings know it, where they do: what was set aside says that it is worth a refit, and no more.
    """
    winner, *others = by_all
    rest = [one for one in others if effects_of(one) not in tried]
    best = max(rest, key=lambda one: one.log_bayes_factor, default=winner)
    if best.log_bayes_factor <= winner.log_bayes_factor:
        return None
    return next((one for one in ranked if effects_of(one) == effects_of(best)), best)


def _ranked_by_all(
    problem: Problem,
    names: Collection[str],
    before: Answer | None,
    fits: Mapping[str, Refitted],
    told: Told,
) -> list[Screened]:
    """Return all that was tried in a round judged by all readings, the best refit first, the others as likely as they are.

    Evidence of refits differs from one to the next, and from the answer before, as it is told; of the others as screened.
    """
    evidence, fit = told.evidence, fits[told.best]
    every, own = np.ones(len(problem.labels), bool), frozenset(part.name for part in fit.parts)
    refits = {frozenset(part.name for part in one.parts): one for one in fits.values()}
    screen = weighed_alone(problem, every, names, refits) if before is None else before.ahead
    promised = next(one.log_bayes_factor for one in screen if effects_of(one) == own)
    kept = promised if before is None else before.winner.log_bayes_factor + evidence[fit.name] - before.told
    ranked = []
    for one in screen:
        refit = refits.get(effects_of(one))
        if refit is None:
            ranked.append(moved(one, kept - promised))
        else:
            more = kept + evidence[refit.name] - evidence[fit.name] - one.log_bayes_factor
            ranked.append(moved(_with_refit(problem, one, refit), more))
    return sorted(ranked, key=lambda one: (effects_of(one) != own, -one.log_bayes_factor))


def _answer(
    problem: Problem,
    terms: Terms,
    names: Collection[str],
    before: Answer | None,
    ranked: Sequence[Screened],
    fits: Mapping[str, Refitted],
    told: Told,
) -> Answer:
    """Return the best of some refits beside all else of its round, ranked by all readings, the best first."""
    fit = fits[told.best]
    fit = replace(fit, parts=tuple(whole(problem, part) for part in fit.parts))
    blocks, every = terms.blocks, np.ones(len(problem.labels), bool)
    own, winner = frozenset(part.name for part in fit.parts), ranked[0]
    ahead = ()
    if len(fit.parts) < MOST_EFFECTS:
        rest = {c.name for c in problem.candidates} - problem.first if own & problem.first else names
        ahead = tuple(weighed_beside(problem, every, rest, ranked))
    left = problem.observations.flat(problem.observations.force - told.after)
    unknown = _unknown(problem, terms, winner, fit, left)
    tried = Alternatives({}, terms.known) if before is None else before.alternatives
    tried = tried.beside({effects: found.log_bayes_factor for effects, found in unknown.items()})
    believed = problem.believing(fit.parts, np.concatenate(fit.amounts))
    columns = np.column_stack([*(part.columns for part in fit.parts), fit.ways])
    adequacy = remains(believed, left[blocks.train], blocks.train, terms.settings, terms.rng, fit.columns)
    everywhere = remains(believed, left, every, terms.settings, terms.rng, columns)
    scores = scores_of(problem, blocks, left, fit)
    trained = np.array([fits[name].log_bayes_factor for name in told.evidence])
    paid = paid_for_choice(trained, np.array([*told.evidence.values()]))
    return Answer(
        winner=winner,
        fit=fit,
        ranked=tuple(ranked),
        refits=tuple(fits.values()),
        groups=(),
        ahead=ahead,
        alternatives=tried.joined(ranked).joined(ahead),
        unknown=unknown,
        told=told.evidence[told.best],
        problem=problem,
        adequacy=adequacy,
        everywhere=everywhere,
        after=told.after,
        final=Final(fit, told.after),
        gain=replace(gain(scores["before"], scores["after"]), paid=paid) if blocks.held_out.any() else None,
        scores=scores,
        folds=folds_of(problem, winner),
    )


def _unknown(
    problem: Problem, terms: Terms, winner: Screened, fit: Refitted, left: np.ndarray
) -> dict[frozenset[str], Weighed]:
    """Return something unknown weighed by all readings, alone and beside a winner; left (n,) [N]: by the winner's refit."""
    beside = weighed_unknown(problem, terms.manners, fit.parts, np.concatenate(fit.amounts), left)
    both = replace(beside, log_bayes_factor=winner.log_bayes_factor + beside.log_bayes_factor)
    return {frozenset({UNKNOWN}): terms.unknown, effects_of(winner) | {UNKNOWN}: both}


def _with_refit(problem: Problem, judged: Screened, fit: Refitted) -> Screened:
    """Return a screened answer with the amounts of its refit."""
    amounts = np.concatenate(fit.amounts)
    parts = tuple(whole(problem, part) for part in fit.parts)
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
        alone = [last_alone(one) for one in those_felt(weighed(problem, every, candidates, others))]
        here = next((one for one in alone if one.name == own.name), None)
        if here is None:  # beside the others these readings do not feel it
            groups.append(Group((own.name,), 0.0, np.inf, {own.name: 1.0}, ()))
            continue
        alone = [here, *(one for one in alone if one is not here)]
        groups.append(grouped(alone, problem.covariance, answer.alternatives, alone=False))
    return tuple(groups)
