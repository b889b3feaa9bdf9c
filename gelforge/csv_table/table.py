"""CSV files as people write them: comma or semicolon, decimal point or comma, comments before the header.

Every value is checked where it is read, and an error names file, row, value, limit and remedy. Rows are
numbered as a text editor numbers lines, so that a person finds them.
"""

from __future__ import annotations

import codecs
import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.csv_table.cells import CLOCK, Signs, TableError, few, numbers_of
from gelforge.csv_table.form import STANDARD, CsvForm, is_comment
from gelforge.input_files import NotAFile, another_kind, read_bytes
from gelforge.units import looks_like_a_unit, unit_named

if TYPE_CHECKING:
    import pandas as pd


# longest first
MARKS = {
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
NOTHING = {"", "nan", "na", "n/a", "null"}  # as programs write a value that is not there
SEPARATORS = {  # sign: its name, and the value of the key `separator` where there is one
    ";": ("semicolon", "';'"),
    "\t": ("tab", "tab"),
    "|": ("vertical bar", None),
    ",": ("comma", "','"),
    " ": ("space", "space"),
}


def read_csv(
    path: str | Path,
    *,
    numbers: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    form: CsvForm = STANDARD,
    **texts: Sequence[str],
) -> pd.DataFrame:
    """Return a CSV file as a table.

    Parameters
    ----------
    path : str or Path
        The file.
    numbers : sequence of str
        Columns that must be there and hold a finite number in every row.
    optional_numbers : sequence of str
        Columns of numbers that may be absent or have empty cells (NaN).
    form : CsvForm
        Separator, decimal sign, header and filters; by default a comma, a point and a header.
    texts : sequence of str
        Columns that must be there and have no empty cell.
    optional_texts : sequence of str
        Columns of text that may be absent or have empty cells ("").

    Returns
    -------
    pandas.DataFrame
        The index is the line number in the file. Other columns of the file are kept as text.

    Raises
    ------
    TableError
        For a missing column or cell, a text in place of a number, and a file without rows. The message names file,
        row, value and remedy.
    """
    lines, columns = read_columns(
        path, numbers=numbers, optional_numbers=optional_numbers, form=form, **texts
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
    form: CsvForm = STANDARD,
) -> tuple[list[int], dict[str, list]]:
    """Return the rows' line numbers and the columns of a CSV file.

    Parameters
    ----------
    path : str or Path
        The file.
    numbers, optional_numbers, texts, optional_texts, form
        As of `read_csv`.

    Returns
    -------
    list of int
        Of each row, counted from 1 as a text editor does.
    dict of str to list
        By column, float for numbers and str for all others.

    Raises
    ------
    TableError
        As `read_csv`.
    """
    path = Path(path)
    header, signs, rows = _split(path, form, [*numbers, *texts])
    if form.header and form.units_row is not False:
        _drop_units(path, header, rows, form, numbers)
    _filter(path, header, rows, form, signs)
    if len(rows) < 2:
        raise TableError(f"{path}: no rows below the header; at least one is needed")
    lines = [line for line, _ in rows[1:]]
    columns: dict[str, list] = dict(zip(header, map(list, zip(*(cells for _, cells in rows[1:])))))
    for name in (*optional_numbers, *optional_texts):
        columns.setdefault(name, [""] * len(lines))
    for name in (*numbers, *optional_numbers):
        clock = name in numbers and form.units.get(name) == CLOCK
        columns[name] = numbers_of(path, name, lines, columns[name], signs, clock, name in optional_numbers)
    for name in texts:
        if "" in columns[name]:
            raise TableError(f"{path}, row {lines[columns[name].index('')]}: {name} is empty; fill it")
    return lines, columns


def read_comments(path: str | Path) -> list[str]:
    """Return the comment lines above the header, without their mark.

    Parameters
    ----------
    path : str or Path
        A file in UTF-8 whose comments begin with # or %.

    Returns
    -------
    list of str
        In their order.

    Raises
    ------
    TableError
        As `lines_of`.
    """
    comments = []
    for line in lines_of(Path(path), STANDARD):
        text = line.strip()
        if text and text[0] not in "#%":
            break
        comments.append(text.lstrip("#% "))
    return comments


def lines_of(path: Path, form: CsvForm) -> list[str]:
    """Return the lines of a text file, whose byte order mark decides its encoding where there is one.

    Parameters
    ----------
    path : Path
        The file.
    form : CsvForm
        States the encoding of a file without a mark.

    Returns
    -------
    list of str
        Without line ends.

    Raises
    ------
    TableError
        For a file that cannot be read, is of another kind or encoding, or holds a null character.
    """
    try:
        content = read_bytes(path)
        text = content.decode(
            next((name for mark, name in MARKS.items() if content.startswith(mark)), form.encoding)
        )
    except NotAFile as error:
        raise TableError(str(error)) from None
    except UnicodeError as error:
        name = "UTF-8" if form.encoding.startswith("utf-8") else form.encoding
        where = f"byte {error.start}" if isinstance(error, UnicodeDecodeError) else "the text"
        words = another_kind(path, "a table (CSV)") or (
            f": {where} is not {name}; save the file as {name} text, or name its encoding, as `table: {{encoding: cp1252}}`"
            " of a mapping"
        )
        raise TableError(f"{path}{words}") from None
    if "\0" in text:
        row = text.count("\n", 0, text.index("\0")) + 1
        utf_16 = "utf-16-be" if text.startswith("\0") else "utf-16-le"
        damaged = (
            f", row {row}: a null character; the file is damaged or no {form.encoding} text (of UTF-16 without its mark set"
            f" `encoding: {utf_16}`)"
        )
        raise TableError(f"{path}{another_kind(path, 'a table (CSV)') or damaged}")
    return text.splitlines()


def _split(
    path: Path, form: CsvForm, needed: Sequence[str]
) -> tuple[list[str], Signs, list[tuple[int, list[str]]]]:
    """Return the header, how numbers are written and all rows (header first) as (line number, cells)."""
    lines = lines_of(path, form)[: form.last_line]
    start = _header_line(path, lines, form, needed)
    separator = form.separator or (";" if ";" in lines[start] else ",")
    reader = csv.reader(lines[start:], delimiter=separator, skipinitialspace=separator == " ")
    try:
        rows = [(start + reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    except csv.Error as error:
        raise TableError(
            f"{path}, row {start + reader.line_num}: {error}; look for a quotation mark that is not closed"
        ) from None
    rows = [(line, cells) for line, cells in rows if any(cells)]
    if separator == " ":  # several count as one, so those at the end of a line move nothing
        rows = [(line, _without_trailing(cells)) for line, cells in rows]
    if not form.header:
        rows.insert(0, (start + 1, [str(i + 1) for i in range(form.columns or len(rows[0][1]))]))
    named, header = len(rows[0][1]), _without_trailing(rows[0][1])
    rows[0] = (rows[0][0], header)
    missing = [name for name in needed if name not in header]
    if missing:
        remedy = _other_separator(lines, header, separator, form, needed)
        raise TableError(
            f"{path}, row {start + 1}: columns {missing} are missing; found {few(header)}"
            f"{remedy or ', name them so in the header or add them'}"
        )
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise TableError(
            f"{path}, row {start + 1}: columns {few(twice)} are there twice; rename one, or number"
            " them with `header: false`, `skip_rows` and `columns`"
        )
    _check_lengths(path, header, rows, named, form)
    rows[1:] = [(line, cells[: len(header)]) for line, cells in rows[1:]]
    return header, Signs(form.decimal or (".," if separator == ";" else "."), form.thousands), rows


def _other_separator(
    lines: list[str], header: list[str], used: str, form: CsvForm, needed: Sequence[str]
) -> str:
    """Return what to do where the values seem to be separated by another sign than the one used; "" where not.

    It is the one by which a line holds all columns needed or, of a table of one column, the one that `csv.Sniffer` sees.
    """
    others = [sign for sign in SEPARATORS if sign != used]
    separator = next((s for s in others if any(names_all(line, s, needed) for line in lines)), None)
    if separator is None and len(header) > 1:
        return ""
    if separator is None:
        try:
            separator = csv.Sniffer().sniff("\n".join(lines), "".join(others)).delimiter
        except csv.Error:
            return ""
    name, key = SEPARATORS[separator]
    seen = f"{' in one column' if len(header) == 1 else ''}: the values seem to be separated by {name}s"
    if form.separator is None or key is None:
        return f"{seen}, save the table with commas or semicolons"
    return f"{seen}, set `separator: {key}` in `table`"


def _header_line(path: Path, lines: list[str], form: CsvForm, needed: Sequence[str]) -> int:
    """Return the number from 0 of the header line; without a header that of the first row."""
    if form.header_begins_with is not None:
        headers = [i for i, line in enumerate(lines) if line.strip().startswith(form.header_begins_with)]
        if not headers:
            raise TableError(
                f"{path}: no line begins with {form.header_begins_with!r}; correct `header_begins_with`"
            )
        return headers[0]
    candidates = (
        i
        for i, line in enumerate(lines)
        if i >= form.skip_rows and line.strip() and not is_comment(line, form)
    )
    start = next(candidates, None)
    separator = form.separator or ","
    if form.find_header and form.header and needed:
        if start is None or not names_all(lines[start], separator, needed):
            elsewhere = [i for i, line in enumerate(lines) if names_all(line, separator, needed)]
            if len(elsewhere) > 1:
                raise TableError(
                    f"{path}, rows {elsewhere[0] + 1} and {elsewhere[1] + 1}: both name the columns {few(needed)}; say with"
                    " `skip_rows` which is the header"
                )
            start = elsewhere[0] if elsewhere else start
    if start is None:
        raise TableError(f"{path}: no header line; the first line that is no comment names the columns")
    return start


def names_all(line: str, separator: str, needed: Sequence[str]) -> bool:
    if not all(name in line for name in needed):
        return False
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=separator == " "), [])
    except csv.Error:
        return False
    return set(needed) <= {cell.strip() for cell in cells}


def _check_lengths(path: Path, header: list[str], rows: list, named: int, form: CsvForm) -> None:
    """Refuse rows of fewer or more cells than the header; named: cells of its line, with the empty ones at its end.

    More cells are separators at the end of a row, and harmless, if the header or every row has them. In one row they may be
    one separator too many farther left, which moves all values that follow into the next column.
    """
    # a row of units may be shorter
    below = rows[2:] if form.header and form.units_row is not False else rows[1:]
    usual = min((len(cells) for _, cells in below), default=named)
    for line, cells in rows[1:]:
        if len(cells) < len(header) or any(cells[len(header) :]):
            raise TableError(
                f"{path}, row {line}: {len(cells)} values for {len(header)} columns; complete the row {few(cells, 3)}"
                " (decimal commas need semicolons between the values, each specimen of a file its header)"
            )
        if len(cells) > max(named, usual):
            raise TableError(
                f"{path}, row {line}: {len(cells)} cells for {len(header)} columns, where other rows have"
                f" {min(len(cells) for _, cells in rows[1:])}: one separator too many moves values into the next column;"
                " remove it, or end every row with it"
            )


def _without_trailing(cells: list[str]) -> list[str]:
    """Return cells without empty ones at the end, which separators at the end of a line leave."""
    count = len(cells)
    while count > 1 and not cells[count - 1]:
        count -= 1
    return cells[:count]


def _drop_units(path: Path, header: list[str], rows: list, form: CsvForm, numbers: Sequence[str]) -> None:
    """Remove a line of units below the header; refuse units other than those declared."""
    if len(rows) < 2:
        return
    line, cells = rows[1]
    said = {name: cell for name, cell in zip(header, cells) if cell}
    recognised = all(map(looks_like_a_unit, said.values())) and any(name in said for name in numbers)
    if any(math.isfinite(Signs(".,").number(said[name])) for name in numbers if name in said):
        recognised = False
        if form.units_row:
            raise TableError(
                f"{path}, row {line}: numbers, where `units_row: true` declares units; set it to false"
            )
    if not recognised and not form.units_row:
        return
    for name, unit in form.units.items():
        stated = unit_named(said.get(name, ""))
        if stated is not None and stated != unit_named(unit):
            raise TableError(
                f"{path}, row {line}: {name} is in {said[name]}, the mapping declares {unit}; set `unit: {stated}`, or"
                " correct the file's line of units"
            )
    del rows[1]


def _filter(path: Path, header: list[str], rows: list, form: CsvForm, signs: Signs) -> None:
    """Remove the rows of others in one table, and those that the filters do not keep."""
    complete, columns = rows[1:], [header.index(name) for name in form.shared_with]
    if columns:
        rows[1:] = [row for row in rows[1:] if any(row[1][at].lower() not in NOTHING for at in columns)]
    for condition in form.rows:
        if condition.column not in header:
            raise TableError(
                f"{path}: the filter of rows names the column {condition.column!r}; found {few(header)}, correct `rows`"
            )
        at, before = header.index(condition.column), len(rows) - 1
        texts = {row[1][at] for row in complete}
        rows[1:] = [row for row in rows[1:] if condition.keeps(row[1][at], signs)]
        if before and len(rows) < 2:
            raise TableError(
                f"{path}: the filter of rows by {condition.column} keeps none of {before} rows; correct `rows`"
            )
        if missing := condition.missing(texts, signs):
            raise TableError(
                f"{path}: no row has {few(missing)} in the column {condition.column!r}; found {few(sorted(texts))}, correct"
                " `rows.equals`"
            )
