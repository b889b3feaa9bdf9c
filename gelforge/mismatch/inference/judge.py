"""The judge: is there a mismatch, where, which physics was left out, does it hold on data not seen, what else remains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config.parts.mismatch import Mismatch
from gelforge.mismatch.evidence.alternatives import NOTHING, UNKNOWN
from gelforge.mismatch.evidence.screen import Screened
from gelforge.mismatch.goodness.residual_tests import ResidualTests, residual_tests
from gelforge.mismatch.inference.answer import Answer, explained
from gelforge.mismatch.inference.discrepancy import Modelled, modelled
from gelforge.mismatch.inference.posterior import Posterior, posterior_of
from gelforge.mismatch.result.verdict import ALARM_P, LEFT_P
from gelforge.mismatch.terms.holdout import Blocks, split
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted
from gelforge.mismatch.terms.unknown import Kernel, kernels_of
from gelforge.mismatch.terms.weighing import chance_of_known
from gelforge.mismatch.thresholds import DETECTED_SNR, LIKELY, MOST_EFFECTS, NOTHING_P
from gelforge.progress import stage


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
    blocks, every = split(labels, seed), np.ones(len(labels), bool)
    kernels = kernels_of(problem)
    stage("size and place of the mismatch")
    mismatch = residual_tests(problem, problem.residual, every, settings, rng)
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
    answer, notes = explained(problem, posterior, kernels, blocks, settings, rng)
    found = posterior if answer is None else answer.posterior
    out = answer is not None and not in_range(problem, answer.fit)
    model = None
    if blocks.held_out.any() and (answer is None or out or _wanting(answer)):
        stage("a model of what no known effect explains")
        model = _modelled(problem, kernels, blocks, None if out else answer, found.causes)
        answer = answer if out else _beside_cause(problem, answer, model)
    return Judgement(_state(answer, out, model), blocks, mismatch, found, answer, model, tuple(notes), out)


def _alarm(mismatch: ResidualTests, posterior: Posterior) -> bool:
    """Return whether there is a mismatch: chi-square or scan are clear, or a test at ALARM_P and the posterior agree."""
    if min(mismatch.test.p, mismatch.scan.p) < LEFT_P:
        return True
    return mismatch.p < ALARM_P and posterior.probability[NOTHING] < NOTHING_P


def _modelled(
    problem: Problem,
    kernels: Sequence[Kernel],
    blocks: Blocks,
    answer: Answer | None,
    chances: Mapping[str, float],
) -> Modelled | None:
    """Return what is modelled with a free form, where it predicts: beside the sure effects, if they lead.

    An effect that changes the readings by less than what is modelled beside it is no form of what is missing; beside a cause
    of its own it is another one. One that is a form of that cause is not beside it. chances: of the kernels.
    """
    model = modelled(problem, kernels, blocks, chances=chances)
    if answer is not None and answer.sure and not _of_one_cause(model, answer):
        left = problem.observations.flat(problem.observations.force - answer.after)
        beside = modelled(problem, kernels, blocks, answer.fit, left, chances)
        both = problem.covariance.whiten(np.column_stack([beside.change, problem.residual - left]))
        more, own = np.linalg.norm(both, axis=0)
        if more < own or beside.sure:
            model = beside
    return model if model.gain.clear else None


def _of_one_cause(model: Modelled, answer: Answer) -> bool:
    """Return whether all that an answer claims may be the cause that is modelled, in another form."""
    return all(set(model.form_of) & {*group.names} for group in answer.sure)


def _beside_cause(problem: Problem, answer: Answer | None, model: Modelled | None) -> Answer | None:
    """Return an answer whose effects have the amounts that they have beside a cause that is sure, if these are physical."""
    if answer is None or model is None or not (model.sure and model.beside):
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
    return all(
        part.binary or problem.effects[part.name].in_range(amounts)
        for part, amounts in zip(fit.parts, fit.amounts)
    )


def _wanting(answer: Answer) -> bool:
    """Return whether an answer leaves more than noise, or a discrepancy is likely beside it or instead."""
    return answer.adequacy.p <= LEFT_P or answer.posterior.holding([UNKNOWN]) > LIKELY


def _state(answer: Answer | None, out: bool, model: Modelled | None) -> str:
    """Return the state of a mismatch that is there.

    Identified is an effect, or effects of one line, or a cause with a free form, as probable as a claim has to be. A
    discrepancy without a known cause is unexplained, modelled or not, unless a sure effect stands beside it.
    """
    if model is not None and model.sure:
        return "identified"
    if answer is None or out:
        return "unexplained"
    adequate = answer.adequacy.p > LEFT_P or (model is not None and model.beside)
    if answer.sure and adequate and (model is None or model.beside):
        return "identified"
    if model is not None or not adequate or answer.posterior.holding([UNKNOWN]) > LIKELY:
        return "unexplained"
    leading = max(answer.groups, key=lambda group: group.set_probability)
    return "ambiguous" if len(leading.names) <= MOST_EFFECTS else "inconclusive"
