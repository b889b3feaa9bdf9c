"""Where the flow of image regions stands among the readings and the entries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.mismatch.readings.observations import Observations


@dataclass(frozen=True, eq=False)
class Rows:
    """Where the flow stands among the readings and the entries."""

    observations: Observations
    entries: int  # of force
    shown: np.ndarray  # (F, m) bool

    def flat(self, flow: np.ndarray) -> np.ndarray:
        """Return the entries of a quantity (F, m, 2, ...): regions that show the gel, u and v in turn."""
        return flow[self.shown].reshape(-1, *flow.shape[3:])

    def as_readings(self, flow: np.ndarray) -> np.ndarray:
        """Return the rows (F m, 3) of a flow (F, m, 2), nothing in the place of Fz."""
        rows = np.where(self.shown[..., None], flow, np.nan).reshape(-1, 2)
        return np.column_stack([rows, np.full(len(rows), np.nan)])
