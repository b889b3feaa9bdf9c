"""Answers of no, one and several effects beside each other: how probable each is, and that an effect is in the true one."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln, logsumexp

from gelforge.mismatch.screen import Screened

NULL_PRIOR = 0.5  # as likely as not that a careful study has left nothing out
NOTHING = frozenset()
# Log odds between known answers count for this share: each has a form that is not quite the truth's, and so have the errors
# allowed for it. Of 135 claims of two opened concealed sets 0.4 makes the mean log score largest (-0.27; -0.40 at 1), and of
# those that it leaves above 0.9 79 of 81 are right (docs/mismatch-method.md, `python benchmarks/claims.py`).
WORTH = 0.4
UNKNOWN = "unknown"  # something that no known effect is: as likely, before the readings, as any one of them


def log_prior(effects: int, known: int) -> float:
    """Return the log prior of one answer of so many effects out of those known.

    Each is left out by itself and all as likely, such that none is with NULL_PRIOR: their number has Poisson's law, and
    the answers of one number share its probability.
    """
    mean = -np.log(NULL_PRIOR)
    count = gammaln(known + 1) - gammaln(effects + 1) - gammaln(known - effects + 1)
    return float(np.log(NULL_PRIOR) + effects * np.log(mean) - gammaln(effects + 1) - count)


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Answers by the effects in them, with their log evidence against none; those that were not tried count as refuted."""

    evidence: Mapping[frozenset[str], float]
    known: int  # effects that there are

    @cached_property
    def probability(self) -> dict[frozenset[str], float]:
        """Return the probability of every answer, and of nothing; they add up to 1.

        What all known answers have together they share by WORTH of their evidence; nothing, and something unknown, have no
        form that could be wrong.
        """
        weights = {effects: self.weight(effects, value) for effects, value in self.evidence.items()}
        known = [effects for effects in weights if UNKNOWN not in effects]
        shared = {effects: self.weight(effects, WORTH * self.evidence[effects]) for effects in known}
        if known:
            together = logsumexp([weights[effects] for effects in known]) - logsumexp([*shared.values()])
            weights |= {effects: value + together for effects, value in shared.items()}
        return normalised({NOTHING: self.weight(NOTHING, 0.0)} | weights)

    def weight(self, effects: Collection[str], evidence: float) -> float:
        """Return the log of prior times evidence, but for a common constant."""
        return evidence + log_prior(len(effects), max(self.known, len(effects)))

    def holding(self, names: Iterable[str]) -> float:
        """Return the probability that one of some effects at least is part of what is missing."""
        wanted = set(names)
        return float(min(sum(p for effects, p in self.probability.items() if effects & wanted), 1.0))

    def likelier_of(self, count: int, than: float) -> bool:
        """Return whether an answer of so many effects, or of something unknown, has a log weight above one."""
        return any(
            self.weight(e, value) > than
            for e, value in self.evidence.items()
            if len(e) == count or (UNKNOWN in e and len(e) < count)
        )

    def without_more_than(self, effects: Collection[str]) -> Alternatives:
        """Return these but for answers that hold all of some effects and another known one."""
        own = frozenset(effects)
        kept = {e: value for e, value in self.evidence.items() if not own < e - {UNKNOWN}}
        return Alternatives(kept, self.known)

    def joined(self, answers: Iterable[Screened]) -> Alternatives:
        """Return these and other answers, in place of the same ones."""
        return self.beside({effects_of(a): a.log_bayes_factor for a in answers})

    def beside(self, evidence: Mapping[frozenset[str], float]) -> Alternatives:
        """Return these and other answers by their log evidence, in place of the same ones."""
        return Alternatives({**self.evidence, **evidence}, self.known)


def effects_of(answer: Screened) -> frozenset[str]:
    """Return the names of the effects in an answer, whatever their order."""
    return frozenset(part.name for part in answer.parts)


def probabilities(answers: Collection[Screened]) -> dict[str, float]:
    """Return the probability of "null" and of each answer by name; they add up to 1. Known are the single ones."""
    known = sum(len(answer.parts) == 1 for answer in answers)
    found = Alternatives({}, known).joined(answers).probability
    return {"null": found[NOTHING]} | {answer.name: found[effects_of(answer)] for answer in answers}


def normalised(log_weights: Mapping) -> dict:
    """Return weights given by their logarithms as probabilities."""
    total = logsumexp(list(log_weights.values()))
    return {name: float(np.exp(value - total)) for name, value in log_weights.items()}
