"""The effects of a verdict: groups of the answer, every effect that was tried, with probability and amounts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from gelforge.mismatch import verdict as form
from gelforge.mismatch.alternatives import NOTHING, UNKNOWN, effects_of
from gelforge.mismatch.effect import Parameter
from gelforge.mismatch.identifiability import Group, profile
from gelforge.mismatch.judge import Judgement
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import End, Refitted
from gelforge.mismatch.screen import Screened
from gelforge.mismatch.search import Answer
from gelforge.mismatch.weighing import unmasked

NINETY = float(norm.ppf(0.95))
PROFILE_SD, PROFILE_POINTS = 4.0, 33


def groups_told(problem: Problem, groups: Sequence[Group]) -> list[form.Group]:
    """Return groups of an answer as they stand in a verdict."""
    found = []
    for group in groups:
        cosines = [abs(c) for name, c in group.cosines.items() if name != group.members[0]]
        first = problem.effects[group.members[0]]
        found.append(
            form.Group(
                members=list(group.members),
                probability=group.probability,
                odds=min(group.odds, 1e12) if len(group.members) > 1 else None,
                cosine=min(max(cosines), 1.0) if cosines else None,
                decided_by=first.separated_by if len(group.members) > 1 else "",
            )
        )
    return found


def of_nothing(judgement: Judgement) -> float:
    """Return the probability that nothing is missing: by what the search found, or by the screen where none was made."""
    if judgement.state in ("named", "group", "open"):
        return 0.0
    if judgement.answer is None:
        return judgement.probability["null"]
    return judgement.answer.alternatives.probability[NOTHING]


def unknown_told(judgement: Judgement) -> form.Unknown | None:
    """Return what something unknown has for it; None where no effect was looked for."""
    answer = judgement.answer
    if answer is None:
        return None
    return form.Unknown(probability=answer.alternatives.holding([UNKNOWN]), words=answer.stranger)


def effects_told(problem: Problem, judgement: Judgement) -> list[form.NamedEffect]:
    """Return every effect that was tried: those of the answer first, then the most probable.

    How probable others are is told without what adds them to the answer: that was within the reach of what the answer's own
    error may leave, and is not claimed.
    """
    answer = judgement.answer
    found: dict[str, form.NamedEffect] = {}
    if answer is not None:
        claimed = answer.alternatives.without_more_than(effects_of(answer.winner))
        for part, amounts, group, spread in zip(
            answer.final.fit.parts, answer.final.fit.amounts, answer.groups, _blocks(answer.final.fit)
        ):
            found[part.name] = _effect(
                problem, part.name, dict(part.shape), amounts, spread,
                answer.alternatives.holding([part.name]), answer.winner.log_bayes_factor,
                answer.winner.snr, True, list(group.members), part.switch,
                _by_instrument(problem, answer.winner),
            )  # fmt: skip
        if len(answer.fit.parts) == 1 and not answer.fit.parts[0].switch:
            name = answer.fit.parts[0].name
            found[name] = _profiled(problem, answer, found[name])
        names = [fit.parts[-1].name for fit in answer.refits if fit.end is not End.HOPELESS]
        if len(answer.fit.parts) == 1:
            for judged in answer.ranked[1:]:
                chance = claimed.holding([judged.name])
                found[judged.name] = _screened(problem, judged, chance, judged.name in names)
    for judged in judgement.singles:
        if judged.name not in found:
            known = judgement.probability.get(judged.name, 0.0)
            chance = known if answer is None else claimed.holding([judged.name])
            found[judged.name] = _screened(problem, judged, chance, False)
    rank = {name: k for k, name in enumerate(found)}
    first = {part.name for part in answer.fit.parts} if answer is not None else set()
    return sorted(found.values(), key=lambda e: (e.name not in first, -e.probability, rank[e.name]))


def _profiled(problem: Problem, answer: Answer, effect: form.NamedEffect) -> form.NamedEffect:
    """Return the answer's effect with the profiles of its amounts, to first order about the fit that is told."""
    fit, change = answer.final.fit, problem.observations.flat(answer.final.after - problem.base)
    covariance = problem.believing(fit.parts, fit.amounts[0]).covariance
    judged = replace(answer.winner, parts=fit.parts)
    # The model's own change at the fitted amounts
    offset = problem.residual - change + fit.parts[0].columns @ fit.amounts[0]
    amounts = []
    for k, (amount, sd) in enumerate(zip(effect.amounts, np.sqrt(np.diag(fit.covariance)))):
        grid = amount.value + sd * np.linspace(-PROFILE_SD, PROFILE_SD, PROFILE_POINTS)
        values = profile(offset, covariance, judged, k, grid)
        amounts.append(amount.model_copy(update={"profile": list(zip(grid.tolist(), values.tolist()))}))
    return effect.model_copy(update={"amounts": amounts})


def _blocks(fit: Refitted) -> list[np.ndarray]:
    """Return each part's own block of the amounts' covariance."""
    ends = np.cumsum([0, *(len(a) for a in fit.amounts)])
    return [fit.covariance[a:b, a:b] for a, b in zip(ends, ends[1:])]


def _by_instrument(problem: Problem, judged: Screened) -> float:
    """Return the signal over noise of a change of all readings with the instrument's noise alone."""
    columns = np.column_stack([part.columns for part in unmasked(problem, judged).parts])
    return float(np.linalg.norm(problem.covariance.instrument.whiten(columns @ judged.amounts)))


def _screened(problem: Problem, judged: Screened, chance: float, refitted: bool) -> form.NamedEffect:
    last = judged.parts[-1]
    p = last.columns.shape[1]
    return _effect(
        problem, last.name, dict(last.shape), judged.amounts[-p:], judged.covariance[-p:, -p:], chance,
        judged.log_bayes_factor, judged.snr, refitted, [], last.switch, _by_instrument(problem, judged),
    )  # fmt: skip


def _interval(parameter: Parameter, a: float, sd: float) -> tuple[float, float]:
    """Return the 90 % interval of an amount, within its physical range."""
    low, high = parameter.bounds
    low, high = (
        (max(low, 0.0) if parameter.sign > 0 else low),
        (min(high, 0.0) if parameter.sign < 0 else high),
    )
    return tuple(np.clip([a - NINETY * sd, a + NINETY * sd], low, high).tolist())


def _effect(
    problem, name, shape, amounts, spread, chance, factor, snr, refitted, group, switch, by_instrument
) -> form.NamedEffect:
    effect = problem.effects[name]
    sd = np.sqrt(np.maximum(np.diag(spread), 0.0))
    told = [
        form.Amount(
            name=p.name,
            unit=p.unit,
            value=float(a),
            interval_90=_interval(p, float(a), float(s)),
            bounds=p.bounds if np.isfinite(p.bounds).all() else None,
        )
        for p, a, s in zip(effect.parameters, amounts, sd)
    ]
    return form.NamedEffect(
        name=name,
        family=effect.family,
        probability=chance,
        log_bayes_factor=float(factor),
        snr=float(snr),
        snr_instrument=by_instrument,
        amounts=told,
        shape=shape,
        in_range=switch or effect.in_range(amounts),
        refitted=refitted,
        group=group if len(group) > 1 else [],
    )
