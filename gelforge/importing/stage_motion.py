"""Excursions of the stage towards the sensor: where it stands still, and when it stops and leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import find_peaks

from gelforge.indentation.paths.places import POSITION_MATCH_MM
from gelforge.robust import SIGMA_OF_MEDIAN

# Waits and stops of SYNTHETIC stages, one in steps of its encoder too, are found (tests/importing/test_presses.py):
NOISE_BANDS = 4.0  # of the encoder's noise: a stage within is at rest
# A stage that follows its command holds it to some micrometres; one of an encoder's step is no motion
# (tests/importing/test_presses.py).
LEAST_BAND_MM = 0.003


@dataclass(frozen=True)
class Wait:
    """The stage at rest: from stopping to leaving [s], where (x, y, travel) [mm], speed of arrival [mm/s].

    Stopping and leaving are where the straight lines of the motion and of rest meet; NaN where it does not move before or
    after.
    """

    first: int  # rows of the stage log
    last: int
    arrive_s: float
    leave_s: float
    at_mm: np.ndarray  # (3,)
    speed_mm_per_s: float

    @property
    def travel_mm(self) -> float:
        return float(self.at_mm[2])


@dataclass(frozen=True)
class Excursion:
    """One motion towards the sensor and back: rows of the stage log from `first` over `top`, the deepest, to `last`."""

    first: int
    top: int
    last: int
    waits: tuple[Wait, ...]


def band_mm(travel: np.ndarray) -> float:
    """Return how far the position of a stage at rest may read off its median [mm]: noise from second differences."""
    bends = np.abs(travel[2:] - 2 * travel[1:-1] + travel[:-2])
    sigma = SIGMA_OF_MEDIAN * float(np.median(bends)) / np.sqrt(6)
    return max(NOISE_BANDS * sigma, LEAST_BAND_MM)


def excursions(
    time: np.ndarray, xyz: np.ndarray, least_retreat_mm: float, least_dwell_s: float
) -> list[Excursion]:
    """Return the excursions of a stage log: times (n,) [s], x, y and travel (n, 3) [mm], in the order taken."""
    travel = xyz[:, 2]
    # the ends of the log count as retreats, so that a log that begins or ends deep has an excursion there
    low = travel.min() - 2 * least_retreat_mm
    # equal readings of a wait would each be a peak of full height: the later one is made higher by a nanometre
    padded = np.concatenate([[low], travel + np.linspace(0, 1e-6, len(travel)), [low]])
    peaks, _ = find_peaks(padded, prominence=least_retreat_mm)
    peaks = peaks - 1
    waits = _waits(time, xyz, band_mm(travel), least_dwell_s)
    valleys = [int(a + travel[a : b + 1].argmin()) for a, b in zip(peaks, peaks[1:])]
    out = []
    for first, top, last in zip([0, *valleys], peaks, [*valleys, len(time) - 1]):
        within = tuple(wait for wait in waits if first <= wait.first and wait.last <= last)
        out.append(Excursion(first, int(top), last, within))
    return out


def _waits(time: np.ndarray, xyz: np.ndarray, band: float, least_s: float) -> list[Wait]:
    out = []
    for first, last in _rests(time, xyz, band, least_s):
        at = np.median(xyz[first : last + 1], axis=0)
        arrive, speed = _meets(time, xyz[:, 2], first, at[2], band, -1)
        leave, _ = _meets(time, xyz[:, 2], last, at[2], band, 1)
        out.append(Wait(first, last, arrive, leave, at, speed))
    return out


def _rests(time: np.ndarray, xyz: np.ndarray, band: float, least_s: float) -> list[tuple[int, int]]:
    """Return the runs of rows (first, last), of least_s or more, in which no axis moves by more than two bands."""
    wide = 2 * np.array([max(band, POSITION_MATCH_MM), max(band, POSITION_MATCH_MM), band])
    rows = max(3, int(np.ceil(least_s / np.median(np.diff(time)))))
    if len(time) < rows:
        return []
    windows = sliding_window_view(xyz, rows, axis=0)  # (n - rows + 1, 3, rows)
    still = (np.ptp(windows, axis=2) <= wide).all(axis=1)
    begun, ended = np.zeros(len(time) + 1, int), np.zeros(len(time) + 1, int)
    begun[np.flatnonzero(still)] = 1
    ended[np.flatnonzero(still) + rows] = 1
    rest = np.cumsum(begun - ended)[:-1] > 0
    jump = np.append(True, (np.abs(np.diff(xyz, axis=0)) > wide).any(axis=1))
    first = np.flatnonzero(rest & (jump | ~np.append(False, rest[:-1])))
    ends = np.append(~rest[1:] | jump[1:], True)
    runs = [(i, i + int(ends[i:].argmax())) for i in first.tolist()]
    return [(i, j) for i, j in runs if j - i + 1 >= rows and np.ptp(xyz[i : j + 1, 2]) <= 2 * wide[2]]


def _meets(time, travel, row: int, level: float, band: float, step: int) -> tuple[float, float]:
    """Return when the motion before (step -1) or after (1) a rest meets its level [s], and its speed [mm/s].

    The line is that of the samples at full speed next to the rest.
    """
    limit = 40  # rows of a ramp in a fast log; 0.7 s in a slow one
    moving, k = [row], row + step
    direction = 0.0
    while 0 <= k < len(time) and len(moving) < limit + 1 and abs(time[k] - time[row]) <= 0.7:
        move = travel[k] - travel[k - step]
        if abs(travel[k] - level) > band:
            if direction and move * direction <= 0:
                break
            direction = direction or np.sign(travel[k] - level)
        moving.append(k)
        k += step
    rows = np.array([k for k in moving if abs(travel[k] - level) > band])
    if len(rows) < 2:
        return float("nan"), float("nan")
    speed = np.abs(np.diff(travel[rows]) / np.diff(time[rows]))
    # samples that brake or accelerate are slower
    fast = speed >= 0.8 * np.median(speed[speed >= 0.5 * speed.max()])
    kept = np.unique(np.concatenate([rows[:-1][fast], rows[1:][fast]]))
    slope, offset = np.polyfit(time[kept] - time[row], travel[kept], 1)
    if slope == 0:
        return float("nan"), float("nan")
    return float(time[row] + (level - offset) / slope), float(abs(slope))
