"""Other people's files to the common form, as a mapping declares them; every value is checked at the edge."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config.foreign.mapping import (
    Column,
    Corrections,
    Mapping,
    Microindentation,
    Stress,
    TestMapping,
    load_microindentation,
)
from gelforge.csv_table import CsvForm, TableError, blocks, read_csv
from gelforge.csv_table.cells import Signs, few
from gelforge.materials.basis.common_form import ForcePair, IndentationTest, MaterialTest
from gelforge.materials.basis.statistics import ROWS_OF_CURVE
from gelforge.materials.plausibility.falls import fall_while_loading, fall_words
from gelforge.materials.plausibility.findings import corrected, findings, rate_while_loading
from gelforge.materials.plausibility.odd_rows import check_rows
from gelforge.materials.readers.mapped_checks import (
    check_also,
    check_declared_rate,
    check_range,
    check_stiffness,
    checked_segments,
)
from gelforge.materials.readers.mapped_columns import (
    lateral_of,
    nominal_stress_of,
    number_in_name,
    stretch_of,
    values,
)
from gelforge.materials.readers.mapped_contacts import check_modulus, force_pair, indentation_test
from gelforge.section import ConfigError
from gelforge.units import UNITS, unit_in_header

Read = MaterialTest | IndentationTest | ForcePair


def read_mapped_folder(folder: str | Path, mapping: Mapping) -> list[Read]:
    """Return the tests of all files below a folder that the mapping does not ignore, in the order of names.

    Their `source` is the path below the folder.
    """
    folder = Path(folder)
    everything = sorted(path for path in folder.rglob("*") if not path.name.startswith("."))
    paths = [path for path in everything if not path.is_dir()]
    _check_folders(folder, mapping, [path for path in everything if path.is_dir()], paths)
    names = [path.relative_to(folder).as_posix() for path in paths]
    entries = [mapping.entries_for(name) for name in names]
    tests: list[Read] = [
        replace(test, source=name)
        for path, name, matching in zip(paths, names, entries)
        for test in read_by_all(path, matching)
    ]
    if not tests:
        raise TableError(
            f"{folder}: none of its {len(names)} files is read as a test; `ignore` is {mapping.ignore}, correct it, or name"
            f" the folder of {mapping.describes}"
        )
    _check_entries(folder, mapping, names, entries)
    for entry in mapping.tests:
        _check_values(folder, entry, [path for path, matching in zip(paths, entries) if entry in matching])
    return tests


def read_by_all(path: Path, entries: Sequence[TestMapping]) -> list[Read]:
    """Return the tests that all of the entries read of one file; of several with one kind the stress names the sample."""
    kinds = Counter(entry.kind for entry in entries)
    return [
        replace(test, sample=f"{test.sample}_{column.column}")
        if kinds[entry.kind] > 1
        and (column := entry.stress or entry.force)
        and isinstance(test, MaterialTest)
        else test
        for entry in entries
        for test in read_mapped(path, entry)
    ]


def _check_entries(folder: Path, mapping: Mapping, names: Sequence[str], used: Sequence) -> None:
    """Refuse an entry that reads no file, as its pattern is misspelt or an earlier entry takes all of it, or names none."""
    reading = {id(entry) for matching in used for entry in matching}
    there = {*names, *(name.rsplit("/", 1)[-1] for name in names)}
    for number, entry in enumerate(mapping.tests, 1):
        missing = [name for name in entry.files if not set(name) & set("*?[") and name not in there]
        if not entry.optional and (missing or id(entry) not in reading):
            raise TableError(
                f"{folder}: entry {number} of the mapping ({entry.kind}, files {missing or entry.files}) reads no file;"
                " correct `files`, move it before an entry that takes its files, repeat that entry's pattern if both read"
                " one table, or set `optional: true`"
            )


def _check_values(folder: Path, entry: TestMapping, paths: Sequence[Path]) -> None:
    """Refuse a value of a filter of rows that no file of its entry has: it is misspelt, and its rows are missed."""
    for row in entry.rows:
        if not row.equals:
            continue
        form = entry.table.csv_form({})
        tables = [
            read_csv(path, optional_texts=[row.column], form=part)
            for path in paths
            for _, part in blocks(path, [row.column], form)
        ]
        texts = {text for table in tables for text in table[row.column]}
        signs = Signs(entry.table.decimal, entry.table.thousands)
        if missing := row.filter().missing(texts, signs):
            raise TableError(
                f"{folder}: no file of {entry.files} has {few(missing)} in the column {row.column!r}; found"
                f" {few(sorted(texts))}, correct `rows.equals`"
            )


def _check_folders(folder: Path, mapping: Mapping, folders: Sequence[Path], files: Sequence[Path]) -> None:
    """Refuse an empty folder that has the name of a file of a test, ending included: a copy that went wrong."""
    for path in folders:
        if not path.suffix or any(path in file.parents for file in files):
            continue
        try:
            entry = mapping.entry_for(path.relative_to(folder).as_posix())
        except ConfigError:  # no name of a test: what a folder may have
            continue
        if entry and any(pattern.endswith(path.suffix) for pattern in entry.files):
            found = "an empty folder where a file of a test is expected"
            raise TableError(f"{path}: {found}; put the file there, or remove it")


def read_mapped(path: str | Path, entry: TestMapping) -> list[Read]:
    """Return the tests of one file: one, or one per value of the column that splits it.

    Raises TableError with file, row, value, limit and remedy for what cannot be right.
    """
    path = Path(path)
    named, columns = _from_name(path, entry), _columns(entry)
    _check_headers(path, columns)
    form = _form(entry, columns)
    stacked = blocks(path, list(dict.fromkeys(column.column for column in columns)), form)
    tests: list[Read] = []
    for number, (title, part) in enumerate(stacked, 1):
        table = _table(path, entry, columns, part)
        suffix = (title or f"{path.stem}_{number}") if len(stacked) > 1 else ""
        groups = table.groupby(entry.split, sort=False) if entry.split else [("", table)]
        parts = (("_".join(filter(None, (suffix, str(value)))), rows) for value, rows in groups)
        tests += [_test(path, entry, rows, name, dict(named)) for name, rows in parts]
    return tests


def read_microindentation(
    path: str | Path, like: Microindentation | None = None
) -> tuple[IndentationTest, Microindentation]:
    """Return an indentation in the project's own format, <name>.csv with <name>.yaml, and what that sidecar says.

    like: the sidecar of another indentation with the same ball; then none is read.
    """
    path = Path(path)
    sidecar = like or load_microindentation(path.with_suffix(".yaml"))
    entry = TestMapping(
        files=[path.name],
        kind="indentation",
        height=Column(column="depth_mm", unit="mm"),
        force=Column(column="force_N", unit="N"),
        ball_radius_mm=sidecar.ball_radius_mm,
        corrections=Corrections(odd_rows=sidecar.odd_rows),
    )
    test, *others = read_mapped(path, entry)
    if others:
        raise TableError(
            f"{path}: holds {1 + len(others)} tables below each other; write each to a file of its own"
        )
    assert isinstance(test, IndentationTest)  # by the entry's kind
    if like is None and sidecar.odd_rows == "refuse":  # the board is as stiff as it likes
        check_modulus(path, test, sidecar.ball_radius_mm, sidecar.layer_thickness_mm)
    return test, sidecar


def _columns(entry: TestMapping) -> list[Column]:
    """Return the columns with numbers that an entry names."""
    named = [entry.strain, entry.stress, entry.time, entry.radius, entry.height, entry.force, entry.force_2]
    named += [entry.rate, entry.temperature, *entry.also]
    if entry.lateral:
        named += [entry.lateral.strain, entry.lateral.stress]
    named += [c.at for c in named if isinstance(c, Stress) and c.at]
    return [column for column in named if column]


def _check_headers(path: Path, columns: Sequence[Column]) -> None:
    """Refuse a column whose name in brackets states another unit than the mapping does."""
    for column in columns:
        if getattr(column, "measure", "") == "gap":  # a ratio to the first gap: no unit enters
            continue
        said = unit_in_header(column.column)
        bracketed = column.column.rstrip()[-1:] in (")", "]", "}")
        if said in (None, "1") or said == column.known_unit:
            continue
        if column.known_unit == "h:mm:ss" and UNITS[said][0] == "time":
            continue  # the text itself shows the form, and the reader refuses another one
        if bracketed or UNITS[said][0] == UNITS[column.known_unit][0]:
            raise TableError(
                f"{path}: the column {column.column!r} says {said}, the mapping declares {column.unit}; check the units:"
                f" set `unit: {said}` (and the `measure` that goes with it), or correct the header"
            )


def _form(entry: TestMapping, columns: Sequence[Column]) -> CsvForm:
    """Return how the table of an entry is written; rows without any of its values are those of curves next to it."""
    units = {c.column: c.known_unit for c in columns}
    # a file may lack a value that another one of the entry has (_check_values)
    filters = tuple(row.filter(every=False) for row in entry.rows)
    return entry.table.csv_form(units, filters, tuple(units))


def _table(path: Path, entry: TestMapping, columns: Sequence[Column], form: CsvForm) -> pd.DataFrame:
    texts = [name for name in (entry.split, entry.segment) if name]
    texts += [entry.time.restarts_with] if entry.time and entry.time.restarts_with else []
    numbers = list(dict.fromkeys(column.column for column in columns))
    table = read_csv(path, numbers=numbers, texts=list(dict.fromkeys(texts)), form=form)
    if entry.split is None:
        return table
    # in the order in which they first stand in the file
    return table.sort_values(entry.split, kind="stable", key=lambda column: pd.factorize(column)[0])


def _from_name(path: Path, entry: TestMapping) -> dict[str, str]:
    if entry.from_name is None:
        return {}
    match = re.search(entry.from_name.pattern, path.stem)
    if match is None:
        raise TableError(
            f"{path}: the name does not fit from_name pattern {entry.from_name.pattern!r}; rename the file or correct"
            " the pattern"
        )
    return {key: text for key, text in match.groupdict().items() if text is not None}


def _test(path: Path, entry: TestMapping, table: pd.DataFrame, part: str, named: dict[str, str]) -> Read:
    if len(table) < ROWS_OF_CURVE:
        of = f" of {part}" if part else ""
        raise TableError(f"{path}: {len(table)} rows{of}; {ROWS_OF_CURVE} at least are needed for a test")
    sample = "_".join(word for word in (named.get("sample", "" if part else path.stem), part) if word)
    time, time_said, table = _time(path, entry, table)
    if entry.kind == "indentation":
        return indentation_test(path, entry, table, sample, time, time_said, named)
    if entry.kind == "force_pair":
        return force_pair(path, entry, table, sample, time, time_said)
    return material_test(path, entry, table, sample, time, time_said, named)


def _time(path: Path, entry: TestMapping, table: pd.DataFrame):
    """Return the time (n,) [s] or None, what was corrected, and the table in the order of time."""
    if entry.time is None:
        return None, [], table
    time, said = values(table, entry.time), []
    if entry.time.restarts_with:
        begins = np.flatnonzero(np.diff(pd.factorize(table[entry.time.restarts_with])[0])) + 1
        for a, b in zip(begins, [*begins[1:], len(time)]):
            time[a:b] += time[a - 1]
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        i = int(back[0]) + 1
        row, steps = table.index[i], f"{time[i]:.6g} s after {time[i - 1]:.6g} s"
        if entry.corrections.time == "refuse":
            raise TableError(
                f"{path}, row {row}: {entry.time.column} {steps}; time does not go back: check the column, set"
                " `restarts_with`, or `corrections: {time: sort}` or `{time: set_aside}`"
            )
        if entry.corrections.time == "set_aside":
            return None, [f"corrected: row {row} has {steps}; time set aside"], table
        order = np.argsort(time, kind="stable")
        time, table = time[order], table.iloc[order]
        said.append(f"corrected: {len(back)} rows were earlier than the row before; sorted by time")
    if entry.corrections.repeated_time == "average" and (np.diff(time) == 0).any():
        first = np.r_[True, np.diff(time) > 0]
        said.append(f"corrected: {int((~first).sum())} rows with a repeated time stamp averaged into one")
        numbers, kept = table.select_dtypes("number"), table.loc[first].copy()
        kept[numbers.columns] = numbers.groupby(np.cumsum(first)).mean().to_numpy()
        time, table = time[first], kept
    return time, said, table


def material_test(path, entry, table, sample, time, said, named) -> MaterialTest:
    at_rest = 0.0 if entry.kind == "simple_shear" else 1.0
    if entry.corrections.unsorted == "sort" and time is None:
        table, sorted_said = _sorted(path, entry, table)
        said = said + sorted_said
    stretch, gauge_said = stretch_of(path, entry, table, entry.strain)
    lateral, lateral_stress = lateral_of(path, entry, table, stretch)
    nominal, difference = nominal_stress_of(path, entry, table, entry.stress, stretch, lateral)
    temperature = values(table, entry.temperature)
    measured = None if temperature is None else float(np.median(temperature))
    name_rate = number_in_name(path, entry, named, "rate_per_s")
    column_rate = values(table, entry.rate)
    cycle = number_in_name(path, entry, named, "cycle")
    test = MaterialTest(
        entry.kind,
        sample,
        stretch,
        nominal,
        time,
        lateral,
        lateral_stress,
        difference,
        entry.history,
        entry.material or named.get("material", ""),
        age_days=_first(entry.age_days, number_in_name(path, entry, named, "age_days")),
        temperature_C=_first(
            entry.temperature_C, number_in_name(path, entry, named, "temperature_C"), measured
        ),
        dose=number_in_name(path, entry, named, "dose"),
        cycle=None if cycle is None else int(cycle),
        findings=tuple(said + gauge_said),
        source=path.name,
    )
    check_range(path, entry, table, test)
    test = replace(test, segments=checked_segments(path, entry, table, test, at_rest))
    asked = entry.corrections
    fall = None if asked.after_fall == "keep" else fall_while_loading(test)
    if fall:
        stop, text = fall.row + 1, fall_words(fall, table.index)
        if asked.after_fall == "refuse":
            raise TableError(
                f"{path}, {text}; cut the curve there with `corrections: {{after_fall: cut}}`, or confirm it with"
                " `after_fall: keep`"
            )
        if stop < ROWS_OF_CURVE:
            raise TableError(
                f"{path}, {text}: {stop} rows are left before it, {ROWS_OF_CURVE} at least are needed for a test; leave the"
                " test out, or confirm it with `corrections: {after_fall: keep}`"
            )
        said = [*said, f"corrected: {text}; cut there (after_fall)"]
        time = None if time is None else time[:stop]
        return material_test(path, entry, table.iloc[:stop], sample, time, said, named)
    if asked.odd_rows == "refuse":
        remedy = "or confirm it with `corrections: {odd_rows: keep}`"
        check_rows(path, table.index, test, remedy, asked.zero_force, asked.toe == "remove")
    odd = check_stiffness(path, entry, test) + check_also(path, entry, table, test)
    stated, by = _stated_rate(entry, name_rate, column_rate)
    odd += findings(test, stated, by)
    rate = rate_while_loading(test)
    check_declared_rate(path, entry, rate)
    test = replace(test, rate_per_s=rate[0] if rate else stated, findings=(*test.findings, *odd))
    of_gauge = entry.strain is not None and entry.strain.measure in ("displacement", "engineering")
    return corrected(test, asked.toe == "remove", asked.zero_force, asked.zero_strain, of_gauge)


def _sorted(path: Path, entry: TestMapping, table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Return a table in the order of its strain, away from rest, and what was done."""
    assert entry.strain is not None  # by the entry's kind
    stretch = stretch_of(path, entry, table, entry.strain)[0]
    at_rest = 0.0 if entry.kind == "simple_shear" else 1.0
    away = np.sign(stretch[np.argmax(np.abs(stretch - at_rest))] - at_rest) or 1.0
    order = np.argsort(away * stretch, kind="stable")
    moved = int((order != np.arange(len(order))).sum())
    return table.iloc[order], [f"corrected: {moved} rows sorted by stretch (unsorted)"] if moved else []


def _first(*values):
    return next((value for value in values if value is not None), None)


def _stated_rate(entry, name_rate, column_rate) -> tuple[float | None, str]:
    if name_rate is not None:
        return name_rate, "is in the file's name"
    if column_rate is not None:
        return float(np.median(column_rate)), f"is in column {entry.rate.column}"
    return entry.rate_per_s, "is declared in the mapping"
