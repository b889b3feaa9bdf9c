"""Logs as times and values in s, N and mm; what a header contradicts or a clock cannot mean is refused."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import given
from gelforge.config.foreign.importing import ForceSource, StageSource, Stamp
from gelforge.config.foreign.mapping import TableForm
from gelforge.csv_table import TableError, read_columns, read_csv
from gelforge.importing.gcode import gcode_table
from gelforge.importing.messages import is_bag, message_table
from gelforge.importing.refusals import ImportingError, refuse_pickle
from gelforge.recording.plausibility.streams import COARSEST_TICK_S, spread_stamps
from gelforge.units import UNITS, known_unit, unit_named

LEAST_ROWS = 20
UNEVEN_S = 0.25  # off the straight line through stamps that are declared even: samples were lost
JUMP_MM, JUMP_MM_PER_S = 20.0, 3000.0  # from row to row, and so fast: no stage or robot that presses gels
GAP_PERIODS = 10.0  # of a log without samples, and at least GAP_S: no clock can be aligned across it
GAP_S = 0.5


@dataclass(frozen=True)
class Stream:
    """A log: times (n,) [s] since its first row, which its clock shows as `start_s`, and values (n, k)."""

    path: Path
    start_s: float
    time_s: np.ndarray
    values: np.ndarray

    @property
    def period_s(self) -> float:
        """Return the median time between rows [s]."""
        return float(np.median(np.diff(self.time_s)))


def read_force(folder: Path, source: ForceSource, stage: StageSource) -> Stream:
    """Return the force log (n, 3) [N] as recorded."""
    return _read(folder, source, "force", dict.fromkeys(source.columns, source.unit), stage)


def read_stage(folder: Path, source: StageSource, force: ForceSource) -> Stream:
    """Return the stage log (n, 3): x, y and travel [mm], which grows as the stage presses deeper."""
    units = dict.fromkeys(_columns(source), source.unit)
    log = _read(folder, source, "stage", units, force)
    columns = dict(zip(units, log.values.T))
    x, y = (
        columns[axis] if isinstance(axis, str) else np.full(len(log.time_s), axis)
        for axis in (source.x, source.y)
    )
    travel = columns[source.z] * (-1 if source.pressing == "-z" else 1)
    xyz = np.stack([x, y, travel], axis=1)
    refuse_jumps(log.path, log.time_s, xyz)
    return Stream(log.path, log.start_s, log.time_s, xyz)


def _columns(source: ForceSource | StageSource) -> list[str]:
    if isinstance(source, ForceSource):
        return source.columns
    return [name for name in (source.x, source.y, source.z) if isinstance(name, str)]


def _read(
    folder: Path,
    source: ForceSource | StageSource,
    key: str,
    units: dict[str, str],
    other: ForceSource | StageSource,
) -> Stream:
    path = folder / source.file
    refuse_pickle(path)
    for name, unit in units.items():
        refuse_other_unit(path, name, unit, key)
    numbers, texts = list(units), []
    declared = dict(units)
    if source.time and source.time.unit == "iso":
        texts.append(source.time.column)
    elif source.time:
        numbers.append(source.time.column)
        declared[source.time.column] = source.time.unit
        refuse_other_unit(path, source.time.column, source.time.unit, f"{key}.time")
    table = _table(folder, path, source, other, key, units, declared, numbers, texts)
    if len(table) < LEAST_ROWS:
        raise ImportingError(
            f"{path}: {len(table)} rows, at least {LEAST_ROWS} are needed; name the whole log"
        )
    made = source.gcode if isinstance(source, StageSource) else None
    time = stamps(path, table, source.time, (made or source).rate_hz, source.even, key)
    refuse_gaps(path, time, key)
    factor = UNITS[known_unit(next(iter(units.values())))][1]
    return Stream(path, float(time[0]), time - time[0], table[list(units)].to_numpy(float) * factor)


def _table(folder, path, source, other, key, units, declared, numbers, texts) -> pd.DataFrame:
    """Return the columns of a log, from the kind of file that it is."""
    if is_bag(path):
        if texts:
            raise ImportingError(f"{path}: stamps of messages are numbers; set {key}.time.unit: s")
        return message_table(path, source.topic, numbers, source.frame_id, key)
    if source.topic:
        raise ImportingError(f"{path}: no bag or MCAP file, {key}.topic does not apply; leave it out")
    if isinstance(source, StageSource) and source.gcode:
        return gcode_table(path, numbers, source.gcode)
    try:
        return read_csv(path, numbers=numbers, texts=texts, form=source.table.csv_form(declared))
    except TableError as error:
        elsewhere, other_key = folder / other.file, "stage" if key == "force" else "force"
        swapped = (
            not is_bag(elsewhere)
            and _holds(elsewhere, list(units), source.table)
            and _holds(path, _columns(other), other.table)
        )
        if "are missing" in str(error) and swapped:
            raise ImportingError(
                f"{path}: holds the columns of {other_key}, and {elsewhere} those of {key}; exchange {key}.file and"
                f" {other_key}.file"
            ) from None
        raise


def refuse_other_unit(path: Path, column: str, unit: str, key: str) -> None:
    """Raise ImportingError where the name of a column ends in another unit than the declared one."""
    said = re.search(r"[\[({]\s*([^\[\](){}]+?)\s*[\])}]\s*$|_([A-Za-z]{1,3})$", column)
    found = said and unit_named(said.group(1) or said.group(2))
    if found and found != unit_named(unit):
        raise ImportingError(
            f"{path}: the column {column!r} says {found}, {key}.unit says {unit}; set {key}.unit: {found}, or correct the"
            " header"
        )


def _holds(path: Path, names: list[str], form: TableForm) -> bool:
    """Return whether a CSV names all these columns."""
    try:
        read_columns(path, texts=names, form=form.csv_form({}))
    except TableError as error:
        return "is empty" in str(error)  # the columns are there
    return True


def stamps(
    path: Path, table: pd.DataFrame, stamp: Stamp | None, rate_hz: float | None, even: bool, key: str
) -> np.ndarray:
    """Return the times (n,) [s] of the rows of a table, as its clock shows them; shared stamps are spread."""
    if rate_hz:
        return np.arange(len(table)) / rate_hz
    stamp = given(stamp, f"{key}.time")
    if stamp.unit == "iso":
        time = _iso(path, table, stamp.column)
    else:
        time = table[stamp.column].to_numpy(float) * UNITS[known_unit(stamp.unit)][1]
    if even:
        return _even(path, time, key)
    backward = np.flatnonzero(np.diff(time) < 0)
    if len(backward):
        line = table.index[backward[0] + 1]
        raise ImportingError(
            f"{path}, row {line}: the time runs back by {time[backward[0]] - time[backward[0] + 1]:.4g} s; set"
            f" {key}.even: true if rows were taken evenly and only the stamps jitter, else sort the rows by time or"
            " name another column"
        )
    distinct, counts = np.unique(time, return_counts=True)
    if len(distinct) < 2:
        raise ImportingError(f"{path}: all rows have one time; name the column of time stamps in {key}.time")
    if counts.max() > 1:
        tick = float(np.median(np.diff(distinct)))
        if tick > COARSEST_TICK_S:
            raise ImportingError(
                f"{path}: {counts.max()} rows share a stamp of a clock with steps of {tick:.3g} s, the limit is"
                f" {COARSEST_TICK_S} s; name a finer column in {key}.time, or give {key}.rate_hz"
            )
        time = spread_stamps(distinct, counts, tick)
    return time


def _iso(path: Path, table: pd.DataFrame, column: str) -> np.ndarray:
    try:
        dates = pd.to_datetime(table[column], format="ISO8601", utc=True)
    except ValueError:
        parsed = pd.to_datetime(table[column], format="ISO8601", utc=True, errors="coerce")
        line = parsed.index[parsed.isna()][0]
        raise ImportingError(
            f"{path}, row {line}: {column} is {table.at[line, column]!r}, no date and time of ISO 8601; correct the row"
            " or declare the unit of the stamps"
        ) from None
    return dates.astype("datetime64[ns, UTC]").astype("int64").to_numpy() / 1e9


def _even(path: Path, time: np.ndarray, key: str) -> np.ndarray:
    """Return the straight line through stamps (n,) [s]."""
    number = np.arange(len(time))
    slope, offset = np.polyfit(number, time - time[0], 1)
    line = offset + slope * number
    off = np.abs(time - time[0] - line)
    if slope <= 0 or off.max() > UNEVEN_S:
        raise ImportingError(
            f"{path}, row {int(off.argmax()) + 1} below the header: its stamp lies {off.max():.3g} s off the straight line"
            f" through all, the limit is {UNEVEN_S} s: rows were lost; set {key}.even: false"
        )
    return time[0] + line


def refuse_jumps(path: Path, time: np.ndarray, xyz: np.ndarray) -> None:
    """Raise ImportingError where positions (n, 3) [mm] jump, as where rows are of two robots or of two frames."""
    steps = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
    far = np.flatnonzero((steps > JUMP_MM) & (steps > JUMP_MM_PER_S * np.diff(time)))
    if len(far):
        k = int(far[0])
        raise ImportingError(
            f"{path}: the position jumps by {steps[k]:.4g} mm within {(time[k + 1] - time[k]) * 1e3:.3g} ms,"
            f" {time[k]:.6g} s after its beginning ({len(far)} times), the limit is {JUMP_MM_PER_S:g} mm/s: rows of two"
            " robots or of two frames are in one log; keep those of one (of a topic: stage.frame_id)"
        )


def refuse_gaps(path: Path, time: np.ndarray, key: str) -> None:
    """Raise ImportingError where a log has no rows for long."""
    steps = np.diff(time)
    limit = max(GAP_S, GAP_PERIODS * float(np.median(steps)))
    if steps.max() > limit:
        at = int(steps.argmax())
        raise ImportingError(
            f"{path}: no row between {time[at] - time[0]:.6g} and {time[at + 1] - time[0]:.6g} s after its beginning, the"
            f" limit is {limit:.3g} s; record without gaps, or split the session there into two files of {key}"
        )
