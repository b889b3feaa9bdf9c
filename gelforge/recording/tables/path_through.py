"""The way of an indenter through readings: from the first touch, in steps small enough for materials that remember."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

# Time runs on between two readings that share a stamp: the period of 1000 readings a second. Stamps that are kept are
# those of tests/dataset/test_session_labels.py.
LEAST_STEP_S = 1e-3


@dataclass(frozen=True)
class PathThrough:
    """Depths [mm], times [s] and phases of every step, and which step each reading is."""

    depths_mm: tuple[float, ...]
    times_s: tuple[float, ...]
    phases: tuple[str, ...]
    readings: tuple[int, ...]


def path_through(depths_mm: Sequence[float], times_s: Sequence[float], step_mm: float) -> PathThrough:
    """Return the even way of the indenter from depth 0 at time 0 through readings.

    Parameters
    ----------
    depths_mm : sequence of float
        n depths.
    times_s : sequence of float
        n times; equal ones are put LEAST_STEP_S apart.
    step_mm : float
        Longest step.

    Returns
    -------
    PathThrough
        Depth [mm], time [s] and phase of each step, and the steps of the readings.
    """
    steps: list[tuple[float, float, str]] = []
    readings = []
    depth, time = 0.0, 0.0
    for to, at in zip(depths_mm, times_s):
        at = max(at, time + LEAST_STEP_S)
        count = max(1, math.ceil(abs(to - depth) / step_mm - 1e-9))
        phase = "load" if to > depth else "unload" if to < depth else "dwell"
        for k in range(1, count + 1):
            share = k / count
            steps.append((float(depth + share * (to - depth)), float(time + share * (at - time)), phase))
        readings.append(len(steps) - 1)
        depth, time = to, at
    depths, times, phases = zip(*steps)
    return PathThrough(depths, times, phases, tuple(readings))
