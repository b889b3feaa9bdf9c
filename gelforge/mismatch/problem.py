"""What the judge works on: readings, what the base says of them, how sure both are, and how effects would change it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from gelforge.mismatch.covariance import Covariance
from gelforge.mismatch.effect import Effect
from gelforge.mismatch.observations import Observations
from gelforge.mismatch.screen import Candidate

# Forces (R, 3) [N] at readings (R,) bool with effects at amounts, nan elsewhere; raises NotConverged.
ForcesWith = Callable[[Sequence[Candidate], Sequence[np.ndarray], np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Problem:
    """A recording beside its base. Flat vectors have n entries: what was read of R readings x 3 axes."""

    observations: Observations
    base: np.ndarray  # (R, 3) [N]
    covariance: Covariance  # of n entries
    candidates: Sequence[Candidate]  # linear changes of the n entries
    effects: Mapping[str, Effect]
    forces_with: ForcesWith
    failed: Mapping[str, str]  # effects that could not be computed, and why
    first: frozenset[str] = frozenset()  # effects that put right what the base assumes and cannot be true
    flow: Any = None  # flow.FlowChannel where images are judged with the forces

    @property
    def labels(self) -> pd.DataFrame:
        return self.observations.labels()

    @property
    def residual(self) -> np.ndarray:
        """Return measured less base (n,)."""
        return self.observations.flat(self.observations.force - self.base)

    def part(self, mask: np.ndarray) -> tuple[np.ndarray, Covariance, list[Candidate]]:
        """Return residual, covariance and candidates of some entries (n,) bool."""
        return (
            self.residual[mask],
            self.covariance.restricted(mask),
            [candidate.restricted(mask) for candidate in self.candidates],
        )

    def readings_of(self, mask: np.ndarray) -> np.ndarray:
        """Return (R,) bool: the readings of which some entry (n,) bool is chosen."""
        chosen = np.zeros(len(self.observations.table), bool)
        chosen[self.labels["reading"].to_numpy()[mask]] = True
        return chosen

    def without(self, names: Sequence[str]) -> Problem:
        """Return the problem without some effects."""
        return replace(self, candidates=[c for c in self.candidates if c.name not in names])
