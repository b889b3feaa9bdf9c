"""The effects of a verdict: groups of the answer, every effect that was tried, with probability and values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from gelforge.mismatch.evidence.alternatives import effects_of
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.inference.answer import Group
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.model.effect import Parameter
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted

NEGLIGIBLE = 0.1  # probability of a credible set, below which it is not reported
NINETY = float(norm.ppf(0.95))


@dataclass(frozen=True, eq=False)
class Found:
    """One effect of a set, as it was fitted there."""

    part: Candidate
    amounts: np.ndarray  # (p,)
    spread: np.ndarray  # (p, p)
    log_bayes_factor: float  # of the whole set
    refitted: bool


def found_in(fit: Refitted | Screened, log_bayes_factor: float) -> dict[str, Found]:
    """Return the effects of a set by name, from its fit or its linear evidence."""
    amounts = np.concatenate([np.atleast_1d(a) for a in fit.amounts])
    found, at, refitted = {}, 0, isinstance(fit, Refitted)
    for part in fit.parts:
        own = slice(at, at + part.columns.shape[1])
        at = own.stop
        found[part.name] = Found(part, amounts[own], fit.covariance[own, own], log_bayes_factor, refitted)
    return found


def group_entries(problem: Problem, judgement: Judgement) -> list[form.Group]:
    """Return the groups that a verdict reports, the most probable first; none where it has no answer."""
    if judgement.answer is None:
        return []
    if judgement.model is not None and judgement.model.sure and not judgement.model.beside:
        return []  # effects that are not sure were fitted without the cause that is
    groups = [one for one in judgement.answer.groups if one.set_probability >= NEGLIGIBLE]
    return [_group(problem, one) for one in sorted(groups, key=lambda group: -group.probability)]


def _group(problem: Problem, group: Group) -> form.Group:
    keys = vars(group)
    if len(group.names) == 1:
        keys = {key: value for key, value in keys.items() if not key.startswith("differs")}
    else:
        keys = keys | {"decided_by": problem.effects[group.members[0]].separated_by}
    return form.Group.model_validate(keys)


def effect_entries(problem: Problem, judgement: Judgement) -> list[form.NamedEffect]:
    """Return every effect that the readings can show: those of the answer first, then the most probable.

    What may stand in place of an effect of the answer has the values that it has beside the others of the answer.
    """
    answer, posterior = judgement.answer, judgement.posterior
    groups = () if answer is None else answer.groups
    leading = {group.members[0] for group in groups}
    found = {
        name: _of_set(judgement, frozenset({name})).get(name) or found_in(one, one.log_bayes_factor)[name]
        for name, one in posterior.singles.items()
    }
    if answer is not None:
        own = effects_of(answer.winner)
        for group in groups:
            for name in group.names[1:]:
                beside = _of_set(judgement, own - {group.members[0]} | {name})
                found[name] = beside.get(name, found[name])
        found |= found_in(answer.fit, answer.posterior.evidence[own])
    reported = [_effect(problem, one, posterior.holding([name])) for name, one in found.items()]
    return sorted(reported, key=lambda effect: (effect.name not in leading, -effect.probability))


def _of_set(judgement: Judgement, effects: frozenset[str]) -> dict[str, Found]:
    """Return the effects of a set as they were fitted there, or to first order; none where neither was."""
    answer, posterior = judgement.answer, judgement.posterior
    fit = None if answer is None else answer.refits.get(effects)
    if fit is not None:
        return found_in(fit, posterior.evidence.get(effects, fit.log_bayes_factor))
    judged = posterior.sets.get(effects)
    return {} if judged is None else found_in(judged, judged.log_bayes_factor)


def _effect(problem: Problem, one: Found, chance: float) -> form.NamedEffect:
    effect, change = problem.effect_of(one.part), one.part.columns @ one.amounts
    return form.NamedEffect(
        name=one.part.name,
        family=effect.family,
        probability=chance,
        log_bayes_factor=float(one.log_bayes_factor),
        snr=float(np.linalg.norm(problem.covariance.whiten(change))),
        amounts=value_entries(effect.parameters, one),
        shape=dict(one.part.shape),
        in_range=one.part.binary or effect.in_range(one.amounts),
        refitted=one.refitted,
    )


def value_entries(parameters: Sequence[Parameter], one: Found) -> list[form.Amount]:
    """Return the values of an effect with their 90 % intervals."""
    sd = np.sqrt(np.maximum(np.diag(one.spread), 0.0))
    return [
        form.Amount(name=p.name, unit=p.unit, value=float(a), interval_90=interval(p, float(a), float(s)))
        for p, a, s in zip(parameters, one.amounts, sd)
    ]


def interval(parameter: Parameter, a: float, sd: float) -> tuple[float, float]:
    """Return the 90 % interval of a value, within its physical range."""
    low, high = parameter.bounds
    low, high = (0.0 if parameter.sign > 0 else low), (0.0 if parameter.sign < 0 else high)
    return tuple(np.clip([a - NINETY * sd, a + NINETY * sd], low, high).tolist())
