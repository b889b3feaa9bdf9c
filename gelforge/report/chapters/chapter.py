"""What the report says: chapters of words, figures and tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.report.figures.style import data_uri

UNITS = {"N", "mN", "mm", "kPa", "MPa", "s", "px", "MB", "percent"}


@dataclass(frozen=True)
class Picture:
    """A figure under a sentence that says what to see."""

    words: str
    uri: str
    kind = "picture"


@dataclass(frozen=True)
class Table:
    """A table under a sentence; cells are text."""

    words: str
    header: list[str]
    numeric: list[bool]  # columns of numbers stand right-aligned
    rows: list[list[str]]
    minor: list[bool]  # rows that are subordinate to the one above
    kind = "table"


@dataclass(frozen=True)
class Note:
    """A paragraph; one about something missing is marked."""

    words: str
    missing: bool = False
    kind = "note"


@dataclass(frozen=True)
class Link:
    """The way to another file of the results, relative to the page."""

    words: str
    target: str
    kind = "link"


@dataclass(frozen=True)
class Facts:
    """Short facts, name and value."""

    items: list[tuple[str, str]]
    kind = "facts"


@dataclass
class Chapter:
    """One chapter of the page; a fold of a chapter is a chapter too, whose title opens it.

    What adds a block returns the chapter.
    """

    key: str
    title: str
    blocks: list = field(default_factory=list)
    kind = "fold"

    def add(self, block: object) -> Chapter:
        self.blocks.append(block)
        return self

    def say(self, words: str) -> Chapter:
        return self.add(Note(words))

    def miss(self, words: str) -> Chapter:
        """Say that something is not in the report, and why."""
        return self.add(Note(words, missing=True))

    def show(self, words: str, figure: Figure) -> Chapter:
        return self.add(Picture(words, data_uri(figure)))

    def fold(self, title: str) -> Chapter:
        """Return a part of the chapter that is closed until a reader opens it; one without blocks is not shown."""
        folded = Chapter("", title)
        self.blocks.append(folded)
        return folded

    def tabulate(self, words: str, table: pd.DataFrame, minor: Sequence[bool] = ()) -> Chapter:
        """Add a table; minor: of each row whether it is subordinate to the one above."""
        rows = [[cell_text(value) for value in row] for row in table.itertuples(index=False)]
        numeric = [pd.api.types.is_numeric_dtype(kind) for kind in table.dtypes]
        header = [heading(str(column)) for column in table.columns]
        return self.add(Table(words, header, numeric, rows, [*minor] or [False] * len(rows)))


def heading(column: str) -> str:
    """Return a column's name with its unit in brackets: rmse_N becomes rmse [N]."""
    name, _, unit = column.rpartition("_")
    return f"{name.replace('_', ' ')} [{unit}]" if name and unit in UNITS else column.replace("_", " ")


def cell_text(value) -> str:
    """Return a table's cell as text: four significant digits, a dash for what is not there."""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if value is None or (isinstance(value, float | np.floating) and np.isnan(value)):
        return "–"
    if isinstance(value, float | np.floating):
        return f"{value:.4g}" if np.isfinite(value) else "∞" if value > 0 else "−∞"
    return str(value)


def newtons(force_N: float) -> str:
    """Return a total force, or an error of one: of these the unit is N on the whole page."""
    return f"{force_N:.3g} N"


def millinewtons(force_N: float) -> str:
    """Return a force of a single bin, or an error of one: of these the unit is mN on the whole page."""
    return f"{1e3 * force_N:.3g} mN"


def count(number: int, one: str, many: str | None = None) -> str:
    """Return a number with its noun: 1 site, 25 sites."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"
