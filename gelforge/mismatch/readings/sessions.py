"""The gate: session folders become observations, with the noise that they show themselves and what they cannot say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import ConfigError, Sensor, Session
from gelforge.config.parts.effects import PressTiming
from gelforge.indentation.paths.places import DIGITS, visited
from gelforge.indentation.planning.tolerance import tolerance_of_stage_mm
from gelforge.indentation.sensor.stage_frame import axes_of_stage
from gelforge.input_files import another_kind
from gelforge.mismatch.readings.errors import depth_scatter, reading_noise, with_contact_point, zeros_together
from gelforge.mismatch.readings.observations import ARRAYS, COLUMNS, Observations, last_moves
from gelforge.recording.readings import AXES, FORCE, Recording, read_recording
from gelforge.recording.tables.checks import before_shear

# Assumed where an indentation has one moving row only.
SPEED_MM_PER_S = PressTiming.model_fields["speed_mm_per_s"].default


def session_folders(folder: str | Path, names: Sequence[str] = ()) -> list[Path]:
    """Return the session folders of a recording: itself, or those in it or in its `recordings`.

    Parameters
    ----------
    folder : str or Path
        The recording.
    names : sequence of str
        Of the sessions that are wanted; all if empty.

    Returns
    -------
    list of Path
        At least one.

    Raises
    ------
    ConfigError
        Where there is none.
    """
    folder = Path(folder)
    if what := another_kind(folder, "a folder"):
        raise ConfigError(f"{folder}{what}; name a session's folder, or one of sessions")
    if (folder / "session.yaml").is_file():
        return [folder]
    for inside in (folder / "recordings", folder):
        folders = sorted(path.parent for path in inside.glob("*/session.yaml"))
        folders = [path for path in folders if not names or path.name in names]
        if folders:
            return folders
    raise ConfigError(
        f"{folder}: no session.yaml in it, in {folder.name}/recordings/* or in {folder.name}/*; name a session's folder"
    )


def read_all(sessions: Sequence[Path | Recording], sensor: Sensor) -> list[Recording]:
    """Return sessions read; what has been read stays as it is.

    Parameters
    ----------
    sessions : sequence of Path or Recording
        Folders, or what was read of them.
    sensor : Sensor
        In whose frame positions are [mm].

    Returns
    -------
    list of Recording
        In the same order.

    Raises
    ------
    RecordingError
        For a session that cannot be read.
    """
    return [one if isinstance(one, Recording) else read_recording(one, None, sensor) for one in sessions]


def observe(
    sessions: Sequence[Path | Recording],
    sensor: Sensor,
    speed_mm_per_s: float = SPEED_MM_PER_S,
    contact_point_scatter_mm: float | None = None,
) -> Observations:
    """Return the readings of some sessions, judged together. Raises RecordingError as the reader does.

    contact_point_scatter_mm: in place of what the sessions state, of indentations or sessions as `depth_zero.by` says.
    """
    recordings = read_all(sessions, sensor)
    parts = [_of_session(recording, speed_mm_per_s, contact_point_scatter_mm) for recording in recordings]
    tolerance = max(_tolerance_mm(recording.session) for recording in recordings)
    return with_contact_point(_with_order(_joined(parts, tolerance)))


def _tolerance_mm(session: Session) -> float:
    return tolerance_of_stage_mm(session.stage_to_sensor.repeatability_mm)


def _of_session(
    recording: Recording, speed_mm_per_s: float, contact_point_scatter_mm: float | None
) -> Observations:
    """Return the readings of one session; its sites are numbered with those of the others."""
    session = recording.session
    excluded = [f"{session.session}: {line}" for line in recording.findings.lines("excluded")]
    straight = recording.readings[before_shear(recording.readings)]  # the base is pressed straight down
    recording = replace(recording, readings=straight.dropna(subset=FORCE).reset_index(drop=True))
    together = zeros_together(recording)
    noise, rounding, (repeats, tails), unknown = reading_noise(
        recording, together.repeats if together else None
    )
    unknown += excluded
    readings = recording.readings
    table = _table(session, readings, speed_mm_per_s, unknown)
    held, R = table.pop("held").to_numpy(), len(table)
    force = readings[FORCE].to_numpy(copy=True)
    force[:, _dead_axes(force, session, unknown)] = np.nan
    count = (readings["phase"] == "zero").groupby(readings["press"]).sum().reindex(readings["press"])
    zero = np.sqrt(noise**2 / np.maximum(count.to_numpy(), 1)[:, None] + rounding**2)
    walk, trend = (0.0, 0.0) if together is None or session.force.tared else together.drift(readings)
    press_depth, session_depth = depth_scatter(session.depth_zero, contact_point_scatter_mm)
    return Observations(
        table,
        force,
        np.empty((0, 2)),
        np.broadcast_to(noise, (R, 3)),
        np.zeros((R, 3)) if session.force.tared else zero,
        np.full(R, press_depth),
        np.full(R, session_depth),
        rounding_N=rounding,
        drift_N=np.asarray(walk),
        trend_N=np.asarray(trend),
        came_along=last_moves(table, axes_of_stage(session.stage_to_sensor), _tolerance_mm(session)),
        repeats=np.asarray(repeats),
        tails=np.asarray(tails),
        cannot_know=tuple(unknown),
    ).chosen(held)


def _joined(parts: Sequence[Observations], tolerance_mm: float) -> Observations:
    """Return the observations of some sessions as one, their sites numbered; those within the tolerance are one."""
    table = pd.concat([part.table for part in parts], ignore_index=True)
    table["site"], sites = _sites(table[["x_mm", "y_mm"]].to_numpy(), tolerance_mm)
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS}
    return Observations(
        table[COLUMNS],
        sites=sites,
        **arrays,
        cannot_know=tuple(dict.fromkeys(said for part in parts for said in part.cannot_know)),
        set_aside=(),
    )


def _table(session: Session, readings: pd.DataFrame, speed: float, unknown: list[str]) -> pd.DataFrame:
    """Return the columns of observations for every reading of a session, and `held`: those that are judged.

    speed: of the study [mm/s], where an indentation states neither its contact nor its own; that is reported.
    """
    name = session.session
    held = readings["phase"].isin(["load", "dwell", "unload"]) & (readings["depth_mm"] > 0)
    touch, assumed = _touches(readings, speed)
    if assumed:
        unknown.append(
            f"{name}: {assumed} indentations have neither a touch row nor a speed (speed_mm_per_s) while loading: {speed:g}"
            " mm/s (history.timing) is taken; relaxation and the clock follow it"
        )
    touch = touch.reindex(readings["press"]).to_numpy()
    start = readings.groupby("press")["time_s"].transform("first").to_numpy()
    table = readings[["order", "phase", "time_s", "x_mm", "y_mm", "depth_mm"]].assign(
        session=name,
        press=name + "/" + readings["press"],
        press_time_s=readings["time_s"] - np.where(np.isfinite(touch), touch, start),
        deepest_mm=readings["depth_mm"].where(held).groupby(readings["press"]).transform("max"),
        age_days=np.nan if session.sensor_age_days is None else session.sensor_age_days,
        temperature_C=np.nan if session.temperature_C is None else session.temperature_C,
        held=held,
    )
    return table


def _touches(readings: pd.DataFrame, speed: float) -> tuple[pd.Series, int]:
    """Return the time of touch [s] by press, and of how many the speed had to be taken from elsewhere.

    A touch row shows it; else it lies before the first load or dwell row by as much as the indentation's speed needs.
    """
    first = readings[readings["phase"].isin(["load", "dwell"])].groupby("press").first()
    down = readings[readings["phase"].isin(["approach", "load"]) & (readings["speed_mm_per_s"] > 0)]
    speeds = down.groupby("press")["speed_mm_per_s"].last().reindex(first.index)
    seen = readings[readings["phase"] == "touch"].groupby("press")["time_s"].first()
    touch = first["time_s"] - first["depth_mm"] / speeds.fillna(speed)
    return seen.combine_first(touch), int((speeds.isna() & ~speeds.index.isin(seen.index)).sum())


def _dead_axes(force: np.ndarray, session: Session, unknown: list[str]) -> np.ndarray:
    """Return (3,) bool: axes whose readings never change; each is reported."""
    dead = np.ptp(force, axis=0) == 0
    for axis in np.flatnonzero(dead):
        unknown.append(
            f"{session.session}: F{AXES[axis]} never changes (always {force[0, axis]:g} N), so this axis is left out"
        )
    return dead


def _sites(xy: np.ndarray, tolerance_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of each position's site and the sites' positions (S, 2), in the order first visited."""
    places, first, which = np.unique(np.round(xy, DIGITS), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    sites, number = np.unique(visited(places[order], tolerance_mm), return_inverse=True)
    of_place = np.empty(len(places), int)
    of_place[order] = number
    return of_place[which.ravel()], places[order][sites]


def _with_order(found: Observations) -> Observations:
    """Say where the order of indentations makes time and place one."""
    unknown = list(found.cannot_know)
    presses = found.table.drop_duplicates("press")
    for axis in ("x_mm", "y_mm"):
        if presses[axis].nunique() < 3:
            continue
        rank = presses[axis].rank().corr(presses["time_s"].rank())
        if abs(rank) > 0.9:  # time and place are one
            unknown.append(
                f"indentations were made in raster order (rank correlation of time with {axis[0]} {rank:.2f}):"
                " ageing and drift "
                "cannot be distinguished from a gradient; record in random order, with the centre again at every"
                " ninth indentation"
            )
    if not presses.duplicated(["site", "deepest_mm"]).any():
        unknown.append(
            "no site has two indentations to one depth: the scatter of the contact point and ageing are known from"
            " statements only"
        )
    if not (found.table["phase"] == "unload").any():
        unknown.append("no reading during unloading: adhesion and hysteresis are invisible")
    return replace(found, cannot_know=tuple(unknown))
