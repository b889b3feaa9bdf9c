"""Checks of a session's readings at the edge: each error names file, row, value found, limit and remedy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import ForceSensor, Sensor
from gelforge.indentation.paths.places import POSITION_MATCH_MM, within
from gelforge.indentation.sensor.stage_frame import first_outside

# An indentation runs through its phases in this order; approach and touch may alternate, and so may load and dwell.
# Other orders are refused by row (tests/recording/test_readings.py).
PHASES = {"zero": 0, "approach": 1, "touch": 1, "load": 2, "dwell": 2, "shear": 3, "unload": 4}

# Deepest indentation of a session: below it is metres, above it micrometres. Wrong units, clocks and orders are refused,
# right neighbours read (benchmarks/faults.py, inputs).
DEPTH_MM = (0.02, 30.0)
# No soft gel bears more at these depths; above it is millinewtons: forces 1000 times too large are refused
# (benchmarks/faults.py, inputs).
FORCE_N = 100.0
# Between time_s and dwell_s: a dwell rounded to seconds stays within, milliseconds do not: times 1000 times too large are
# refused (benchmarks/faults.py, inputs).
CLOCK_RATIO = 30.0


class RecordingError(ValueError):
    """A recording that cannot be used: where, what was found, what to do."""


def _refuse(
    path: Path, table: pd.DataFrame, wrong: pd.Series | np.ndarray, words: Callable[[pd.Series], str]
) -> None:
    """Raise RecordingError at the first row that is wrong (N,); words: what is wrong with a row, and the remedy."""
    if np.any(wrong):
        row = table.iloc[np.argmax(wrong)]
        raise RecordingError(f"{path}, row {row.name}: {words(row)}")


def _refuse_empty(path: Path, table: pd.DataFrame, values: np.ndarray, name: str) -> None:
    """Raise RecordingError for a row without a finite number among the values (N,) of a column."""
    _refuse(
        path,
        table,
        ~np.isfinite(values),
        lambda _: f"{name} is empty or not finite; fill it or remove the row",
    )


def check_rows(path: Path, table: pd.DataFrame) -> None:
    """Raise RecordingError unless the rows are complete indentations in the order taken, with depths in millimetres."""
    refuse = partial(_refuse, path, table)
    unknown = ~table["phase"].isin(PHASES)
    refuse(unknown, lambda row: f"phase {row.phase!r} is not one of {list(PHASES)}")
    _check_order(path, table)
    _check_phases(path, table)
    _check_depths(path, table)


def _check_order(path: Path, table: pd.DataFrame) -> None:
    refuse = partial(_refuse, path, table)
    refuse(
        table["order"] != np.round(table["order"]),
        lambda row: f"order {row.order} is not a whole number; number the indentations 1, 2, 3, ...",
    )
    for name, what in (("order", "presses"), ("time_s", "readings")):
        backward = np.flatnonzero(np.diff(table[name]) < 0)
        if len(backward):
            line = table.index[backward[0] + 1]
            before = table[name].iloc[backward[0]]
            raise RecordingError(
                f"{path}, row {line}: {name} {table.at[line, name]:.9g} after {before:.9g}; "
                f"{what} stand in the order taken, sort the file"
            )
    new_press = table["press"] != table["press"].shift()
    new_order = table["order"] != table["order"].shift()
    refuse(
        (table["press"].duplicated() & new_press) | (new_press != new_order),
        lambda row: (
            f"indentation {row.press} with order {row.order:.0f}; every indentation has one order and its rows stand"
            " together, give repeated indentations different names"
        ),
    )


def _check_phases(path: Path, table: pd.DataFrame) -> None:
    refuse = partial(_refuse, path, table)
    backward = (table["press"] == table["press"].shift()) & (table["phase"].map(PHASES).diff() < 0)
    before = table["phase"].shift()
    refuse(
        backward,
        lambda row: (
            f"phase {row.phase} after {before[row.name]} in indentation {row.press}; the phases of an indentation are"
            " zero, approach or touch, load or dwell, shear, unload, in this order"
        ),
    )
    held = table["phase"].isin(["load", "dwell"]).groupby(table["press"]).transform("any")
    refuse(
        ~held,
        lambda row: f"indentation {row.press} has no load or dwell row; record one or remove the indentation",
    )


def _check_depths(path: Path, table: pd.DataFrame) -> None:
    refuse = partial(_refuse, path, table)
    held = table["phase"].isin(["load", "dwell", "shear"])
    _refuse_empty(path, table[held], table.loc[held, "depth_mm"].to_numpy(), "depth_mm")
    refuse(
        held & (table["depth_mm"] <= 0),
        lambda row: (
            f"depth_mm {row.depth_mm} in phase {row.phase}; it must be positive, name rows before contact `zero`"
        ),
    )
    refuse(
        (table["phase"] == "zero") & (table["depth_mm"] > 0),
        lambda row: f"depth_mm {row.depth_mm} in phase zero; it must be empty, negative or 0",
    )
    line = table["depth_mm"].where(held).idxmax()
    deepest, (low, high) = table.at[line, "depth_mm"], DEPTH_MM
    if not low <= deepest <= high:
        unit = "metres" if deepest < low else "micrometres"
        raise RecordingError(
            f"{path}, row {line}: the deepest indentation has depth_mm {deepest:.6g}; {low} to {high} mm is expected, is it"
            f" in {unit}?"
        )


def before_shear(readings: pd.DataFrame) -> np.ndarray:
    """Return which readings were taken before their indentation moved sideways; all of an indentation that does not.

    Parameters
    ----------
    readings : pandas.DataFrame
        N readings in their order, with columns `press` and `phase`.

    Returns
    -------
    numpy.ndarray
        (N,) bool.
    """
    return ~(readings["phase"] == "shear").groupby(readings["press"]).cummax().to_numpy()


def check_repeated_rows(path: Path, table: pd.DataFrame) -> None:
    """Raise RecordingError for a row that repeats the one before in everything, force and time included."""
    refuse = partial(_refuse, path, table)
    known = table[["fx_N", "fy_N", "fz_N"]].notna().all(axis=1)
    again = known & (table == table.shift()).where(table.notna() | table.shift().notna(), True).all(axis=1)
    refuse(
        again,
        lambda row: (
            f"indentation {row.press}: the row appears twice, time_s {row.time_s:g} and force included; remove one"
        ),
    )


def check_clock(path: Path, table: pd.DataFrame) -> None:
    """Raise RecordingError where time_s runs much faster or slower than the times that dwell_s states."""
    held = table[(table["phase"] == "dwell") & table["dwell_s"].notna()]
    press = held["press"]
    waited = held["dwell_s"] - held.groupby("press")["dwell_s"].transform("first")
    passed = held["time_s"] - held.groupby("press")["time_s"].transform("first")
    known = (waited > 0) & (passed > 0)
    if known.sum() < 2 or press[known].nunique() < 2:
        return
    ratio = float(np.median(passed[known] / waited[known]))
    if not 1 / CLOCK_RATIO <= ratio <= CLOCK_RATIO:
        line = known.idxmax()
        raise RecordingError(
            f"{path}, row {line}: time_s passes {ratio:.3g} times as fast as dwell_s (median of the dwells); within a factor"
            f" of {CLOCK_RATIO:g} is expected, are both in seconds? Correct one, or leave dwell_s empty"
        )


def check_positions(
    path: Path, readings: pd.DataFrame, sensor: Sensor | None, tolerance_mm: float = POSITION_MATCH_MM
) -> None:
    """Raise RecordingError for an indentation that moves sideways before its `shear` rows, or lies outside the sensor.

    readings: positions in the sensor's frame; tolerance_mm: within which they are one position.
    """
    xy = readings[["x_mm", "y_mm"]]
    moved = xy - xy.groupby(readings["press"]).transform("first")
    drift = np.hypot(moved["x_mm"], moved["y_mm"]).where(before_shear(readings), 0.0)
    if not within(drift.max(), tolerance_mm):
        line = drift.idxmax()
        raise RecordingError(
            f"{path}, row {line}: indentation {readings.at[line, 'press']} moves {drift[line]:.4g} mm sideways; "
            f"positions stay within {tolerance_mm:g} mm before phase `shear`: give each position its own indentation, name"
            " the rows of a sideways motion `shear`, or state stage_to_sensor.repeatability_mm where the stage scatters"
        )
    if sensor is None:
        return
    if wrong := first_outside(xy.to_numpy(), (sensor.width_x_mm, sensor.width_y_mm)):
        raise RecordingError(f"{path}, row {readings.index[wrong[0]]}: {wrong[1]}")


def check_raw_force(path: Path, table: pd.DataFrame, raw: np.ndarray, force: ForceSensor) -> None:
    """Raise RecordingError for a missing reading or one beyond the force sensor's range."""
    range_N = np.array(force.range_N or [FORCE_N] * 3)
    for axis, name in enumerate(("fx_N", "fy_N", "fz_N")):
        _refuse_empty(path, table, raw[:, axis], name)
        beyond = np.abs(raw[:, axis]) > range_N[axis]
        if beyond.any():
            line = table.index[beyond.argmax()]
            source = "force.range_N" if force.range_N else "the limit for a soft gel"
            raise RecordingError(
                f"{path}, row {line}: {name} {raw[beyond.argmax(), axis]:.6g} N beyond {range_N[axis]:g} N ({source});"
                " correct the reading or the range, is it in millinewtons, or in counts"
                " (force.counts_per_unit of an import)?"
            )


def check_force(path: Path, readings: pd.DataFrame, force: ForceSensor) -> None:
    """Raise RecordingError for corrected forces in kilonewtons or of the wrong sign: a pressing ball gives negative Fz."""
    held = readings[readings["phase"].isin(["load", "dwell"])]
    deep = held[held["depth_mm"] >= 0.5 * held["depth_mm"].max()]
    line = deep["fz_N"].abs().idxmax()
    largest = deep.at[line, "fz_N"]
    if abs(largest) < 0.5 * force.resolution_N[2]:
        raise RecordingError(
            f"{path}, row {line}: the largest fz_N is {largest:.3g} N, below half of the resolution "
            f"{force.resolution_N[2]} N; correct force.resolution_N, is it in kilonewtons?"
        )
    if deep["fz_N"].median() > force.resolution_N[2]:
        raise RecordingError(
            f"{path}: pressing gives fz_N {deep['fz_N'].median():.3g} N (median of the deep indentations); it must be"
            " negative on the sensor, z up: correct force.acts_on or force.axes in session.yaml"
        )
