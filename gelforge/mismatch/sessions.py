"""The gate: session folders become observations, with the noise that they show themselves and what they cannot say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import ConfigError, Sensor, Session
from gelforge.indentation.plan import POSITION_MATCH_MM
from gelforge.mismatch.observations import COLUMNS, Observations, SetAside, last_moves
from gelforge.recording.readings import FORCE, Recording, axes_of_stage, read_recording

AXES = ("x", "y", "z")
TOUCHDOWN_MM = 0.02  # assumed where neither the session nor repeated presses say how well zero was found
SPEED_MM_PER_S = 1.0  # assumed where a press has one moving row only
# Standard deviations of a held reading from the course of the others of its press at that depth
OUTLIER = 8.0
BENT = 2.0  # times the scatter of zero readings: more than that of dwells about a line is relaxation
LEAST_SCATTER = 0.1  # of the step, where all repeats were rounded to one number
LEAST_FREEDOM = 10  # repeats that a noise estimate needs
RASTER = 0.9  # |rank correlation| of order with x or y above which time and place are one


def session_folders(folder: str | Path, names: Sequence[str] = ()) -> list[Path]:
    """Return the session folders of a recording: itself, or those (of these names, if any) in it or in its `recordings`.

    Raises ConfigError where there is none.
    """
    folder = Path(folder)
    if (folder / "session.yaml").is_file():
        return [folder]
    for inside in (folder / "recordings", folder):
        found = sorted(path.parent for path in inside.glob("*/session.yaml"))
        found = [path for path in found if not names or path.name in names]
        if found:
            return found
    raise ConfigError(
        f"{folder}: no session.yaml in it, in {folder.name}/recordings/* or in {folder.name}/*; name a session's folder"
    )


def observe(
    folders: Sequence[Path],
    sensor: Sensor,
    speed_mm_per_s: float = SPEED_MM_PER_S,
    touchdown_mm: float | None = None,
) -> Observations:
    """Return the readings of some sessions, judged together. Raises RecordingError as the reader does.

    touchdown_mm: the scatter of depth zero in place of all that the sessions say and show of it.
    """
    parts, forces, noises, zeros, scatters, zero_by, unknown, aside = [], [], [], [], [], [], [], []
    roundings, knowns, moves = [], [], []
    for folder in folders:
        recording = read_recording(folder, None, sensor)
        noise, rounding, known, said = reading_noise(recording)
        readings, dropped = without_outliers(recording, np.hypot(noise, rounding))
        unknown += said
        aside += dropped
        part = _table(recording.session, readings, speed_mm_per_s, unknown)
        held = part.pop("held")
        force = readings[FORCE].to_numpy(copy=True)
        dead = _dead_axes(force, recording.session, unknown)
        force[:, dead] = np.nan
        count = (readings["phase"] == "zero").groupby(readings["press"]).sum().reindex(readings["press"])
        zero = np.sqrt(noise**2 / np.maximum(count.to_numpy(), 1)[:, None] + rounding**2)
        if recording.session.force.tared:
            zero = np.zeros(force.shape)
        parts.append(part[held])
        forces.append(force[held])
        noises.append(np.broadcast_to(noise, force.shape)[held])
        zeros.append(zero[held])
        axes = axes_of_stage(recording.session.stage_to_sensor)
        moves.append(last_moves(part, axes)[held])
        roundings.append(np.broadcast_to(rounding, force.shape)[held])
        knowns.append(np.broadcast_to(known, (held.sum(), 2)))
        scatter = recording.session.depth_zero.scatter_mm if touchdown_mm is None else touchdown_mm
        scatters.append(np.full(held.sum(), np.nan if scatter is None else scatter))
        zero_by.append(np.full(held.sum(), recording.session.depth_zero.by))
    table = pd.concat(parts, ignore_index=True)
    repeats, tails = np.concatenate(knowns).T
    table["site"], sites = _sites(table[["x_mm", "y_mm"]].to_numpy())
    found = Observations(
        table[COLUMNS], np.concatenate(forces), sites, np.concatenate(noises), np.concatenate(zeros),
        np.concatenate(scatters), np.concatenate(zero_by),
        rounding_N=np.concatenate(roundings), came_along=np.concatenate(moves), repeats=repeats, tails=tails,
        cannot_know=tuple(dict.fromkeys(unknown)), set_aside=tuple(aside),
    )  # fmt: skip
    return _with_touchdown(_with_order(found))


def reading_noise(recording: Recording) -> tuple[np.ndarray, np.ndarray, tuple[float, float], list[str]]:
    """Return the standard deviations (3,) [N] of one reading and of its rounding, how well, and what is not known of them.

    Repeats are zero rows of a press, and its dwell rows about their straight line, unless these bend by more than the zero
    rows scatter: that is relaxation. Where they scatter by less than half of
    the readings' step, rounding is one and the same error in all repeats: step / sqrt(12), in the zero and at each depth;
    where they scatter more, it is part of the scatter. How well: the repeats' degrees of freedom (inf where the deviation
    is stated), and the variance of their squares over that of normal ones.
    """
    readings, session = recording.readings, recording.session
    step = np.array(session.force.resolution_N, dtype=float)
    zero, dwell = _repeats(readings, "zero", 1), _repeats(readings, "dwell", 2)
    said = []
    if min(zero.freedom, dwell.freedom) >= LEAST_FREEDOM:
        usual = np.maximum(zero.scatter, step / 2)
        k = int(np.argmax(dwell.scatter / usual))
        if dwell.scatter[k] > BENT * usual[k]:
            dwell = Repeats.none()
            said.append(
                f"{session.session}: F{AXES[k]} bends during dwells by more than zero readings scatter, {usual[k]:.2g} N: "
                "the noise is taken from the zero readings alone, and is too small if it grows with the force"
            )
    found = zero + dwell
    if found.freedom >= LEAST_FREEDOM:
        scatter = found.scatter
        rounding = np.where(scatter < step / 2, step / np.sqrt(12), 0.0)
        tails = _tails(found.fourths, found.expected, scatter, rounding == 0)
        return np.maximum(scatter, LEAST_SCATTER * step), rounding, (float(found.freedom), tails), said
    stated = session.force.repeatability_N
    said = (
        f"{session.session}: {found.freedom} repeated readings, {LEAST_FREEDOM} are needed to know the noise; "
        + (
            "the stated repeatability is used"
            if stated
            else "the stated resolution is taken as its standard deviation"
        )
    )
    return np.full(3, stated) if stated else step, np.zeros(3), (np.inf, 1.0), [said]


@dataclass(frozen=True, eq=False)
class Repeats:
    """Sums over repeated readings R e about their mean or line: squares, fourth powers, and what `_tails` expects."""

    squares: np.ndarray  # (3,) [N^2]
    fourths: np.ndarray  # (3,) [N^4]
    expected: np.ndarray  # (2,)
    freedom: int

    def __add__(self, other: Repeats) -> Repeats:
        return Repeats(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def scatter(self) -> np.ndarray:
        """Return the standard deviations (3,) [N]."""
        return np.sqrt(self.squares / self.freedom)

    @staticmethod
    def none() -> Repeats:
        """Return no repeats."""
        return Repeats(np.zeros(3), np.zeros(3), np.zeros(2), 0)


def _repeats(readings: pd.DataFrame, phase: str, fitted: int) -> Repeats:
    """Return the repeats of a phase about a polynomial in time of so many coefficients per press."""
    found = Repeats.none()
    for _, of_press in readings[readings["phase"] == phase].groupby("press", sort=False):
        if len(of_press) <= fitted:
            continue
        time = of_press["time_s"].to_numpy()
        curve = np.vander(time - time.mean(), fitted)
        residual_of = np.eye(len(time)) - curve @ np.linalg.pinv(curve)
        left = residual_of @ of_press[FORCE].to_numpy()
        expected = np.array([np.sum((residual_of**2).sum(axis=1) ** 2), np.sum(residual_of**4)])
        found += Repeats((left**2).sum(axis=0), (left**4).sum(axis=0), expected, len(time) - fitted)
    return found


def _tails(fourths: np.ndarray, expected: np.ndarray, scatter: np.ndarray, free: np.ndarray) -> float:
    """Return the variance of a squared draw over that of a normal one, at least 1, from the repeats of the free axes.

    Residuals R e of draws e of variance v and excess kurtosis k have fourth moments 3 v^2 sum (RR')_ii^2 + k v^2 sum R_ij^4:
    fourths (3,) are summed over all, expected holds both sums.
    """
    known = free & (scatter > 0)
    if not known.any():
        return 1.0
    excess = (fourths[known] / scatter[known] ** 4 - 3 * expected[0]) / expected[1]
    return 1.0 + max(float(excess.mean()), 0.0) / 2


def without_outliers(recording: Recording, noise: np.ndarray) -> tuple[pd.DataFrame, list[SetAside]]:
    """Return the readings without held ones that jump away from others of their press at that depth, and a list of those."""
    readings = recording.readings
    held = readings[readings["phase"].isin(["load", "dwell"])]
    force, time, size = held[FORCE].to_numpy() / noise, held["time_s"].to_numpy(), np.zeros(len(held))
    for rows in held.groupby(["press", "depth_mm"], sort=False).indices.values():
        # Beside a jump others seem to jump: one after the other.
        while (jumps := _jumps(force[rows], time[rows])).max() > OUTLIER:
            worst = int(np.argmax(jumps))
            size[rows[worst]] = jumps[worst]
            rows = np.delete(rows, worst)
    far = size > OUTLIER
    said = [
        SetAside(
            session=recording.session.session,
            press=str(row.press),
            time_s=row.time_s,
            depth_mm=row.depth_mm,
            size=round(value, 1),
            reason="far from the other readings of its press at that depth",
        )
        for row, value in zip(held[far].itertuples(), size[far])
    ]
    return readings.drop(index=held.index[far]).reset_index(drop=True), said


def _jumps(force: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return by how much each of some readings (k, 3), in order of time (k,), jumps out of their course.

    Relaxation falls on, slower and slower: one inside jumps if it lies to one side of both neighbours, the last one if it
    falls further than all before it did, and faster. The first is never blamed: most of what relaxes may be gone after it.
    """
    size, step = np.zeros(len(force)), np.diff(force, axis=0)
    to_one_side = step[:-1] * step[1:] < 0
    nearer = np.minimum(np.abs(step[:-1]), np.abs(step[1:]))
    size[1:-1] = np.where(to_one_side, nearer, 0.0).max(axis=1, initial=0)
    if len(force) >= 4:
        longer = (time[-1] - time[-2]) / max(time[-2] - time[0], 1e-9)  # a wait than all before it
        size[-1] = (np.abs(step[-1]) - max(1.0, longer) * np.ptp(force[:-1], axis=0)).max()
    return size


def _table(session: Session, readings: pd.DataFrame, speed: float, unknown: list[str]) -> pd.DataFrame:
    """Return the columns of observations for every reading of a session, and `held`: those that are judged.

    speed: of the study [mm/s], where a press tells neither its touch nor its own; that is told.
    """
    name = session.session
    held = readings["phase"].isin(["load", "dwell", "unload"]) & (readings["depth_mm"] > 0)
    touch, assumed = _touches(readings, speed)
    if assumed:
        unknown.append(
            f"{name}: {assumed} presses have neither a touch row nor a speed (speed_mm_per_s) on their way down: {speed:g}"
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

    A touch row tells it; else it lies before the first load or dwell row by as much as the press's speed needs.
    """
    first = readings[readings["phase"].isin(["load", "dwell"])].groupby("press").first()
    down = readings[readings["phase"].isin(["approach", "load"]) & (readings["speed_mm_per_s"] > 0)]
    own = down.groupby("press")["speed_mm_per_s"].last().reindex(first.index)
    seen = readings[readings["phase"] == "touch"].groupby("press")["time_s"].first()
    touch = first["time_s"] - first["depth_mm"] / own.fillna(speed)
    return seen.combine_first(touch), int((own.isna() & ~own.index.isin(seen.index)).sum())


def _dead_axes(force: np.ndarray, session: Session, unknown: list[str]) -> np.ndarray:
    """Return (3,) bool: axes whose readings never change; each is told."""
    dead = np.ptp(force, axis=0) == 0
    for axis in np.flatnonzero(dead):
        unknown.append(
            f"{session.session}: F{AXES[axis]} never changes (always {force[0, axis]:g} N), so this axis is left out"
        )
    return dead


def _sites(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of each position and the distinct positions (S, 2), in the order first visited."""
    places, first, which = np.unique(np.round(xy, 6), axis=0, return_index=True, return_inverse=True)
    sites, number = np.empty((0, 2)), np.empty(len(places), dtype=int)
    for k in np.argsort(first):
        near = np.flatnonzero(np.abs(sites - places[k]).max(axis=1) <= POSITION_MATCH_MM)
        number[k] = near[0] if len(near) else len(sites)
        sites = sites if len(near) else np.vstack([sites, places[k]])
    return number[which.ravel()], sites


def _with_order(found: Observations) -> Observations:
    """Say where the order of presses makes time and place one."""
    unknown = list(found.cannot_know)
    presses = found.table.drop_duplicates("press")
    for axis in ("x_mm", "y_mm"):
        if presses[axis].nunique() < 3:
            continue
        rank = presses[axis].rank().corr(presses["time_s"].rank())
        if abs(rank) > RASTER:
            unknown.append(
                f"presses were taken in raster order (rank correlation of time with {axis[0]} {rank:.2f}): ageing and drift "
                "cannot be told from a gradient; press in random order with a sentinel press every ninth one"
            )
    if not presses.duplicated(["site", "deepest_mm"]).any():
        unknown.append(
            "no position was pressed twice to one depth: the scatter of touchdown and ageing are known from statements only"
        )
    if not (found.table["phase"] == "unload").any():
        unknown.append("no reading on the way up: adhesion and hysteresis are invisible")
    return replace(found, cannot_know=tuple(unknown))


def _with_touchdown(found: Observations) -> Observations:
    """Fill scatter of touchdown that no session states: from repeated presses, or assumed and told.

    Repeats show only a zero that each press found by itself.
    """
    missing = ~np.isfinite(found.touchdown_mm)
    if not missing.any():
        return found
    by_press = np.asarray(found.zero_by) == "press"
    scatter = _repeated_touchdown(found, by_press)
    assumed = missing & ~by_press if scatter is not None else missing
    said = (
        f"how well depth zero was found is not stated (depth_zero.scatter_mm): {TOUCHDOWN_MM} mm is assumed"
    )
    return replace(
        found,
        touchdown_mm=np.where(assumed, TOUCHDOWN_MM, np.where(missing, scatter or 0.0, found.touchdown_mm)),
        cannot_know=(*found.cannot_know, *([said] if assumed.any() else [])),
    )


def _repeated_touchdown(found: Observations, of: np.ndarray) -> float | None:
    """Return the scatter [mm] of touchdown that repeated presses show in Fz, less the noise; None with few repeats.

    of (R,) bool: the readings that count. Of each press the depth by which all its loading readings are off their means, as
    the slope has it; presses less places are the repeats.
    """
    table = found.table.assign(fz=found.force[:, 2], noise=found.noise_N[:, 2], zero=found.zero_N[:, 2])
    loads = table[(table["phase"] == "load") & of & np.isfinite(table["fz"])]
    squares, freedom = 0.0, 0
    for _, of_site in loads.groupby("site"):
        curve = of_site.groupby("depth_mm")["fz"].mean()
        if len(curve) < 2:
            continue
        slopes = pd.Series(np.gradient(curve.to_numpy(), curve.index.to_numpy()), curve.index)
        means = of_site.groupby("depth_mm")["fz"]
        repeated = of_site[means.transform("size") > 1]
        k, off = repeated["depth_mm"].map(slopes), repeated["fz"] - means.transform("mean")
        sums = pd.DataFrame(
            {
                "press": repeated["press"],
                "kf": k * off,
                "kk": k**2,
                "noise": (k * repeated["noise"]) ** 2,
                "zero": k * repeated["zero"],
            }
        )
        sums = sums.groupby("press").sum()
        sums = sums[sums["kk"] > 0]
        if len(sums) < 2:
            continue
        own = ((sums["noise"] + sums["zero"] ** 2) / sums["kk"] ** 2).mean()
        squares += ((sums["kf"] / sums["kk"]) ** 2).sum() - (len(sums) - 1) * own
        freedom += len(sums) - 1
    return float(np.sqrt(max(squares / freedom, 0.0))) if freedom >= LEAST_FREEDOM else None
