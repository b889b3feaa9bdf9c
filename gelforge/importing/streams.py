"""Logs as times and values in s, N and mm; what a header contradicts or a clock cannot mean is refused."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config.foreign.importing import ForceSource, StageSource
from gelforge.config.foreign.table_form import TableForm
from gelforge.csv_table import TableError, lines_of, read_columns, read_csv
from gelforge.importing.gcode import gcode_table
from gelforge.importing.messages import is_bag, message_table
from gelforge.importing.refusals import ImportingError, refuse_pickle
from gelforge.importing.time_stamps import stamps, units_of
from gelforge.units import UNITS, known_unit, unit_in_header, unit_named

# Faulty logs are refused and their right neighbours read (benchmarks/faults.py, inputs):
LEAST_ROWS = 20  # fewer show no indentation with its waits
# From row to row, and so fast: no stage or robot that presses gels. Rows of two robots 450 mm apart are refused
# (tests/importing/test_raw_files.py).
JUMP_MM, JUMP_MM_PER_S = 20.0, 3000.0
# Of a log without samples: no clock can be aligned across it. 30 missing rows of a stage's log, a second, are refused
# (tests/importing/test_raw_files.py).
GAP_PERIODS, GAP_S = 10.0, 0.5
COUNTS = re.compile(  # to a unit of force, not of torque: N m, N-m, Nmm
    r"(?:counts?\s*(?:per|/)\s*(?:unit\s*)?(?:force|newtons?|N)\b(?![\s*·⋅.-]*m{1,2}\b)|\bCpF\b)[^\d-]*"
    r"([1-9]\d{0,2}(?:,\d{3})+|[\d.eE+]*[1-9][\d.eE+]*)",
    re.IGNORECASE,
)
FORCE_UNIT = re.compile(r"force\s*units?\W+([A-Za-z]+)", re.IGNORECASE)


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
    """Return the force log (n, 3) [N] as recorded, counts divided by those of a unit."""
    log = _read(folder, source, "force", dict.fromkeys(source.columns, source.unit), stage)
    said = counts_above_header(log.path, source, log.values)
    counts = source.counts_per_unit or said
    if said and counts != said:
        raise ImportingError(
            f"{log.path}: {said:g} counts to one {source.unit} stand above the header, force.counts_per_unit is {counts:g};"
            " leave the key out, or correct the file"
        )
    return log if counts is None else replace(log, values=log.values / counts)


def counts_above_header(path: Path, source: ForceSource, values: np.ndarray) -> float | None:
    """Return the counts to one unit of force that a line above the header states, as ATI's programs write it.

    None for values that are no whole numbers: they are forces already. Raises ImportingError where the lines state another
    unit than the mapping.
    """
    recorded = values / UNITS[known_unit(source.unit)][1]
    if is_bag(path) or not (np.abs(recorded - np.round(recorded)) < 1e-6).all():
        return None
    top = lines_of(path, source.table.csv_form({}))[:100]
    head = next((i for i, line in enumerate(top) if all(name in line for name in source.columns)), 0)
    counts = None
    for line in top[:head]:
        if match := COUNTS.search(line):
            counts = float(match.group(1).replace(",", ""))
        said = FORCE_UNIT.search(line)
        unit = unit_named(said.group(1)) if said else None
        if unit and unit != known_unit(source.unit):
            raise ImportingError(
                f"{path}: a line above the header says {line.strip()!r}, force.unit says {source.unit}; set"
                f" force.unit: {unit}"
            )
    return counts


def read_stage(folder: Path, source: StageSource, force: ForceSource) -> Stream:
    """Return the stage log (n, 3): x, y and travel [mm], which grows as the stage presses deeper."""
    units = dict.fromkeys(_columns(source), source.unit)
    polar = source.polar
    log = _read(folder, source, "stage", units, force, [polar.angle] if polar else [])
    columns = dict(zip([*units, polar.angle] if polar else units, log.values.T))
    if polar:
        angle = np.deg2rad(columns[polar.angle])
        x, y = columns[polar.radius] * np.cos(angle), columns[polar.radius] * np.sin(angle)
    else:
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
    named = (source.polar.radius, source.z) if source.polar else (source.x, source.y, source.z)
    return [name for name in named if isinstance(name, str)]


def _read(
    folder: Path,
    source: ForceSource | StageSource,
    key: str,
    units: dict[str, str],
    other: ForceSource | StageSource,
    plain: Sequence[str] = (),
) -> Stream:
    """Return a log with the columns of `units`, in mm and N, then the plain ones as they are."""
    path = folder / source.file
    refuse_pickle(path)
    for name, unit in units.items():
        refuse_other_unit(path, name, unit, key)
    numbers, texts = [*units, *plain], []
    declared = dict(units)
    if source.time and source.time.is_date:
        texts += source.time.columns
    elif source.time:
        numbers += source.time.columns
        declared |= units_of(source.time)
        for column, unit in units_of(source.time).items():
            refuse_other_unit(path, column, unit, f"{key}.time")
    table = _table(folder, source, other, key, units, declared, numbers, texts)
    if len(table) < LEAST_ROWS:
        raise ImportingError(
            f"{path}: {len(table)} rows, at least {LEAST_ROWS} are needed; name the whole log"
        )
    made = source.gcode if isinstance(source, StageSource) else None
    time = stamps(path, table, source.time, (made or source).rate_hz, source.even, key)
    if not without_lag(source, other):
        refuse_gaps(path, time, key)
    factor = UNITS[known_unit(next(iter(units.values())))][1]
    values = [table[list(units)].to_numpy(float) * factor, table[list(plain)].to_numpy(float)]
    return Stream(path, float(time[0]), time - time[0], np.hstack(values))


def without_lag(one: ForceSource | StageSource, other: ForceSource | StageSource) -> bool:
    """Return whether force and stage are columns of one table whose lag is given: no clock is aligned across its gaps."""
    given = any(isinstance(source, ForceSource) and source.lag_s is not None for source in (one, other))
    same = ("file", "table", "rows", "topic", "time", "rate_hz", "even")
    return given and not one.topic and all(getattr(one, key) == getattr(other, key) for key in same)


def _table(folder, source, other, key, units, declared, numbers, texts) -> pd.DataFrame:
    """Return the columns of a log, from the kind of file that it is."""
    path = folder / source.file
    if is_bag(path):
        if texts:
            raise ImportingError(f"{path}: stamps of messages are numbers; set {key}.time.unit: s")
        return message_table(path, source.topic, numbers, source.frame_id, key)
    if source.topic:
        raise ImportingError(f"{path}: no bag or MCAP file, {key}.topic does not apply; leave it out")
    if isinstance(source, StageSource) and source.gcode:
        return gcode_table(path, numbers, source.gcode)
    try:
        # A table of several topics has rows without any of these values. Where rows stand for the time each one counts.
        counted = source.rate_hz or source.even
        filters = tuple(row.filter() for row in source.rows)
        form = source.table.csv_form(declared, filters, () if counted else tuple(units))
        return read_csv(path, numbers=numbers, texts=texts, form=form)
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
    stated, declared = unit_in_header(column), unit_named(unit)
    # 0:03:12 under "Time (s)": the text itself shows the form, and the reader refuses another one
    clock = declared == "h:mm:ss" and stated and UNITS[stated][0] == "time"
    if stated and stated != declared and not clock:
        raise ImportingError(
            f"{path}: the column {column!r} says {stated}, {key}.unit says {unit}; set {key}.unit: {stated}, or correct the"
            " header"
        )


def _holds(path: Path, names: list[str], form: TableForm) -> bool:
    """Return whether a CSV names all these columns."""
    try:
        read_columns(path, texts=names, form=form.csv_form({}))
    except TableError as error:
        return "is empty" in str(error)  # the columns are there
    return True


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


def gap_limit_s(time: np.ndarray) -> float:
    """Return the longest time between two rows of a log that is no gap [s]."""
    return max(GAP_S, GAP_PERIODS * float(np.median(np.diff(time))))


def refuse_gaps(path: Path, time: np.ndarray, key: str) -> None:
    """Raise ImportingError where a log has no rows for long."""
    steps, limit = np.diff(time), gap_limit_s(time)
    if steps.max() > limit:
        at = int(steps.argmax())
        raise ImportingError(
            f"{path}: no row between {time[at] - time[0]:.6g} and {time[at + 1] - time[0]:.6g} s after its beginning, the"
            f" limit is {limit:.3g} s: rows were lost, or the clock was set; record without gaps, or split the session there"
            f" into two files of {key}"
        )
