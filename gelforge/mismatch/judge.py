"""The judge: is there a mismatch, where, which physics was left out, does it hold on data not seen, what else remains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.config.mismatch import Mismatch
from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.alternatives import UNKNOWN, probabilities
from gelforge.mismatch.final import fitted_to_all
from gelforge.mismatch.groups import LIKELY, claimed
from gelforge.mismatch.holdout import Blocks, split
from gelforge.mismatch.identifiability import DETECTED_SNR, Group
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import Refitted
from gelforge.mismatch.remains import Remains, remains
from gelforge.mismatch.screen import Screened
from gelforge.mismatch.search import CERTAIN_P, Answer, Terms, explained
from gelforge.mismatch.unknown import manners_of, weighed_unknown
from gelforge.mismatch.verdict import ALARM_P, LEFT_P, NAMED_ODDS, NAMED_PROBABILITY
from gelforge.mismatch.weighing import chance_of_known, those_felt, weighed


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
    out_of_range: bool = False  # an amount of the answer is not physical, or on its bounds

    @property
    def told(self) -> tuple[Group, ...]:
        """Return the groups that a verdict tells: those that are claimed, all as hints where it is open, else none."""
        if self.answer is None or self.state in ("null", "insufficient"):
            return ()
        return self.answer.groups if self.state == "open" else claimed(self.answer.groups)

    @property
    def unnamed(self) -> tuple[Group, ...]:
        """Return the groups that an answer holds beside those that it claims: something is there, and nothing is sure."""
        return tuple(group for group in self.answer.groups if group not in self.told) if self.told else ()

    @property
    def refuted(self) -> bool:
        """Return whether something is certainly there and the readings set aside speak against the best answer to it."""
        return self.answer is not None and _refuted(self.mismatch, self.answer)

    @property
    def strange(self) -> bool:
        """Return whether something that no known effect is, alone or beside the answer, is likelier than not."""
        return self.answer is not None and self.answer.alternatives.holding([UNKNOWN]) > LIKELY


def judge(problem: Problem, settings: Mismatch, seed: int, turn: int = 0) -> Judgement:
    """Return the judgement on a problem.

    Whether there is a mismatch, and where, is asked of all readings; what could explain it, and by how much, of the training
    readings; among the last few those set aside help to choose. What has passed is fitted to all readings for its amounts.
    """
    labels, rng = problem.labels, np.random.default_rng([seed, 5])
    blocks = split(labels, seed, turn)
    everything = np.ones(len(labels), bool)
    manners = manners_of(problem)
    unknown = weighed_unknown(problem, manners)
    mismatch = remains(problem, problem.residual, everything, settings, rng)
    mismatch = replace(mismatch, unknown_p=unknown.p, known_p=chance_of_known(problem))
    singles = weighed(problem, blocks.train, problem.candidates)
    felt = those_felt(singles)
    probability = probabilities(felt)
    if mismatch.p >= ALARM_P:
        physics = [one for one in felt if not problem.effects[one.name].blunder]
        state = "null" if _could_have_seen(physics) else "insufficient"
        return Judgement(state, blocks, mismatch, tuple(singles), probability, None, ())
    answer, notes = explained(problem, Terms(blocks, settings, rng, len(felt), manners, unknown))
    state = _state(problem, mismatch, answer)
    if state in ("named", "group"):
        answer = _final(answer, notes)
    out = answer is not None and not in_range(problem, answer.fit)
    return Judgement(state, blocks, mismatch, tuple(singles), probability, answer, tuple(notes), out)


def _final(answer: Answer, notes: list[str]) -> Answer:
    """Return a confirmed answer with its amounts by all readings; where that fails by the training readings, with a note."""
    try:
        final = fitted_to_all(answer.problem, answer.winner, answer.fit)
    except (NotConverged, ConfigError) as failure:
        reason = f"could not be solved: {failure}"
    else:
        if final.fit.converged and in_range(answer.problem, final.fit):
            return replace(answer, final=final)
        reason = "was still moving" if not final.fit.converged else "left the physical range"
    name = answer.fit.name.replace("_", " ")
    notes.append(f"amounts are those of the training readings: the fit of {name} to all readings {reason}")
    return answer


def _could_have_seen(singles: Sequence[Screened]) -> bool:
    """Return whether a plausible amount of at least half of the effects that these readings feel would have shown."""
    snr = np.array([judged.plausible_snr for judged in singles])
    return bool(len(snr) and np.mean(snr >= DETECTED_SNR) >= 0.5)


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

    Where the mismatch is certain and the readings set aside refute the best answer, something unknown is there, and so it is
    where they refuted one effect and none of several is sure, or where something unknown is as sure as a name has to be, or
    likelier than not while no name is. What rests on a refit that has not converged is not named: its amounts and evidence
    are not final. A group that is less likely than not says nothing; beside what is sure it is left out.
    """
    if answer is None or answer.adequacy.p <= LEFT_P or not in_range(problem, answer.fit):
        return "open"
    if _refuted(mismatch, answer):
        return "open"
    unknown = answer.alternatives.holding([UNKNOWN])
    strange = unknown > LIKELY or answer.after_refuted
    unsure = "open" if mismatch.p < CERTAIN_P and strange else "insufficient"
    if answer.gain is None or not answer.gain.clear or unknown >= NAMED_PROBABILITY:
        return unsure
    groups = claimed(answer.groups)
    sure = all(
        group.probability >= NAMED_PROBABILITY and (len(group.members) == 1 or group.odds >= NAMED_ODDS)
        for group in groups
    )
    if sure and answer.fit.converged:
        return "named"
    if unknown > LIKELY and not all(group.probability >= NAMED_PROBABILITY for group in groups):
        return unsure
    likely = all(group.probability >= LIKELY for group in groups)
    return "group" if likely and any(len(group.members) > 1 for group in groups) else unsure
