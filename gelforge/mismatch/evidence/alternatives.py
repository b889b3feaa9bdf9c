"""How probable sets of effects are before the readings, and how much their evidence counts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import gammaln, logsumexp

from gelforge.mismatch.evidence.screen import Screened
from gelforge.mismatch.thresholds import NULL_PRIOR

NOTHING: frozenset[str] = frozenset()
UNKNOWN = "unknown"  # what no known effect explains: as likely, before the readings, as any one of them


def log_prior(effects: int, known: int) -> float:
    """Return the log prior of one answer of so many effects out of those known.

    Each is left out by itself and all as likely, such that none is with NULL_PRIOR: their number has Poisson's law, and
    the answers of one number share its probability.
    """
    mean = -np.log(NULL_PRIOR)
    count = gammaln(known + 1) - gammaln(effects + 1) - gammaln(known - effects + 1)
    return float(np.log(NULL_PRIOR) + effects * np.log(mean) - gammaln(effects + 1) - count)


def effects_of(answer: Screened) -> frozenset[str]:
    """Return the names of the effects in an answer, whatever their order."""
    return frozenset(part.name for part in answer.parts)


def normalised(log_weights: Mapping) -> dict:
    """Return weights given by their logarithms as probabilities."""
    total = logsumexp(list(log_weights.values()))
    return {name: float(np.exp(value - total)) for name, value in log_weights.items()}
