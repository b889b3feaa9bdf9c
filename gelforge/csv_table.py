"""CSV files as people write them: comma or semicolon, decimal point or comma, comments before the header.

Every value is checked where it is read, and an error names file, row, value, limit and remedy. Rows are
numbered as a text editor numbers lines, so that a person finds them.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


class TableError(ValueError):
    """A table that cannot be used: file, row, value found, limit, remedy."""


@dataclass(frozen=True)
class CsvForm:
    """How a table is written. Separator and decimal sign None: comma or semicolon, as the header line shows."""

    separator: str | None = None
    decimal: str | None = None
    encoding: str = "utf-8-sig"
    comment: str = "#%"  # each of these signs begins a comment line above the header
    skip_rows: int = 0  # lines above the header (or above the first row) that are not part of the table
    header: bool = True  # without a header the columns are called 1, 2, 3, ...
    columns: int | None = None  # their number where there is no header; None: as many as the first row has


def read_csv(
    path: str | Path,
    *,
    numbers: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    texts: Sequence[str] = (),
    optional_texts: Sequence[str] = (),
    form: CsvForm = CsvForm(),
) -> pd.DataFrame:
    """Return a CSV file as a table whose index is the line number in the file.

    numbers: columns that must be there and hold a finite number in every row; optional_numbers: may be absent
    or empty (NaN). texts: columns that must be there and not be empty; optional_texts: may be absent or empty
    (""). Other columns are kept as text.
    """
    lines, columns = read_columns(
        path,
        numbers=numbers,
        optional_numbers=optional_numbers,
        texts=texts,
        optional_texts=optional_texts,
        form=form,
    )
    import pandas as pd  # a third of a second, which who reads columns does without

    typed = {
        name: values if name in (*numbers, *optional_numbers) else pd.Series(values, lines, str)
        for name, values in columns.items()
    }
    return pd.DataFrame(typed, index=lines)


def read_columns(
    path: str | Path,
    *,
    numbers: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    texts: Sequence[str] = (),
    optional_texts: Sequence[str] = (),
    form: CsvForm = CsvForm(),
) -> tuple[list[int], dict[str, list]]:
    """Return the line numbers and the columns of a CSV file, checked as by `read_csv`."""
    path = Path(path)
    header, decimal, rows = _split(path, form)
    missing = [name for name in (*numbers, *texts) if name not in header]
    if missing:
        raise TableError(
            f"{path}, row {rows[0][0] if rows else 1}: columns {missing} are missing; found {header},"
            " name them so in the header or add them"
        )
    if len(rows) < 2:
        raise TableError(f"{path}: no rows below the header; at least one is needed")
    lines = [line for line, _ in rows[1:]]
    columns: dict[str, list] = dict(zip(header, map(list, zip(*(cells for _, cells in rows[1:])))))
    for name in numbers:
        columns[name] = _numbers(path, name, lines, columns[name], decimal, empty_allowed=False)
    for name in optional_numbers:
        given = columns.get(name)
        columns[name] = (
            [math.nan] * len(lines) if given is None else _numbers(path, name, lines, given, decimal, True)
        )
    for name in texts:
        if "" in columns[name]:
            raise TableError(f"{path}, row {lines[columns[name].index('')]}: {name} is empty; fill it")
    for name in optional_texts:
        columns.setdefault(name, [""] * len(lines))
    return lines, columns


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


def _split(path: Path, form: CsvForm) -> tuple[list[str], str, list[tuple[int, list[str]]]]:
    """Return the header, the decimal sign(s) and all rows (header first) as (line number, cells)."""
    try:
        lines = path.read_bytes().decode(form.encoding).splitlines()
    except FileNotFoundError:
        raise TableError(f"{path}: no such file; name one that exists") from None
    except UnicodeDecodeError as error:
        name = "UTF-8" if form.encoding.startswith("utf-8") else form.encoding
        raise TableError(f"{path}: byte {error.start} is not {name}; save the file as {name} text") from None
    start = next(
        (
            i
            for i, line in enumerate(lines)
            if i >= form.skip_rows and line.strip() and not _comment(line, form)
        ),
        None,
    )
    if start is None:
        raise TableError(f"{path}: no header line; the first line that is no comment names the columns")
    separator = form.separator or (";" if ";" in lines[start] else ",")
    reader = csv.reader(lines[start:], delimiter=separator, skipinitialspace=separator == " ")
    rows = [(start + reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    rows = [(line, cells) for line, cells in rows if any(cells)]
    if not form.header:
        rows.insert(0, (start + 1, [str(i + 1) for i in range(form.columns or len(rows[0][1]))]))
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
    return header, form.decimal or (".," if separator == ";" else "."), rows


def _comment(line: str, form: CsvForm) -> bool:
    return line.lstrip()[0] in form.comment


def _numbers(
    path: Path, name: str, lines: list[int], column: list[str], decimal: str, empty_allowed: bool
) -> list[float]:
    """Return a column of text as numbers; decimal "." or "," allows only that sign, ".," both."""
    values = []
    for line, text in zip(lines, column):
        if text == "" and empty_allowed:
            values.append(math.nan)
            continue
        try:
            value = float(text.replace(",", ".") if "," in decimal else text)
            if decimal == "," and "." in text:
                value = math.nan  # 1.234 may be a thousand and more, or a fraction: not ours to guess
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            found = repr(text) if text else "nothing"
            raise TableError(
                f"{path}, row {line}: {name} is {found}; a finite number is needed"
                f"{f' (decimal sign {decimal})' if len(decimal) == 1 else ''}, correct or drop the row"
            )
        values.append(value)
    return values
