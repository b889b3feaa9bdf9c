"""Whether a network's total force agrees with that of inverse elasticity, which no image has taught."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Totals that agree are not marked (tests/learning/test_elasticity.py):
FLOOR_N = 0.1  # added to the force of which a difference is a share: an even pressure hardly moves the gel
# Of known rows that agree: of other rows with the same scatter fewer than 1 % are marked, totals 1.5 times too large all
# (tests/learning/test_elasticity.py).
QUANTILE = 0.995
# Of known rows, below which nothing is checked: 50 give no check (tests/learning/test_elasticity.py).
LEAST_ROWS = 60


@dataclass(frozen=True)
class Check:
    """The gain that brings the inverse's totals to a network's, and the largest share by which the two may differ."""

    gain: np.ndarray  # (3,) by axis
    share: float

    def disagreement(self, total: np.ndarray, inverse_total: np.ndarray) -> np.ndarray:
        """Return how far a network's totals (n, 3) [N] are from the inverse's (n,), over the share: beyond 1 is marked."""
        return differences(total, self.gain * inverse_total) / self.share


def differences(total: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the lengths (n,) of the differences of totals (n, 3) [N], over the longer one and FLOOR_N."""
    longer = np.maximum(np.linalg.norm(total, axis=1), np.linalg.norm(other, axis=1))
    return np.linalg.norm(total - other, axis=1) / (longer + FLOOR_N)


def find_check(total: np.ndarray, inverse_total: np.ndarray) -> Check | None:
    """Return the gain, least squares of Fz, and share of rows whose totals (n, 3) are a network's and the inverse's.

    None for few rows, or where either has no force.
    """
    push = total[:, 2] @ inverse_total[:, 2]
    if len(total) < LEAST_ROWS or not push > 0:
        return None
    gain = np.full(3, push / (inverse_total[:, 2] @ inverse_total[:, 2]))
    return Check(gain, float(np.quantile(differences(total, gain * inverse_total), QUANTILE)))
