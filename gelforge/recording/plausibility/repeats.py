"""Runs of readings that repeat one value to the last digit while the depth changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from gelforge.config import ForceSensor
from gelforge.recording.plausibility.findings import CHANCE, LEAST_PAIRS
from gelforge.recording.plausibility.indentations import force_over_depth, scatter_N

RAW = ["fx_raw_N", "fy_raw_N", "fz_raw_N"]

# Of 37 kinds of honest SYNTHETIC sessions each passes, and each seeded fault is found
# (tests/recording/test_plausibility.py):
SHORTEST = 3  # rows of a run whose force should change
# Rows of a run that is too even for the channel's own noise: so many of 400 come below CHANCE only where fewer than 6 % of
# neighbours are equal. A sideways axis that freezes is found (test_plausibility.py).
SHORTEST_OF_NOISE = 8
# Of the session's usual change between two depths: what any site shows of it. Sites of 0.4 to 1.6 times the usual
# stiffness pass with it (tests/recording/test_plausibility.py).
EXPECTED = 0.5
# Resolutions, and standard deviations, that the expected change must exceed: of normal noise one in 370 does. A channel
# with steps of 60 mN passes (test_plausibility.py).
STEPS = 3.0
# The same where so many indentations in turn show no change: a channel with steps of 60 mN that dies is found
# (test_plausibility.py).
STEPS_IN_TURN, IN_TURN = 1.5, 3
# So many rows of an indentation at one depth may belong to a run by chance, at its ends. Quiet channels pass, dead ones
# are found (tests/recording/test_plausibility.py).
CHANCE_ROWS = 2


@dataclass(frozen=True)
class Run:
    """Consecutive readings of one axis of one value."""

    axis: int
    value: float  # as recorded [N]
    rows: tuple[int, ...]


def repeats(readings: pd.DataFrame, indentations: pd.DataFrame, force: ForceSensor) -> list[Run]:
    """Return the runs of equal raw readings that resolution, noise and the expected change do not allow.

    A run has to reach over different depths. Of the axis that feels the indentation the expected change is the session's
    own; of the others (sideways at a central site nothing changes) a run is wrong only where the channel's noise shows
    elsewhere.
    """
    readings = readings.dropna(subset=RAW)
    if readings.empty:
        return []
    resolution = np.asarray(force.resolution_N, float)
    normal = int(np.abs(np.asarray(force.axes, float)[2]).argmax())
    usual = force_over_depth(indentations, STEPS * resolution[2])
    depth = readings["depth_mm"].fillna(0.0).clip(lower=0.0).to_numpy()
    expected = np.zeros(len(depth)) if usual is None else EXPECTED * usual.at(depth)
    hidden = resolution[normal] + scatter_N(readings, RAW)[normal]
    number = (readings["press"] != readings["press"].shift()).cumsum().to_numpy()
    runs = []
    for axis, name in enumerate(RAW):
        value = readings[name].to_numpy()
        starts = np.flatnonzero(np.concatenate([[True], np.diff(value) != 0]))
        ends = np.append(starts[1:], len(value))
        long = ends - starts >= SHORTEST
        too_even = _too_even(readings, value)
        for start, end in zip(starts[long], ends[long]):
            start, end = _without_chance(number, depth, start, end)
            if end - start < SHORTEST or np.ptp(depth[start:end]) == 0:
                continue
            steps = STEPS if number[end - 1] - number[start] + 1 < IN_TURN else STEPS_IN_TURN
            dead = axis == normal and np.ptp(expected[start:end]) > steps * hidden
            if dead or too_even(start, end):
                runs.append(Run(axis, float(value[start]), tuple(readings.index[start:end])))
    return runs


def _without_chance(number: np.ndarray, depth: np.ndarray, start: int, end: int) -> tuple[int, int]:
    """Return a run without the few rows at its ends that are of another indentation and at one depth."""
    inside = number[start:end]
    first, last = start + int((inside == inside[0]).sum()), end - int((inside == inside[-1]).sum())
    if first - start <= CHANCE_ROWS and first < end and np.ptp(depth[start:first]) == 0:
        start = first
    if end - last <= CHANCE_ROWS and last > start and np.ptp(depth[last:end]) == 0:
        end = last
    return start, end


def _too_even(readings: pd.DataFrame, value: np.ndarray) -> Callable[[int, int], bool]:
    """Return a function that says whether a channel's noise outside a run makes the run practically impossible.

    The chance of a run is share^(rows - 1), share: of neighbours at rest that are equal, before contact or in a dwell,
    whichever is larger, and at the upper end of what the count of pairs allows.
    """
    press, phase = readings["press"].to_numpy(), readings["phase"].to_numpy()
    same = (press[1:] == press[:-1]) & (phase[1:] == phase[:-1])
    pairs = np.stack([same & (phase[1:] == name) for name in ("zero", "dwell")])  # (2, N - 1)
    count, equal = (
        np.concatenate([np.zeros((2, 1)), np.cumsum(what, axis=1)], axis=1)
        for what in (pairs, pairs & (np.diff(value) == 0))
    )

    def too_even(start: int, end: int) -> bool:
        if end - start < SHORTEST_OF_NOISE:
            return False
        first, last = max(start - 1, 0), min(end, len(value) - 1)
        n, k = (total[:, -1] - total[:, last] + total[:, first] for total in (count, equal))
        if n.max() < LEAST_PAIRS:
            return False
        upper = np.minimum((k + 3 * np.sqrt(k + 1) + 1) / np.maximum(n, 1), 1.0)
        share = upper[n >= LEAST_PAIRS].max()
        return bool(len(value) * share ** (end - start - 1) < CHANCE)

    return too_even
