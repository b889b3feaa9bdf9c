"""G-code that a stage ran, as a log: positions by time from feed rates and, where it is known, the acceleration.

Every motion begins and ends at rest, as a stage does whose controller does not blend motions.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config.foreign.importing import GCode
from gelforge.importing.refusals import ImportingError

AXES = "XYZ"
INCH_MM = 25.4  # exact since 1959
MOVES = {"G0", "G1", "G4", "G20", "G21", "G90", "G91"}
WITHOUT_TIME = {"G17", "G40", "G49", "G54", "G64", "G80", "G94", "M2", "M30", "M82", "M84", "M104", "M106", "M107", "M140",
                "M400"}  # fmt: skip
# Rounding of sums of coordinates: metres hold 1e-13 mm in double precision. Times and positions are exact with it
# (tests/importing/test_other_sources.py).
LEAST_MOVE_MM = 1e-9


def gcode_table(path: Path, columns: list[str], how: GCode) -> pd.DataFrame:
    """Return the columns (X, Y, Z) [mm] at how.rate_hz rows per second. Raises ImportingError for what it cannot time."""
    if unknown := set(columns) - set(AXES):
        raise ImportingError(
            f"{path}: {', '.join(sorted(unknown))} is no axis of G-code; x, y and z are X, Y and Z"
        )
    motions = _motions(path, how)
    ends = np.cumsum([0.0] + [seconds for seconds, *_ in motions])
    time = np.arange(0.0, ends[-1], 1 / how.rate_hz)
    which = np.clip(np.searchsorted(ends, time, side="right") - 1, 0, len(motions) - 1)
    out = np.empty((len(time), 3))
    for k, (_, start, end, speed) in enumerate(motions):
        rows = which == k
        gone = _gone(time[rows] - ends[k], float(np.linalg.norm(end - start)), speed, how.acceleration_mm_s2)
        out[rows] = start + gone[:, None] * (end - start)
    return pd.DataFrame(out, columns=list(AXES), index=range(1, len(out) + 1))[columns]


def _motions(path: Path, how: GCode) -> list[tuple[float, np.ndarray, np.ndarray, float]]:
    """Return duration [s], beginning and end (3,) [mm] and speed [mm/s] of every motion and dwell."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ImportingError(f"{path}: cannot be read as G-code ({error}); correct stage.file") from None
    at, scale, relative, feed, mode, out = np.zeros(3), 1.0, False, None, "", []
    for number, line in enumerate(lines, 1):
        words = re.findall(r"([A-Z])\s*([-+]?[0-9]*\.?[0-9]+)", re.sub(r"\(.*?\)|;.*|%", "", line.upper()))
        here = f"{path}, row {number}"
        values = {letter: float(value) for letter, value in words if letter not in "GMNT"}
        commands = [f"{letter}{float(value):g}" for letter, value in words if letter in "GMT"]
        if unknown := [c for c in commands if c not in MOVES | WITHOUT_TIME]:
            raise ImportingError(
                f"{here}: {unknown[0]} takes a time or a way that the file does not say; log the stage's positions instead"
            )
        for command in commands:
            scale = {"G20": INCH_MM, "G21": 1.0}.get(command, scale)
            relative = {"G90": False, "G91": True}.get(command, relative)
            mode = command if command in ("G0", "G1") else mode
        if "F" in values:
            feed = values["F"] * scale / 60
        if "G4" in commands:
            out.append((values.get("S", 0.0) + values.get("P", 0.0) / 1e3, at, at, 0.0))
            continue
        target = at.copy()
        for k, axis in enumerate(AXES):
            if axis in values:
                target[k] = values[axis] * scale + (at[k] if relative else 0.0)
        way = float(np.linalg.norm(target - at))
        if not any(axis in values for axis in AXES):
            continue
        if not mode:
            raise ImportingError(f"{here}: a position without G0 or G1; write which one")
        speed = how.rapid_mm_s if mode == "G0" and how.rapid_mm_s else feed
        arc = any(letter in values for letter in "IJKR")
        if (way > LEAST_MOVE_MM and out) or arc:
            if not speed:
                raise ImportingError(
                    f"{here}: no feed rate F so far; give F, or stage.gcode.rapid_mm_s for G0"
                )
            if arc:
                raise ImportingError(f"{here}: an arc; log the stage's positions instead")
            out.append((_duration(way, speed, how.acceleration_mm_s2), at, target, speed))
        elif not out:  # the first position is where the stage begins
            out.append((0.0, target, target, 0.0))
        at = target
    if len(out) < 2:
        raise ImportingError(f"{path}: {len(out)} motions; name the G-code that the stage ran")
    return out


def _duration(way: float, speed: float, acceleration: float | None) -> float:
    if acceleration is None:
        return way / speed
    peak = min(speed, np.sqrt(way * acceleration))
    return peak / acceleration + way / peak


def _gone(time: np.ndarray, way: float, speed: float, acceleration: float | None) -> np.ndarray:
    """Return the share of a motion (n,) that is gone at times since its beginning [s]."""
    if way <= LEAST_MOVE_MM or speed == 0:
        return np.zeros(len(time))
    if acceleration is None:
        return np.minimum(time * speed / way, 1.0)
    peak = min(speed, np.sqrt(way * acceleration))
    ramp, total = peak / acceleration, peak / acceleration + way / peak
    begun, ended = np.minimum(time, ramp), np.clip(time - (total - ramp), 0.0, ramp)
    gone = 0.5 * acceleration * (begun**2 - ended**2) + peak * np.clip(time - ramp, 0.0, None)
    return np.clip(gone / way, 0.0, 1.0)
