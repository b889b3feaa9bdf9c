"""How a foreign table is written, as a mapping or an import declares it."""

from __future__ import annotations

import codecs
from typing import Literal

from pydantic import Field, model_validator

from gelforge.csv_table import CsvForm, RowFilter
from gelforge.section import Section


class Rows(Section):
    """Rows that are read, by the value of a column; all of several conditions must hold."""

    column: str = Field(description="name in the header, or the number from 1 where there is none")
    equals: list[str | int | float] | None = Field(None, min_length=1, description="values that are kept")
    at_least: float | None = Field(None, description="smallest number that is kept, in the file's unit")
    at_most: float | None = Field(None, description="largest number that is kept, in the file's unit")

    @model_validator(mode="after")
    def _asks(self):
        if self.equals is None and self.at_least is None and self.at_most is None:
            raise ValueError("a filter of rows needs `equals`, `at_least` or `at_most`")
        return self

    def filter(self, every: bool = True) -> RowFilter:
        """Return the filter as the CSV reader takes it; every: each value of `equals` stands in every table it is for."""
        equals = None if self.equals is None else tuple(map(str, self.equals))
        return RowFilter(self.column, equals, self.at_least, self.at_most, every)


class TableForm(Section):
    """How the table is written."""

    separator: Literal[",", ";", "tab", "space"] = Field(",", description="between the values of a row")
    decimal: Literal[".", ","] = Field(".", description="decimal sign; the other one is refused")
    thousands: Literal[",", ".", "'", " "] | None = Field(
        None, description="sign between groups of three digits, as in 1,000.0; null: none is accepted"
    )
    encoding: str = Field(
        "utf-8-sig", description="text encoding, e.g. latin-1; UTF-16 and UTF-32 are known by their mark"
    )
    comment: str = Field("#%", description="each of these signs begins a comment line above the header")
    skip_rows: int = Field(0, ge=0, description="lines above the header that are not part of the table [-]")
    header: bool = Field(True, description="a header names the columns; else they are called 1, 2, 3, ...")
    header_begins_with: str | None = Field(
        None,
        min_length=1,
        description="text with which the header line begins, wherever it stands; null: the line after comments and "
        "`skip_rows`, or, where that lacks the columns, the only line that names them all",
    )
    units_row: bool | None = Field(
        None, description="the line below the header holds units; null: where it can be nothing else"
    )
    columns: int | None = Field(None, ge=1, description="number of columns, where there is no header [-]")

    @model_validator(mode="after")
    def _columns(self):
        if self.header == (self.columns is not None):
            raise ValueError("`columns` (their number) goes with `header: false`, and only with it")
        if self.header_begins_with and (not self.header or self.skip_rows):
            raise ValueError(
                "`header_begins_with` finds the header by itself; leave `skip_rows` and `header` out"
            )
        if self.thousands == self.decimal:
            raise ValueError(f"decimal and thousands are both {self.decimal!r}; give each its own sign")
        try:
            codecs.lookup(self.encoding)
        except (LookupError, ValueError):  # ValueError: a name with a null character
            raise ValueError(
                f"encoding {self.encoding!r} is not known; e.g. utf-8, latin-1, cp1252, utf-16"
            ) from None
        return self

    def csv_form(
        self, units: dict[str, str], rows: tuple[RowFilter, ...] = (), shared_with: tuple[str, ...] = ()
    ) -> CsvForm:
        """Return the form as the CSV reader takes it, with the units declared by column and the filter of rows.

        shared_with: rows in which all of these columns are empty belong to others.
        """
        signs = {"tab": "\t", "space": " "}
        changed = {
            "separator": signs.get(self.separator, self.separator),
            "units": units,
            "rows": rows,
            "shared_with": shared_with,
        }
        return CsvForm(**(self.model_dump() | changed), find_header=True)
