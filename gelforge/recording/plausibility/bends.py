"""When a signal bends: where the stage stops or leaves, force and image bend at once, whatever the material relaxes."""

from __future__ import annotations

import numpy as np

# Lags of SYNTHETIC logs are found within 5 ms (tests/importing/test_clocks.py):
BEND_S, BEND_STEP_S = 0.08, 0.002  # around a coarse lag, in which a bend is looked for
WINDOW_S = 0.35  # of the signal on each side of a bend: lags are then found within 5 ms (tests/importing/test_clocks.py)
# On each side. A parabola with its bend has three unknowns on a side; slow logs are aligned still
# (tests/importing/test_clocks.py).
LEAST_SAMPLES = 4
# Times that a bend at the end of what was tried is looked for farther on. Four windows of 0.08 s reach as far as
# WINDOW_S, beyond which the signal is another (tests/importing/test_clocks.py).
RECENTRED = 4
# Of a bend's window or a ramp: a faster log is averaged over neighbours. Of 0.7 s, that is a mean of 3.5 ms, below the
# 5 ms to which lags are found (tests/importing/test_clocks.py).
MOST_SAMPLES = 200


def centred_bend(at, lag, before, after, side, signal_s, signal) -> tuple[float, float] | None:
    """Return lag and standard deviation [s] of a bend, looked for again about what was found while that lies at the end."""
    for _ in range(RECENTRED):
        bend = bend_near(at, lag, before, after, side, signal_s, signal)
        if bend is None or abs(bend[0] - lag) < BEND_S - BEND_STEP_S:
            return bend
        lag = bend[0]
    return None


def bend_near(at, lag, before, after, side, signal_s, signal) -> tuple[float, float] | None:
    """Return lag and standard deviation [s] of a bend about a lag; one at the end of what is tried is farther off.

    Parameters
    ----------
    at : float
        Time of the bend on the other clock [s].
    lag : float
        Coarse: how much later the signal's clock shows it [s].
    before, after : float
        How much of the signal around the bend counts [s].
    side : int
        1 where the signal moves after the bend, -1 where it moves before it.
    signal_s : numpy.ndarray
        (n,), times of the signal [s], rising.
    signal : numpy.ndarray
        (n,), in any unit.

    Returns
    -------
    tuple of float, or None
        Lag and standard deviation [s], infinite at the end of what is tried. None for too few samples or no best place.
    """
    a, b = np.searchsorted(signal_s, [at + lag - before, at + lag + after])
    time, value = signal_s[a:b] - at - lag, signal[a:b]
    if min((time < 0).sum(), (time > 0).sum()) < LEAST_SAMPLES:
        return None
    return bend_time(thinned(time), thinned(value), side, lag)


def thinned(samples: np.ndarray) -> np.ndarray:
    """Return at most MOST_SAMPLES means of neighbours, so that a fast log costs no more."""
    count = len(samples) // MOST_SAMPLES + 1
    return samples[: len(samples) // count * count].reshape(-1, count).mean(axis=1)


def bend_time(time, value, side, lag) -> tuple[float, float] | None:
    """Return lag and standard deviation [s]: two parabolas that meet, where they meet best."""
    tries = np.arange(-BEND_S, BEND_S + BEND_STEP_S / 2, BEND_STEP_S)
    left = np.empty(len(tries))
    for i, bend in enumerate(tries):
        t = time - bend
        moving, resting = np.maximum(side * t, 0), np.maximum(-side * t, 0)
        A = np.stack([np.ones_like(t), t, moving, moving**2, resting**2], axis=1)
        rest = value - A @ np.linalg.lstsq(A, value, rcond=None)[0]
        left[i] = rest @ rest
    k = int(left.argmin())
    if k in (0, len(tries) - 1):
        return lag + float(tries[k]), np.inf
    curve = (left[k - 1] - 2 * left[k] + left[k + 1]) / BEND_STEP_S**2
    if curve <= 0:
        return None
    shift = 0.5 * (left[k - 1] - left[k + 1]) / (curve * BEND_STEP_S)
    variance = left[k] / max(len(time) - 6, 1)
    return lag + float(tries[k] + shift), float(max(np.sqrt(2 * variance / curve), 1e-4))
