"""Tables stacked in one file, each below a header of its own: the specimens of one report."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gelforge.csv_table.cells import Signs
from gelforge.csv_table.form import CsvForm
from gelforge.csv_table.table import lines_of, names_all


def blocks(path: Path, needed: Sequence[str], form: CsvForm) -> list[tuple[str, CsvForm]]:
    """Return the title and the form of each table of a file whose header stands again above every one.

    The title is the first text between two tables, "" where there is none. A file with one header is one block.

    Parameters
    ----------
    path : Path
        The file.
    needed : sequence of str
        Columns that every header names.
    form : CsvForm
        How the tables are written.

    Returns
    -------
    list of (str, CsvForm)
        In the order of the file.

    Raises
    ------
    TableError
        For a file that cannot be read.
    """
    separator = form.separator or ","
    if not form.header or not needed:
        return [("", form)]
    lines = lines_of(path, form)
    heads = [i for i in range(form.skip_rows, len(lines)) if names_all(lines[i], separator, needed)]
    heads = [i for i in heads if lines[i].strip().startswith(form.header_begins_with or "")]
    if len(heads) < 2:
        return [("", form)]
    signs = Signs(form.decimal or ".", form.thousands)
    tables, above = [], []  # above: the lines between two tables
    title_from = form.skip_rows
    for head, after in zip(heads, [*heads[1:], len(lines)]):
        last, names = after, _cells(lines[head], separator)
        columns = [names.index(name) for name in needed]
        while last > head + 1 and not _holds_numbers(lines[last - 1], separator, columns, signs):
            last -= 1
        if last == head + 1:  # a header without rows is none of a specimen
            return [("", form)]
        above.append([line for line in lines[title_from:head] if line.strip()])
        tables.append(replace(form, skip_rows=head, last_line=last, header_begins_with=None))
        title_from = last
    usual = len(above[1])  # above the first one stands the head of the whole file too
    return [
        (_title(lines_above[max(len(lines_above) - usual, 0) :], separator), part)
        for lines_above, part in zip(above, tables)
    ]


def _cells(line: str, separator: str) -> list[str]:
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=separator == " "), [])
    return [cell.strip() for cell in cells]


def _holds_numbers(line: str, separator: str, columns: list[int], signs: Signs) -> bool:
    """Return whether a line has a number, or a time of a clock, in one of the columns that have to hold one."""
    cells = _cells(line, separator)
    texts = [cells[at] for at in columns if at < len(cells)]
    return len(texts) == len(columns) and any(
        math.isfinite(v) for t in texts for v in (signs.number(t), signs.seconds(t))
    )


def _title(lines: list[str], separator: str) -> str:
    return next((cell for line in lines for cell in _cells(line, separator) if cell), "")
