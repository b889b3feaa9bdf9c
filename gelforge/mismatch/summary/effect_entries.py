"""The effects of a verdict: groups of the answer, every effect that was tried, with probability and values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gelforge.mismatch.evidence.alternatives import NOTHING, UNKNOWN, effects_of
from gelforge.mismatch.evidence.identifiability import profile
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.inference.answer import Answer, Group
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.result.values import value_entries
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted

NEGLIGIBLE = 0.1  # probability of a credible set, below which it is not reported
PROFILE_SD, PROFILE_POINTS = 4.0, 33


@dataclass(frozen=True, eq=False)
class Found:
    """One effect of a set, as it was fitted there."""

    part: Candidate
    amounts: np.ndarray  # (p,)
    spread: np.ndarray  # (p, p)
    log_bayes_factor: float  # of the whole set
    refitted: bool

    @property
    def change(self) -> np.ndarray:
        """Return what it changes by itself of all entries (n,)."""
        return self.part.columns @ self.amounts


def group_entries(problem: Problem, judgement: Judgement) -> list[form.Group]:
    """Return the groups that a verdict reports, the most probable first; none where it has no answer."""
    if judgement.answer is None:
        return []
    if judgement.model is not None and judgement.model.sure and not judgement.model.beside:
        return []  # effects that are not sure were fitted without the cause that is
    groups = [
        _group(problem, group) for group in judgement.answer.groups if group.set_probability >= NEGLIGIBLE
    ]
    return sorted(groups, key=lambda group: -group.probability)


def _group(problem: Problem, group: Group) -> form.Group:
    several = len(group.names) > 1
    return form.Group(
        members=list(group.members),
        probability=group.probability,
        alternatives=list(group.alternatives),
        set_probability=group.set_probability,
        shares=dict(group.shares),
        differs_N=group.differs_N if several else None,
        differs_snr=group.differs_snr if several else None,
        decided_by=problem.effects[group.members[0]].separated_by if several else "",
    )


def of_nothing(judgement: Judgement) -> float:
    """Return the probability that nothing is missing."""
    return judgement.posterior.probability[NOTHING]


def unknown_entry(judgement: Judgement) -> form.Unknown | None:
    """Return what a discrepancy has for it; None where no effect was fitted."""
    if judgement.answer is None:
        return None
    chance = judgement.posterior.holding([UNKNOWN])
    return form.Unknown(probability=chance, words=judgement.answer.discrepancy_words)


def effect_entries(problem: Problem, judgement: Judgement) -> list[form.NamedEffect]:
    """Return every effect that the readings can show: those of the answer first, then the most probable.

    What may stand in place of an effect of the answer has the values that it has beside the others of the answer.
    """
    answer, posterior = judgement.answer, judgement.posterior
    groups = {} if answer is None else {group.members[0]: group for group in answer.groups}
    found = {name: _alone(judgement, name) for name in posterior.singles}
    if answer is not None:
        for group in answer.groups:
            for name in group.names[1:]:
                found[name] = _in_place_of(judgement, group.members[0], name) or found[name]
        found |= {one.part.name: one for one in _fitted(answer)}
    reported = [
        _effect(problem, one, posterior.holding([name]), groups.get(name)) for name, one in found.items()
    ]
    if answer is not None:
        reported = [_profiled(problem, answer, effect) for effect in reported]
    return sorted(reported, key=lambda effect: (effect.name not in groups, -effect.probability))


def _fitted(answer: Answer) -> Iterator[Found]:
    """Yield the effects of an answer as they were fitted to all readings."""
    factor = answer.posterior.evidence[effects_of(answer.winner)]
    for part, amounts, spread in zip(answer.fit.parts, answer.fit.amounts, blocks_of(answer.fit)):
        yield Found(part, np.asarray(amounts), spread, factor, True)


def _alone(judgement: Judgement, name: str) -> Found:
    return _of_set(judgement, frozenset({name}), name) or _of_screen(judgement.posterior.singles[name], name)


def _in_place_of(judgement: Judgement, own: str, other: str) -> Found | None:
    """Return an effect in place of another one of the answer; None where that set was not judged."""
    return _of_set(judgement, effects_of(judgement.answered.winner) - {own} | {other}, other)


def _of_set(judgement: Judgement, effects: frozenset[str], name: str) -> Found | None:
    """Return an effect of a set as it was fitted there, or to first order; None where neither was."""
    answer, posterior = judgement.answer, judgement.posterior
    fit = None if answer is None else answer.refits.get(effects)
    if fit is not None:
        k = [part.name for part in fit.parts].index(name)
        return Found(
            fit.parts[k],
            np.asarray(fit.amounts[k]),
            blocks_of(fit)[k],
            posterior.evidence.get(effects, fit.log_bayes_factor),
            True,
        )
    judged = posterior.sets.get(effects)
    return None if judged is None else _of_screen(judged, name)


def _of_screen(judged: Screened, name: str) -> Found:
    at = 0
    for part in judged.parts:
        rows = slice(at, at + part.columns.shape[1])
        if part.name == name:
            return Found(
                part, judged.amounts[rows], judged.covariance[rows, rows], judged.log_bayes_factor, False
            )
        at = rows.stop
    raise KeyError(name)


def blocks_of(fit: Refitted) -> list[np.ndarray]:
    """Return each part's own block of the values' covariance."""
    ends = np.cumsum([0, *(len(a) for a in fit.amounts)])
    return [fit.covariance[a:b, a:b] for a, b in zip(ends, ends[1:])]


def _profiled(problem: Problem, answer: Answer, effect: form.NamedEffect) -> form.NamedEffect:
    """Return an effect of the answer with the profiles of its amounts, to first order about the fit; others as they are."""
    fit = answer.fit
    names = [part.name for part in fit.parts]
    if effect.name not in names or any(part.binary for part in fit.parts):
        return effect
    amounts = np.concatenate(fit.amounts)
    change = problem.observations.flat(answer.after - problem.base)
    covariance = problem.with_model_error(fit.parts, amounts).covariance
    judged = replace(answer.winner, parts=fit.parts)
    # The model's own change at the fitted values
    offset = problem.residual - change + np.column_stack([part.columns for part in fit.parts]) @ amounts
    first = sum(len(a) for a in fit.amounts[: names.index(effect.name)])
    sds = np.sqrt(np.diag(fit.covariance))
    found = []
    for k, amount in enumerate(effect.amounts, start=first):
        grid = amount.value + sds[k] * np.linspace(-PROFILE_SD, PROFILE_SD, PROFILE_POINTS)
        values = profile(offset, covariance, judged, k, grid)
        found.append(amount.model_copy(update={"profile": list(zip(grid.tolist(), values.tolist()))}))
    return effect.model_copy(update={"amounts": found})


def _effect(problem: Problem, one: Found, chance: float, group: Group | None) -> form.NamedEffect:
    part, change = one.part, one.change
    effect = problem.effects[part.name]
    return form.NamedEffect(
        name=part.name,
        family=effect.family,
        probability=chance,
        log_bayes_factor=float(one.log_bayes_factor),
        snr=float(np.linalg.norm(problem.covariance.whiten(change))),
        snr_instrument=float(np.linalg.norm(problem.covariance.instrument.whiten(change))),
        amounts=value_entries(effect.parameters, one.amounts, one.spread),
        shape=dict(part.shape),
        in_range=part.binary or effect.in_range(one.amounts),
        refitted=one.refitted,
        group=[*group.members] if group is not None and len(group.members) > 1 else [],
    )
