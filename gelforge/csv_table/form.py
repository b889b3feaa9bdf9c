"""How a table is written, and which of its rows are read."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from gelforge.csv_table.cells import Signs


@dataclass(frozen=True)
class RowFilter:
    """Which rows are read, by the text or the number in a column."""

    column: str
    equals: tuple[str, ...] | None = None
    at_least: float | None = None
    at_most: float | None = None

    every: bool = True  # each of `equals` stands in the table: one that does not is misspelt

    def keeps(self, text: str, signs: Signs) -> bool:
        """Return whether a row with this text in the column is read."""
        if self.equals is not None and not any(_equal(text, wanted, signs) for wanted in self.equals):
            return False
        if self.at_least is None and self.at_most is None:
            return True
        low = -math.inf if self.at_least is None else self.at_least
        return low <= signs.number(text) <= (math.inf if self.at_most is None else self.at_most)

    def missing(self, texts: Collection[str], signs: Signs) -> list[str]:
        """Return the values that should stand in the column and are none of its texts."""
        wanted = self.equals if self.every and self.equals else ()
        return [value for value in wanted if not any(_equal(text, value, signs) for text in texts)]


def _equal(text: str, wanted: str, signs: Signs) -> bool:
    """Return whether a cell holds a value, as text or as a number."""
    return text == wanted or signs.number(text) == Signs().number(wanted)


@dataclass(frozen=True)
class CsvForm:
    """How a table is written. Separator and decimal sign None: comma or semicolon, as the header line shows."""

    separator: str | None = None
    decimal: str | None = None
    thousands: str | None = None  # between groups of three digits
    encoding: str = "utf-8-sig"
    comment: str = "#%"  # each of these signs begins a comment line above the header
    skip_rows: int = 0  # lines above the header (or above the first row) that are not part of the table
    header: bool = True  # without a header the columns are called 1, 2, 3, ...
    columns: int | None = None  # their number where there is no header; None: as many as the first row has
    header_begins_with: str | None = None  # text with which the header line begins, wherever it stands
    find_header: bool = False  # where the header lacks a column: take the only line that names all of them
    # The line below the header holds units; None: where it can be nothing else.
    units_row: bool | None = False
    # Declared by column: must be those of the units row.
    units: Mapping[str, str] = field(default_factory=dict)
    rows: tuple[RowFilter, ...] = ()  # which rows are read
    # Rows in which all of these columns are empty are those of others in one table.
    shared_with: tuple[str, ...] = ()
    # Number of the last line that is read, where specimens are stacked in one file.
    last_line: int | None = None


STANDARD = CsvForm()


def is_comment(line: str, form: CsvForm) -> bool:
    return line.lstrip()[0] in form.comment
