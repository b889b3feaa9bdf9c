"""Loading, unloading, cycles and holds found in the stretch, whatever its noise.

The path stretch(time) is reduced to a polyline that stays within a tolerance of every row (Ramer 1972, Douglas
and Peucker 1973); its pieces are then loadings, unloadings or holds. Noise below the tolerance makes no piece.
"""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter

import numpy as np

from gelforge.materials.basis.common_form import Segment
from gelforge.robust import SIGMA_OF_MEDIAN

# Stairs and cycles are cut into their parts; noise of 0.6 % and an encoder that sticks change none
# (tests/materials/test_segments.py):
TOLERANCE = 0.01  # of the range of stretch: noise of the strain measurement, not a reversal
HOLD_RATE = 0.1  # of the typical rate while moving; below it a piece that hardly moves is a hold,
# if it lasts longer than the movement takes for this many tolerances: an encoder that sticks for 0.4 s is no hold
# (tests/materials/test_segments.py)
HOLD_LENGTH = 5
# Of noise: thousands of rows, and both ends of a piece carry noise too (tests/materials/test_segments.py: stairs with noise
# of 0.3 % of the range are found).
SIGMAS = 6.0
LARGEST_MARGIN = 0.03  # of the range; noisier tests need smoothing first
# Tolerances; a shorter way back is a glitch of the strain measurement, as a jump back by 2 % of the range
# (tests/materials/test_segments.py).
LEAST_REVERSAL = 3


def first_reversal(stretch: np.ndarray, tolerance: float = TOLERANCE) -> int | None:
    """Return the first row that falls back by more than the tolerance times the range, None if none does."""
    back = _behind(stretch) > tolerance * np.ptp(stretch)
    return int(np.argmax(back)) if back.any() else None


def largest_back_step(stretch: np.ndarray) -> float:
    """Return the largest fall behind the furthest stretch so far, as a share of the range; 0 if none."""
    return float(np.max(_behind(stretch)) / max(np.ptp(stretch), 1e-12))


def _behind(stretch: np.ndarray) -> np.ndarray:
    """Return how far each row (n,) is behind the furthest stretch so far."""
    loading = np.sign(stretch[np.argmax(np.abs(stretch - stretch[0]))] - stretch[0])  # -1 in compression
    return np.maximum.accumulate(loading * stretch) - loading * stretch


def find_segments(
    stretch: np.ndarray, time_s: np.ndarray | None, at_rest: float = 1.0, tolerance: float = TOLERANCE
) -> tuple[Segment, ...]:
    """Return the loads, unloads and holds of a test in their order.

    A load moves away from rest. Without a time column holds cannot be distinguished from closely spaced rows and none is
    found. A test that never moves (one stretch throughout) is one hold.
    """
    n = len(stretch)
    time = np.arange(n, dtype=float) if time_s is None else np.asarray(time_s, dtype=float)
    extent = np.ptp(stretch)
    if extent <= 1e-3 * max(np.max(np.abs(stretch - at_rest)), 1e-12):
        return (Segment("hold", 0, n, 1),)
    margin = max(tolerance * extent, min(SIGMAS * _noise(time, stretch), LARGEST_MARGIN * extent))
    corners = _corners(time, stretch, margin)
    away = np.sign(stretch[np.argmax(np.abs(stretch - at_rest))] - at_rest)
    pieces = _merged(_classified(time, away * stretch, corners, margin, time_s is not None))
    return _numbered(_without_glitches(pieces, away * stretch, LEAST_REVERSAL * margin))


def _noise(time: np.ndarray, stretch: np.ndarray) -> float:
    """Return the standard deviation of a row around the line through its neighbours (robust, for white noise)."""
    if len(stretch) < 5:
        return 0.0
    span = np.maximum(time[2:] - time[:-2], 1e-12)
    w = np.clip((time[1:-1] - time[:-2]) / span, 0, 1)
    gap = stretch[1:-1] - (1 - w) * stretch[:-2] - w * stretch[2:]
    return float(SIGMA_OF_MEDIAN * np.median(np.abs(gap) / np.sqrt(1 + w**2 + (1 - w) ** 2)))


def _corners(time: np.ndarray, stretch: np.ndarray, margin: float) -> list[int]:
    """Return the rows at the corners of a polyline that keeps within the margin of every row."""
    keep, pending = {0, len(stretch) - 1}, [(0, len(stretch) - 1)]
    while pending:
        a, b = pending.pop()
        if b - a < 2:
            continue
        line = np.interp(time[a : b + 1], [time[a], time[b]], [stretch[a], stretch[b]])
        gap = np.abs(stretch[a : b + 1] - line)
        worst = a + int(np.argmax(gap))
        if gap[worst - a] > margin and a < worst < b:
            keep.add(worst)
            pending += [(a, worst), (worst, b)]
    return sorted(keep)


def _classified(time, outward, corners, margin, timed) -> list[tuple[int, int, int]]:
    """Return (direction, start, stop) of each piece; direction 1 outward, -1 inward, 0 hold."""
    steps = np.diff(outward[corners])
    spans = np.maximum(np.diff(time[corners]), 1e-12)
    order = np.argsort(np.abs(steps) / spans)
    way = np.cumsum(np.abs(steps)[order])
    typical = (np.abs(steps) / spans)[order][np.searchsorted(way, way[-1] / 2)]  # half of the way was faster
    pieces = []
    for step, span, a, b in zip(steps, spans, corners, corners[1:]):
        still = abs(step) <= 2 * margin and abs(step) / span < HOLD_RATE * typical
        held = timed and still and span > HOLD_LENGTH * margin / typical
        pieces.append((0 if held else int(np.sign(step)) or 1, a, b))
    return pieces


def _merged(pieces: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Return pieces with neighbours of one direction made into one."""
    alike = (list(group) for _, group in groupby(pieces, key=itemgetter(0)))
    return [(group[0][0], group[0][1], group[-1][2]) for group in alike]


def _without_glitches(pieces, outward, least: float) -> list[tuple[int, int, int]]:
    """Return the pieces with each way back that is shorter than `least` joined to the movement around it."""
    while True:
        ways = [abs(outward[b] - outward[a]) if d else np.inf for d, a, b in pieces]
        k = int(np.argmin(ways))
        around = [*pieces[max(k - 1, 0) : k], *pieces[k + 1 : k + 2]]
        if ways[k] >= least or not any(direction == -pieces[k][0] != 0 for direction, _, _ in around):
            return pieces
        pieces = _merged([*pieces[:k], (-pieces[k][0], *pieces[k][1:]), *pieces[k + 1 :]])


def _numbered(pieces: list[tuple[int, int, int]]) -> tuple[Segment, ...]:
    """Return segments; neighbours share the row of the corner, so that no work between them is lost."""
    segments, cycle, unloaded = [], 1, False
    for direction, a, b in pieces:
        if direction == 1 and unloaded:
            cycle, unloaded = cycle + 1, False
        unloaded |= direction == -1
        segments.append(Segment(("hold", "load", "unload")[direction], a, b + 1, cycle))
    return tuple(segments)
