"""The judge: is there a mismatch, where, which physics was left out, does it hold on data not seen, what else remains.

The answer of a posterior is its most probable set, fitted, and the credible set of each of its effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.config.parts.mismatch import Mismatch
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.gaussian import NOTHING, UNKNOWN
from gelforge.mismatch.evidence.kernels import Kernel, kernels_of
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.refit import Refitted, refitted
from gelforge.mismatch.evidence.screen import Screened
from gelforge.mismatch.inference.discrepancy import Modelled, modelled
from gelforge.mismatch.inference.fits import (
    at_few_sites,
    by_columns,
    fitted,
    placed,
    solved_or_linear,
    through_solutions,
)
from gelforge.mismatch.inference.holdout import Blocks, Proof, after_penalty, folds_of, proof_of, split
from gelforge.mismatch.inference.posterior import Effects, Posterior, chance_of_known, posterior_of
from gelforge.mismatch.inference.scan import ResidualTests, residual_tests
from gelforge.mismatch.result.scores import HeldOut
from gelforge.mismatch.result.verdict import Group
from gelforge.mismatch.thresholds import (
    ALARM_P,
    DETECTED_SNR,
    LEFT_P,
    MOST_EFFECTS,
    NEGLIGIBLE,
    NOTHING_P,
    SURE,
)
from gelforge.progress import stage


@dataclass(frozen=True, eq=False)
class Answer:
    """Effects that were put into the base, and what speaks for them."""

    fit: Refitted  # of the most probable set to all readings, its values with their plausible widths
    refits: Mapping[Effects, Refitted]
    groups: tuple[Group, ...]  # one per effect of the fit
    after: np.ndarray  # (R, 3) [N] forces with the effects
    adequacy: ResidualTests  # of all readings
    proof: Proof | None  # on held-out readings; None where there are none
    folds: Sequence[HeldOut]  # of few sites, each held out in turn

    @property
    def sure(self) -> tuple[Group, ...]:
        """Return the groups that are claimed."""
        return tuple(group for group in self.groups if group.probability >= SURE)


def explained(
    problem: Problem,
    posterior: Posterior,
    kernels: Sequence[Kernel],
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
) -> tuple[Answer | None, Posterior, list[str]]:
    """Return the answer to a mismatch, the posterior about it, and what went wrong on the way.

    Where no effect could be fitted there is no answer, and the posterior stays as it is.
    """
    before = posterior
    if max((posterior.holding([name]) for name in posterior.singles), default=0.0) < NEGLIGIBLE:
        problem = problem.linearised()
    elif posterior.holding([UNKNOWN]) >= SURE:
        # Softening explains nothing by itself then: to follow all indentations in order takes minutes and decides nothing.
        problem = problem.with_linear_history()
    relinearised, note = placed(problem, at_few_sites(problem))
    if relinearised is not problem:
        problem, posterior = relinearised, posterior_of(relinearised, kernels)
    real = at_few_sites(problem)
    fits = fitted(real, posterior, lambda relinearised: posterior_of(relinearised, kernels))
    notes, mode = [*fits.notes, *([note] if note else [])], fits.mode
    if mode is None:
        return None, before, notes
    problem, posterior = fits.problem, fits.posterior
    stage("values of the answer at their plausible widths")
    fit, note = _at_prior_sd(real, problem, posterior.sets[mode], fits.fits[mode])
    after, unsolved = solved_or_linear(problem, fit.terms)
    notes += [one for one in (note, unsolved) if one]
    left = problem.observations.flat(problem.observations.force - after)
    uncertain = problem.with_model_error(fit.terms)
    stage("the answer on held-out readings, and what it leaves")
    proof = proof_of(problem, fit, left, blocks) if blocks.held_out.any() else None
    if proof is not None:
        proof = after_penalty(proof, problem, posterior, blocks.train)
    return (
        Answer(
            fit=averaged(posterior, mode, fit),
            refits=fits.fits,
            groups=groups_of(problem, posterior, fit),
            after=after,
            adequacy=residual_tests(uncertain, left, settings.draws, rng, fit.columns),
            proof=proof,
            folds=folds_of(problem, fit, left),
        ),
        posterior,
        notes,
    )


def _at_prior_sd(
    problem: Problem, relinearised: Problem, start: Screened, fit: Refitted
) -> tuple[Refitted, str]:
    """Return a fit once more with the priors' own widths, and why that could not be had.

    A fit has the scale of plausible values that had most evidence; once its effects are known that scale has no say. What
    has a place goes on to where the real model fits best, unless it was placed before (`placed`): between places that were
    tried its columns are but interpolated.
    """
    parts = tuple(replace(part, prior_sd=relinearised.tried(part).prior_sd) for part in fit.parts)
    again = replace(start, parts=parts, theta=np.concatenate(fit.theta))
    try:
        if any(part.moved_from is not None and relinearised.tried(part).moved_from is None for part in parts):
            every = np.ones(len(problem.labels), bool)
            return refitted(
                replace(relinearised, forces_with=problem.with_linear_history().forces_with),
                again,
                every,
                placing=True,
            ), ""
        if problem.path_dependent(parts):
            return by_columns(relinearised, again), ""
        return through_solutions(problem, relinearised, again)[0], ""
    except (NotConverged, ConfigError) as failure:
        return (
            fit,
            f"parameter values have the prior scale of most evidence: with plausible standard deviations {failure}",
        )


def averaged(posterior: Posterior, mode: Effects, fit: Refitted) -> Refitted:
    """Return a fit whose covariance holds what other sets with the same effects say of their values.

    The values stay those of the fit, which the study takes over. Where a place was fitted nothing is added.
    """
    spread, at = fit.spread.copy(), 0
    values = {effects: one.by_name for effects, one in posterior.sets.items()}
    for part, theta in fit.terms:
        rows = slice(at, at + len(theta))
        at += len(theta)
        if not (part.binary or part.moved_from is not None):
            others = [effects for effects in posterior.sets if part.name in effects]
            chance = np.array([posterior.probability[effects] for effects in others])[:, None]
            steps = np.array([values[one][part.name] - values[mode][part.name] for one in others])
            spread[rows, rows] += steps.T @ (chance * steps) / max(chance.sum(), np.finfo(float).tiny)
    return replace(fit, spread=spread)


def groups_of(problem: Problem, posterior: Posterior, fit: Refitted) -> tuple[Group, ...]:
    """Return the credible set of each fitted effect, the most probable first."""
    effects, groups = frozenset(part.name for part in fit.parts), []
    for one in posterior.credible_sets(effects):
        first, *others = one.names
        differs = [_difference(problem, posterior, effects, first, other) for other in others]
        if differs:
            snr, size = np.max(differs, axis=0).tolist()
            words = problem.effects[first].separated_by
            one = one.model_copy(update={"differs_snr": snr, "differs_N": size, "decided_by": words})
        groups.append(one)
    return tuple(groups)


def _difference(
    problem: Problem, posterior: Posterior, effects: Effects, name: str, other: str
) -> tuple[float, float]:
    """Return by how much readings differ between an answer and the same with another effect in place of one of it.

    Signal over noise, and root mean square [N], by linear changes. Sets that were not weighed are compared alone.
    """
    leading, rival = posterior.sets.get(effects), posterior.sets.get(effects - {name} | {other})
    if leading is None or rival is None:
        leading, rival = posterior.singles[name], posterior.singles[other]
    difference = leading.change - rival.change
    return (
        float(np.linalg.norm(problem.covariance.whiten(difference))),
        float(np.sqrt(np.mean(difference[problem.of_force] ** 2))),
    )


@dataclass(frozen=True, eq=False)
class Judgement:
    """All that was found, before it is put into words."""

    state: str  # as in verdict.json
    blocks: Blocks
    mismatch: ResidualTests
    posterior: Posterior
    answer: Answer | None
    model: Modelled | None  # of what no known effect explains, where it predicts; with a cause or without
    notes: tuple[str, ...]  # what went wrong on the way
    out_of_range: bool = False  # a value of the answer is not physical, or on its bounds

    @property
    def explained(self) -> bool:
        """Return whether a known cause is put into the nominal model."""
        free = self.model is not None and self.model.sure
        return free or (self.answer is not None and not self.out_of_range)

    @property
    def answered(self) -> Answer:
        """The answer, of a state that has one. Raises ValueError for another."""
        if self.answer is None:
            raise ValueError(f"a judgement that is {self.state} has no answer")
        return self.answer


def judge(problem: Problem, settings: Mismatch, seed: int) -> Judgement:
    """Return the judgement on a problem.

    All readings say whether there is a mismatch, where, and what could explain it; the values of the answer by the
    training readings alone predict those held out.
    """
    labels, rng = problem.labels, np.random.default_rng([seed, 5])
    blocks = split(labels, seed)
    kernels = kernels_of(problem)
    stage("size and place of the mismatch")
    mismatch = residual_tests(problem, problem.residual, settings.draws, rng)
    stage("evidence of sets of effects")
    posterior = posterior_of(problem, kernels)
    unknown = posterior.unknown[NOTHING]
    mismatch = replace(mismatch, unknown_p=unknown.p, known_p=chance_of_known(problem))
    if not _alarm(mismatch, posterior):
        physics = [
            one for one in posterior.singles.values() if not problem.effects[one.name].data_entry_error
        ]
        state = "consistent" if _could_have_seen(physics) else "inconclusive"
        return Judgement(state, blocks, mismatch, posterior, None, None, ())
    answer, posterior, notes = explained(problem, posterior, kernels, blocks, settings, rng)
    out = answer is not None and not in_range(problem, answer.fit)
    model = None
    if blocks.held_out.any() and (answer is None or out or _wanting(posterior, answer)):
        stage("a model of what no known effect explains")
        model = _modelled(problem, kernels, blocks, None if out else answer, posterior.causes)
        answer = answer if out else _next_to_cause(problem, answer, model)
    state = _state(posterior, answer, out, model)
    return Judgement(state, blocks, mismatch, posterior, answer, model, tuple(notes), out)


def _alarm(mismatch: ResidualTests, posterior: Posterior) -> bool:
    """Return whether there is a mismatch: chi-square is clear, or a test at ALARM_P and the posterior agree."""
    if mismatch.test.p < LEFT_P:
        return True
    return mismatch.p < ALARM_P and posterior.probability[NOTHING] < NOTHING_P


def _modelled(
    problem: Problem,
    kernels: Sequence[Kernel],
    blocks: Blocks,
    answer: Answer | None,
    chances: Mapping[str, float],
) -> Modelled | None:
    """Return what is modelled with a free form, where it predicts: next to the sure effects, if they lead.

    An effect that changes the readings by less than what is modelled with it is no form of what is missing; next to a cause
    of its own it is another one. One that is a form of that cause is not next to it. chances: of the kernels.
    """
    model = modelled(problem, kernels, blocks, chances=chances)
    if answer is not None and answer.sure and not _of_one_cause(model, answer):
        left = problem.observations.flat(problem.observations.force - answer.after)
        joint = modelled(problem, kernels, blocks, answer.fit, left, chances)
        both = problem.covariance.whiten(np.column_stack([joint.change, problem.residual - left]))
        more, explained = np.linalg.norm(both, axis=0)
        if more < explained or joint.sure:
            model = joint
    return model if model.held.shown else None


def _of_one_cause(model: Modelled, answer: Answer) -> bool:
    """Return whether all that an answer claims may be the cause that is modelled, in another form."""
    return all(set(model.kernel.form_of) & {*group.names} for group in answer.sure)


def _next_to_cause(problem: Problem, answer: Answer | None, model: Modelled | None) -> Answer | None:
    """Return an answer whose effects have the values that they have next to a cause that is sure, if these are physical."""
    if answer is None or model is None or not (model.sure and model.with_effects):
        return answer
    if model.fit is None or not in_range(problem, model.fit):
        return answer
    observations, after = problem.observations, answer.after.copy()
    after[observations.read] = observations.flat(observations.force) - model.rest - model.change
    return replace(answer, fit=model.fit, after=after)


def _could_have_seen(singles: Sequence[Screened]) -> bool:
    """Return whether a plausible value of at least half of the effects that these readings can show would have shown."""
    snr = np.array([judged.plausible_snr for judged in singles])
    return bool(len(snr) and np.mean(snr >= DETECTED_SNR) >= 0.5)


def in_range(problem: Problem, fit: Refitted) -> bool:
    """Return whether all values are physical and off their bounds."""
    return all(part.binary or problem.effects[part.name].in_range(a) for part, a in fit.terms)


def _wanting(posterior: Posterior, answer: Answer) -> bool:
    """Return whether an answer leaves more than noise, or a discrepancy is more probable than not."""
    return answer.adequacy.p <= LEFT_P or posterior.holding([UNKNOWN]) > 0.5


def _state(posterior: Posterior, answer: Answer | None, out: bool, model: Modelled | None) -> str:
    """Return the state of a mismatch that is there.

    Identified is an effect, or effects of one line, or a cause with a free form, as probable as a claim has to be. A
    discrepancy without a known cause is unexplained, modelled or not, unless a sure effect stands next to it.
    """
    if model is not None and model.sure:
        return "identified"
    if answer is None or out:
        return "unexplained"
    adequate = answer.adequacy.p > LEFT_P or (model is not None and model.with_effects)
    if answer.sure and adequate and (model is None or model.with_effects):
        return "identified"
    if model is not None or not adequate or posterior.holding([UNKNOWN]) > 0.5:
        return "unexplained"
    leading = max(answer.groups, key=lambda group: group.chance)
    return "ambiguous" if len(leading.names) <= MOST_EFFECTS else "inconclusive"
