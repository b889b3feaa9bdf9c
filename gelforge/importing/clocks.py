"""How far one clock lies behind another: candidate lags by correlation, and which of them the indentations contradict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import percentile_filter
from scipy.signal import correlate, correlation_lags, find_peaks

from gelforge.config.foreign.importing import ImportMapping
from gelforge.importing.refusals import ImportingError

# Lags of SYNTHETIC logs are found within 5 ms, and logs of two sessions are refused (tests/importing/test_clocks.py):
GRID_S = 0.02  # of a coarse lag: bends give it to a tenth of this afterwards
# Heights of the surface that are tried. A step of 4 % of the travel, which `_finer_level` divides by 30; contact and
# lag are then found (tests/importing/test_clocks.py).
LEVELS = 25
POWER = 1.5  # of force over depth, as of a ball on a thick gel (Hertz 1882): enough for a correlation
# for where the surface is: a flat punch has 1, Hertz's ball 1.5, layers on a rigid base more
POWERS = (1.0, 1.5, 2.0, 2.5)
# A quarter of the variance: logs of one session reach 0.9, the force of another or a dead one is refused
# (tests/importing/test_clocks.py, test_raw_files.py).
LEAST_CORRELATION = 0.5
# Of the best correlation: looked at; as good. Equal indentations without a rest at the ends of the logs are ambiguous,
# between rests they are not (tests/importing/test_clocks.py).
CANDIDATE, RIVAL = 0.9, 0.95
APART_S = ImportMapping.model_fields["least_dwell_s"].default  # the shortest wait: nearer lags are one peak
# Of the grid, about the best lag: relaxation shifts it. 0.12 s, as far as relaxation moves a peak: lags are found with it
# (tests/importing/test_clocks.py).
NEAR_STEPS = 6
# Of the median peak: an indentation that both signals must show. Weaker ones may drown in noise: shallow and deep
# indentations of one log are aligned (tests/importing/test_clocks.py).
STRONG = 0.3


class Signal(NamedTuple):
    """What a log shows over its own clock."""

    time_s: np.ndarray  # (n,) since its first row
    values: np.ndarray  # (n,) any unit


@dataclass(frozen=True)
class Match:
    """A coarse lag [s] of a signal's times against the stage's, each since its first row."""

    lag_s: float
    correlation: float
    contact_mm: float  # travel above which the model of the signal is not 0
    power: float  # of the signal over depth
    lags_s: np.ndarray  # (L,) all lags, and their correlation, for the page
    correlations: np.ndarray
    rival: tuple[float, float] | None  # the next best candidate: lag, correlation


def coarse_match(
    stage: Signal,
    log: Signal,
    what: str,
    key: str,
    start_s: float = 0.0,
    known_s=None,
    refine: Callable[[Match], float] = lambda match: match.lag_s,
) -> Match:
    """Return the lag at which a log follows the stage.

    Parameters
    ----------
    stage : Signal
        Travel [mm].
    log : Signal
        What grows with depth, in any unit.
    what, key : str
        The log's file, and its key in the mapping, for messages.
    start_s : float
        By how much the log's clock shows more at its first row than the stage's at its own, for messages.
    known_s : float, optional
        A given lag, which is kept.
    refine : callable
        Gives the lag about a match to a sample, for those that a message offers.

    Raises
    ------
    ImportingError
        Where no lag fits, or several do.
    """
    grid = np.arange(0, stage.time_s[-1], GRID_S)
    depth = np.interp(grid, *stage)
    times = np.arange(0, log.time_s[-1], GRID_S)
    even = np.interp(times, *log)
    height = rise(times, even)
    best = _best_level(depth, height)
    _refuse_unlike(depth, times, even, best[0], what, key)
    _, level, correlation = best
    lags = correlation_lags(len(height), len(depth)) * GRID_S
    level, power = _finer_level(depth, height, level, lags[int(correlation.argmax())])
    if known_s is not None:
        k = int(np.abs(lags - known_s).argmin())
        return Match(known_s, float(correlation[k]), level, power, lags, correlation, None)
    top = correlation.max()
    peaks, _ = find_peaks(correlation, height=CANDIDATE * top, distance=int(APART_S / GRID_S))
    if not len(peaks):
        peaks = np.array([correlation.argmax()])
    peaks = peaks[np.argsort(-correlation[peaks])][:50]
    wrong = np.array([contradictions(grid, depth - level, times, height, lags[k]) for k in peaks])
    order = np.lexsort((-correlation[peaks], wrong))
    chosen = peaks[order[0]]
    rival = peaks[order[1]] if len(order) > 1 else None
    if (
        rival is not None
        and wrong[order[1]] == wrong[order[0]]
        and correlation[rival] >= RIVAL * correlation[chosen]
    ):
        one, other = (
            start_s
            + refine(Match(float(lags[k]), float(correlation[k]), level, power, lags, correlation, None))
            for k in (chosen, rival)
        )
        raise ImportingError(
            f"{what}: two lags behind the stage's clock fit, {one:.3f} and {other:.3f} s"
            f" (correlation {correlation[chosen]:.3f} and {correlation[rival]:.3f}), as the indentations repeat; set"
            f" {key}.lag_s, or record a rest before the first and after the last indentation in both logs"
        )
    next_best = None if rival is None else (float(lags[rival]), float(correlation[rival]))
    return Match(float(lags[chosen]), float(correlation[chosen]), level, power, lags, correlation, next_best)


def rise(times: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Return a signal (n,) on an even grid above its rest, at least 0; rest may drift over a minute."""
    step = 10
    few = signal[::step]
    # the signal at rest, over a minute
    size = max(3, min(len(few), int(60.0 / (times[1] - times[0]) / step)))
    # low, as presses may fill most of a minute, and no minimum, which is noise
    rest = percentile_filter(few, 15, size, mode="nearest")
    return np.maximum(signal - np.interp(times, times[::step], rest), 0.0)


def _best_level(depth: np.ndarray, height: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Return the largest correlation, the surface's height [mm] that gives it, and the correlation of every lag."""
    seen = height - height.mean()
    size = np.sqrt(seen @ seen)
    best = (0.0, float(depth.max()), np.zeros(len(height) + len(depth) - 1))
    for level in np.linspace(depth.min(), depth.max(), LEVELS + 2)[1:-1]:
        model = np.maximum(depth - level, 0.0) ** POWER
        model -= model.mean()
        product = size * np.sqrt(model @ model)
        if product > 0:
            correlation = correlate(seen, model, method="fft") / product
            if correlation.max() > best[0]:
                best = (float(correlation.max()), float(level), correlation)
    return best


def _finer_level(depth: np.ndarray, height: np.ndarray, level: float, lag: float) -> tuple[float, float]:
    """Return the surface's height [mm] and the power of depth that correlate best about one lag [s]."""
    step, best = np.ptp(depth) / (LEVELS + 1), (-1.0, level, POWER)
    for shift in range(round(lag / GRID_S) - NEAR_STEPS, round(lag / GRID_S) + NEAR_STEPS + 1, 2):
        a, b = max(0, -shift), min(len(depth), len(height) - shift)
        travel, seen = depth[a:b], height[a + shift : b + shift]
        tries = np.linspace(level - 2 * step, min(level + step, travel.max() - 0.1 * step), 61)
        beyond = np.maximum(travel[None, :] - tries[:, None], 0.0)
        for power in POWERS:
            models = beyond**power
            correlation = models @ seen / np.sqrt((models**2).sum(axis=1))
            k = int(correlation.argmax())
            if correlation[k] > best[0]:
                best = (float(correlation[k]), float(tries[k]), power)
    return best[1], best[2]


def _refuse_unlike(depth, times, signal, best: float, what: str, key: str) -> None:
    """Raise ImportingError for a signal that does not follow the stage, or does so better with another sign."""
    signs = {"stage.pressing": (-1, 1)}
    if key == "force":
        force = "session.force.acts_on or session.force.axes (pressing gives a negative fz on the sensor)"
        signs |= {force: (1, -1), f"stage.pressing, and {force}": (-1, -1)}
    others = {
        named: _best_level(way * depth, rise(times, sign * signal))[0] for named, (way, sign) in signs.items()
    }
    named = max(others, key=others.__getitem__)
    if others[named] > max(best, LEAST_CORRELATION):
        raise ImportingError(
            f"{what}: follows the stage with another sign (correlation {others[named]:.2f}, as declared {best:.2f});"
            f" correct {named}"
        )
    if best < LEAST_CORRELATION:
        raise ImportingError(
            f"{what}: does not follow the stage (correlation {best:.2f}, at least {LEAST_CORRELATION} is needed); name the"
            f" {key} log of this session and its columns"
        )


def runs_above(values: np.ndarray, limit: float) -> list[tuple[int, int]]:
    """Return the runs (first, last) of samples above a limit."""
    above = np.concatenate([[False], values > limit, [False]])
    edges = np.flatnonzero(np.diff(above.astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2])]


def contradictions(grid, depth, times, height, lag: float) -> int:
    """Return how many strong indentations inside what both logs cover one of two signals shows and the other does not."""
    # at its ends a smoothed signal knows one side only
    start, end = max(grid[0], times[0] - lag) + 0.3, min(grid[-1], times[-1] - lag) - 0.3
    pairs = [(grid, depth, times - lag, height), (times - lag, height, grid, depth)]
    count = 0
    for own_s, shown, other_s, other in pairs:
        strong, weak = _strong(shown, STRONG), _strong(other, 0.1 * STRONG)
        for first, last in runs_above(shown, 0.1 * strong):
            inside = own_s[first] >= start and own_s[last] <= end
            if not inside or shown[first : last + 1].max() < strong:
                continue
            a, b = np.searchsorted(other_s, [own_s[first], own_s[last]])
            count += not (other[a : b + 1] > weak).any()
    return count


def _strong(values: np.ndarray, share: float) -> float:
    """Return a share of the median height of what rises above a tenth of the highest."""
    tops = [values[a : b + 1].max() for a, b in runs_above(values, 0.1 * values.max())]
    return share * float(np.median(tops))
