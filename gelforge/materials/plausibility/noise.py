"""How far the rows of a curve scatter, and by which steps its channel counts."""

from __future__ import annotations

import numpy as np


def row_noise(values: np.ndarray) -> float:
    """Return the standard deviation of one row about the line through its neighbours (robust), 0 for few rows."""
    if len(values) < 5:
        return 0.0
    return float(1.4826 * np.median(np.abs(values[1:-1] - (values[:-2] + values[2:]) / 2)) / np.sqrt(1.5))


def channel_step(values: np.ndarray) -> float:
    """Return the smallest change from row to row of a channel so coarse that rows repeat, 0 where none does."""
    changes = np.abs(np.diff(values))
    return float(changes[changes > 0].min(initial=np.inf)) if 0 < (changes == 0).sum() < len(changes) else 0.0
