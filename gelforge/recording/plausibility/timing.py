"""Tests of time: the force changes in step with the depth, or the lag that was found is reported."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gelforge.recording.plausibility.bends import BEND_S, WINDOW_S, centred_bend
from gelforge.recording.plausibility.findings import Finding
from gelforge.recording.plausibility.repeats import RAW
from gelforge.recording.plausibility.streams import ForceLog

if TYPE_CHECKING:
    from gelforge.recording.plausibility.session import SessionData

# Of 37 kinds of honest SYNTHETIC sessions each passes, and each seeded fault is found
# (tests/recording/test_plausibility.py):
LEAST_INDENTATIONS = 3  # that a lag is found from
# Share of the force's variance that depth leaves unexplained: sites and relaxation leave less. Relaxation of 80 % and sites
# of 0.4 to 1.6 times the usual stiffness pass, lags of 0.3 to 5 s are refused (test_plausibility.py).
UNEXPLAINED = 0.1
# By so many times less must remain at the lag than without it: relaxing gels and slow logs pass, lags of 0.3 to 5 s are
# refused (test_plausibility.py).
BETTER = 3.0
# Of what a lag explains: the least lag that misses no more than this is the one. A dwell makes many lags fit alike; the
# lag named mends the session to a sample (tests/recording/test_plausibility.py).
NEAR_BEST = 0.05
# Filters of force sensors, and a stage that settles: half of the least lag that is refused in test_plausibility.py.
LEAST_LIMIT_S = 0.15
# Between lags that are tried, at first and around the best one: lags of -1.23 and 0.43 s are then found to a sample
# (test_plausibility.py).
COARSE_S, STEP_S = 0.1, 0.02
# Of the way under load before arrival, where the bend is looked for. The first fifth, where the contact grows, bends
# too; lags are right to a sample (tests/recording/test_plausibility.py).
MOTION = 0.8
# Of the force reached while waiting: at the commanded depth it is there. Relaxation of 40 % while waiting passes, late
# force is found (tests/recording/test_plausibility.py).
RISEN = 0.9


def force_in_step(data: SessionData) -> list[Finding]:
    """Return that the force lags or leads the depth by more than the waits allow, with the lag found.

    With ft.csv the lag is in time: at the stage's clock plus the lag the log agrees with the depths. Without it whole rows
    of the table are shifted. Relaxation during a wait is no lag: it makes the force fall, and a lag would appear as a rise.
    """
    if data.log is None:
        return _rows_shifted(data)
    return _log_shifted(data, data.log)


def _log_shifted(data: SessionData, log: ForceLog) -> list[Finding]:
    limit = max(LEAST_LIMIT_S, 2 * log.gap_s / 3, _shortest_wait_s(data.readings))
    at, depth, numbers = _known_depths(data.readings)
    if len(np.unique(numbers)) < LEAST_INDENTATIONS:
        return []
    normal = int(np.abs(np.asarray(data.session.force.axes, float)[2]).argmax())
    farthest = min(60.0, float(log.time_s[-1] - log.time_s[0]) / 2)
    model = np.maximum(depth, 0.0) ** 1.5

    def best(lags: np.ndarray) -> float:
        seen = (np.interp(at + lag, log.time_s, log.force_N[:, normal]) for lag in lags)
        return _best_lag(lags, np.array([_unexplained(force, model, at) for force in seen]))

    most = int(np.ceil(farthest / COARSE_S))
    lag = best(np.arange(-most, most + 1) * COARSE_S)
    if lag:
        most = round(COARSE_S / STEP_S)
        lag = best(np.append(0.0, lag + np.arange(-most, most + 1) * STEP_S))
    if lag:
        lag += _rise_s(data.readings, log, normal, lag, from_zero=True)
    elif (late := _rise_s(data.readings, log, normal)) > limit:
        lag = late
    if abs(lag) <= limit:
        return []
    lag = _to_a_sample(data.readings, log, normal, lag)
    word = "lags" if lag > 0 else "leads"
    return [
        Finding(
            test="force_in_step",
            level="error",
            channel="ft.csv",
            value=abs(lag),
            limit=limit,
            unit="s",
            found=f"{word} the depth by {abs(lag):.2f} s",
            remedy=f"set force.delay_s: {data.session.force.delay_s + lag:.3f} in session.yaml, or use one clock",
        )
    ]


def _shortest_wait_s(readings: pd.DataFrame) -> float:
    """Return how long after arrival the earliest reading at depth is taken [s], 0 where that is not known."""
    held = readings[readings["phase"].isin(["load", "dwell"])]
    shortest = held["dwell_s"].min()
    return float(shortest) if np.isfinite(shortest) and not (held["phase"] == "load").any() else 0.0


def _known_depths(readings: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], depths [mm], indentation numbers where the depth is known: before contact, and waiting at depth."""
    names = readings["press"].unique()
    # at most 200, spread evenly: more add nothing
    chosen = names[np.unique(np.linspace(0, len(names) - 1, min(len(names), 200)).astype(int))]
    parts = []
    for number, (_, rows) in enumerate(readings[readings["press"].isin(chosen)].groupby("press", sort=False)):
        deepest = _at_depth(rows)
        zero = rows[rows["phase"] == "zero"]
        for part, depth in ((zero, 0.0), (deepest, float(deepest["depth_mm"].iloc[0]))):
            if len(part):
                first, last = part["time_s"].iloc[0], part["time_s"].iloc[-1]
                time = np.linspace(first, last, int(np.ceil((last - first) / 0.05)) + 1)
                parts.append((time, np.full(len(time), depth), np.full(len(time), number)))
    at, depths, numbers = (np.concatenate(values) for values in zip(*parts))
    return at, depths, numbers


def _at_depth(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the load and dwell rows of an indentation at its deepest."""
    held = rows[rows["phase"].isin(["load", "dwell"])]
    return held[held["depth_mm"] >= held["depth_mm"].max() - 1e-9]


def _unexplained(force: np.ndarray, model: np.ndarray, at: np.ndarray) -> float:
    """Return the share of a force's variance that depth does not explain, a drift in proportion to time taken out."""
    drift, _ = np.linalg.qr(np.stack([np.ones_like(at), at - at.mean()], axis=1))
    rest = [values - drift @ (drift.T @ values) for values in (force, model)]
    size = (rest[0] @ rest[0]) * (rest[1] @ rest[1])
    return 1.0 - float((rest[0] @ rest[1]) ** 2 / size) if size > 0 else 1.0


def _best_lag(lags: np.ndarray, left: np.ndarray) -> float:
    """Return the least lag that explains the force as well as the best one, 0 where none is much better than no lag."""
    without, best = left[np.abs(lags).argmin()], left.min()
    if without < UNEXPLAINED or without < BETTER * best:
        return 0.0
    good = np.flatnonzero(left <= best + NEAR_BEST * (without - best))
    return float(lags[good[np.abs(lags[good]).argmin()]])


def _rise_s(
    readings: pd.DataFrame, log: ForceLog, axis: int, lag_s: float = 0.0, from_zero: bool = False
) -> float:
    """Return how long after arrival at depth the log first shows nearly all of the force of the wait (median) [s].

    The log is read lag_s later than the stage's clock says. from_zero: looked for from the last zero row on, so that a rise
    before arrival is seen too; else the rise is at arrival, the earliest, where the force is there by then.
    """
    rises = []
    for _, rows in readings.groupby("press", sort=False):
        waits = _at_depth(rows)["time_s"].to_numpy() + lag_s
        zero = rows.loc[rows["phase"] == "zero", "time_s"].to_numpy() + lag_s
        if len(waits) < 2 or not len(zero):
            continue
        inside = slice(*np.searchsorted(log.time_s, [zero[-1] if from_zero else waits[0], waits[-1]]))
        time, force = log.time_s[inside], log.force_N[inside, axis]
        rise = np.abs(force - np.interp(zero[-1], log.time_s, log.force_N[:, axis]))
        if len(rise) and rise.max() > 0:
            rises.append(time[(rise >= RISEN * rise.max()).argmax()] - waits[0])
    return float(np.median(rises)) if len(rises) >= LEAST_INDENTATIONS else 0.0


def _to_a_sample(readings: pd.DataFrame, log: ForceLog, axis: int, lag_s: float) -> float:
    """Return a lag [s] to a sample of the log: when the force bends, less when the stage arrives at depth (median).

    The lag as it is where the table does not say when the stage arrives, or the log is too slow to show the bend.
    """
    lags = []
    for _, rows in readings.groupby("press", sort=False):
        held = _at_depth(rows)
        dwell, speed = float(held["dwell_s"].iloc[0]), float(held["speed_mm_per_s"].iloc[0])
        if np.isnan(dwell):
            continue
        first, last = held["time_s"].iloc[[0, -1]]
        arrive, rest = float(first) - dwell, float(last - first) + dwell
        moving = MOTION * float(held["depth_mm"].iloc[0]) / speed if speed > 0 else WINDOW_S
        before, after = min(WINDOW_S, moving) - BEND_S, min(WINDOW_S, rest) - BEND_S
        bend = centred_bend(arrive, lag_s, before, after, -1, log.time_s, log.force_N[:, axis])
        if bend is not None and np.isfinite(bend[1]):
            lags.append(bend[0])
    return float(np.median(lags)) if len(lags) >= LEAST_INDENTATIONS else lag_s


def _rows_shifted(data: SessionData) -> list[Finding]:
    readings = data.readings
    used = readings["phase"].isin(["zero", "load", "dwell"]).to_numpy()
    presses = readings["press"].nunique()
    if presses < LEAST_INDENTATIONS:
        return []
    normal = int(np.abs(np.asarray(data.session.force.axes, float)[2]).argmax())
    force = readings[RAW].to_numpy()[:, normal]
    at = readings["time_s"].to_numpy()
    model = np.maximum(readings["depth_mm"].fillna(0.0).to_numpy(), 0.0) ** 1.5
    most = int(min(np.ceil(2 * len(readings) / presses), len(readings) // 3))
    shifts = np.arange(-most, most + 1)
    left = np.array([_unexplained_shifted(force, model, at, used, int(shift)) for shift in shifts])
    shift = int(_best_lag(shifts, left))
    if shift == 0:
        return []
    word = "lag" if shift > 0 else "lead"
    time = float(np.median(np.abs(at[abs(shift) :] - at[: -abs(shift)])))
    return [
        Finding(
            test="force_in_step",
            level="error",
            channel="force",
            value=float(abs(shift)),
            limit=0.0,
            unit="rows",
            found=f"{word}s the depth by {abs(shift)} row(s) of indentations.csv, {time:.3g} s",
            remedy=f"move fx_N, fy_N, fz_N by {abs(shift)} row(s) {'up' if shift > 0 else 'down'}",
        )
    ]


def _unexplained_shifted(force, model, at, used, shift: int) -> float:
    """Return what depth leaves unexplained of the force that stands `shift` rows further down."""
    rows = np.flatnonzero(used)
    rows = rows[(rows + shift >= 0) & (rows + shift < len(force))]
    rows = rows[np.isfinite(force[rows + shift])]
    return _unexplained(force[rows + shift], model[rows], at[rows]) if len(rows) > 2 else 1.0
