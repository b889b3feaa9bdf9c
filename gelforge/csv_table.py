"""CSV files as people write them: comma or semicolon, decimal point or comma, comments before the header.

Every value is checked where it is read, and an error names file, row, value, limit and remedy. Rows are
numbered as a text editor numbers lines, so that a person finds them.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd


class TableError(ValueError):
    """A table that cannot be used: file, row, value found, limit, remedy."""


def read_csv(
    path: str | Path,
    *,
    numbers: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    texts: Sequence[str] = (),
    optional_texts: Sequence[str] = (),
) -> pd.DataFrame:
    """Return a CSV file as a table whose index is the line number in the file.

    numbers: columns that must be there and hold a finite number in every row; optional_numbers: may be absent
    or empty (NaN). texts: columns that must be there and not be empty; optional_texts: may be absent or empty
    (""). Other columns are kept as text.
    """
    path = Path(path)
    header, separator, rows = _split(path)
    missing = [name for name in (*numbers, *texts) if name not in header]
    if missing:
        raise TableError(
            f"{path}, row {rows[0][0] if rows else 1}: columns {missing} are missing; found {header}"
        )
    table = pd.DataFrame(
        [cells for _, cells in rows[1:]], columns=header, index=[line for line, _ in rows[1:]], dtype=str
    )
    if table.empty:
        raise TableError(f"{path}: no rows below the header; at least one is needed")
    for name in numbers:
        table[name] = _numbers(path, table[name], separator, empty_allowed=False)
    for name in optional_numbers:
        table[name] = _numbers(path, table[name], separator, True) if name in header else float("nan")
    for name in texts:
        if (table[name] == "").any():
            raise TableError(f"{path}, row {table.index[table[name] == ''][0]}: {name} is empty; fill it")
    for name in optional_texts:
        if name not in header:
            table[name] = ""
    return table


def read_comments(path: str | Path) -> list[str]:
    """Return the comment lines above the header, without their mark."""
    comments = []
    with open(path, encoding="utf-8-sig") as file:
        for line in file:
            text = line.strip()
            if text and text[0] not in "#%":
                break
            comments.append(text.lstrip("#% "))
    return comments


def _split(path: Path) -> tuple[list[str], str, list[tuple[int, list[str]]]]:
    """Return the header, the separator and all rows (header first) as (line number, cells)."""
    try:
        lines = path.read_bytes().decode("utf-8-sig").splitlines()
    except FileNotFoundError:
        raise TableError(f"{path}: no such file; name one that exists") from None
    except UnicodeDecodeError as error:
        raise TableError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text") from None
    start = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), None)
    if start is None:
        raise TableError(f"{path}: no header line; the first line that is no comment names the columns")
    separator = ";" if ";" in lines[start] else ","
    reader = csv.reader(lines[start:], delimiter=separator)
    rows = [(start + reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    rows = [(line, cells) for line, cells in rows if any(cells)]
    header = rows[0][1]
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise TableError(f"{path}, row {start + 1}: columns {twice} are there twice; rename one")
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            raise TableError(
                f"{path}, row {line}: {len(cells)} values for {len(header)} columns; complete the row"
                " (decimal commas need semicolons between the values)"
            )
    return header, separator, rows


def _numbers(path: Path, column: pd.Series, separator: str, empty_allowed: bool) -> list[float]:
    values = []
    for line, text in column.items():
        if text == "" and empty_allowed:
            values.append(math.nan)
            continue
        try:
            value = float(text.replace(",", ".") if separator == ";" else text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            found = repr(text) if text else "nothing"
            raise TableError(
                f"{path}, row {line}: {column.name} is {found}; a finite number is needed,"
                " correct or drop the row"
            )
        values.append(value)
    return values
