"""Cells of a table as numbers: decimal sign, thousands separators, times of day; each error names file, row and remedy."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

CLOCK = "h:mm:ss"  # the unit of such a column: 1:02:03.5, or 62:03.5
TIME_OF_CLOCK = re.compile(r"(?:(\d+):)?(\d+):(\d{2}(?:\.\d*)?)")
# no-break, thin and narrow spaces, apostrophe and minus sign, as programs set them
PLAIN = str.maketrans("\u00a0\u2009\u202f\u2019\u2212", "   '-")
LIKELY_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([,.' ])\d{3})+(?:[.,]\d*)?")


class TableError(ValueError):
    """A table that cannot be used: file, row, value found, limit, remedy."""


@dataclass(frozen=True)
class Signs:
    """How numbers are written. decimal "." or "," allows only that sign, ".," both; thousands: between groups of three."""

    decimal: str = "."
    thousands: str | None = None

    def number(self, text: str) -> float:
        """Return a text as a number, NaN for what is none."""
        if not text.isascii():
            text = text.translate(PLAIN)
        if self.thousands:
            group = re.escape(self.thousands)
            if re.fullmatch(rf"[+-]?\d{{1,3}}(?:{group}\d{{3}})*(?:{re.escape(self.decimal)}\d*)?", text):
                text = text.replace(self.thousands, "")
        if "_" in text or (self.decimal == "," and "." in text):
            # 1_0 is no number in a table; 1.234 may be a thousand and more, or a fraction: not ours to guess
            return math.nan
        try:
            return float(text.replace(",", ".") if "," in self.decimal else text)
        except ValueError:
            return math.nan

    def seconds(self, text: str) -> float:
        """Return h:mm:ss or m:ss in seconds, NaN for another text."""
        match = TIME_OF_CLOCK.fullmatch(text.replace(",", ".") if "," in self.decimal else text)
        if match is None or float(match.group(3)) >= 60 or (match.group(1) and int(match.group(2)) >= 60):
            return math.nan
        return 3600 * int(match.group(1) or 0) + 60 * int(match.group(2)) + float(match.group(3))


def few(names: Sequence[str], most: int = 12) -> str:
    """Return names as a list that stays short: a table without separators has its whole text as one name."""
    shown = [name if len(name) <= 60 else name[:57] + "..." for name in names[:most]]
    return f"{shown}" + (f" and {len(names) - most} more" if len(names) > most else "")


def numbers_of(
    path: Path, name: str, lines: list[int], column: list[str], signs: Signs, clock: bool, empty_allowed: bool
) -> list[float]:
    """Return a column of text as finite numbers; clock: of times h:mm:ss in seconds, past midnight counted on."""
    day_s = 24 * 3600.0  # after which a clock shows 0:00:00 again
    values, days, read = [], 0.0, signs.seconds if clock else signs.number
    for line, text in zip(lines, column):
        if text == "" and empty_allowed:
            values.append(math.nan)
            continue
        value = read(text)
        if not math.isfinite(value):
            raise TableError(f"{path}, row {line}: {name} is {_no_number(text, signs, clock)}")
        if clock and values and value + days < values[-1] - day_s / 2:
            days += day_s
        values.append(value + days)
    if len(signs.decimal) > 1 and any("," in text for text in column) and any("." in text for text in column):
        line = next(line for line, text in zip(lines, column) if "." in text)
        raise TableError(
            f"{path}, row {line}: {name} has decimal points and decimal commas; write the whole column with one sign"
        )
    return values


def _no_number(text: str, signs: Signs, clock: bool) -> str:
    """Return what a cell is that is no finite number, and the key that reads it where there is one."""
    quoted = few([text])[1:-1] if text else "nothing"
    if clock:
        return f"{quoted}; a time {CLOCK} (or m:ss) is needed, correct the row or the unit"
    if TIME_OF_CLOCK.fullmatch(text.replace(",", ".")):
        return f"{quoted}; a number is needed: for times of a clock set the column's unit to {CLOCK}"
    needed = f"{quoted}; a finite number is needed"
    grouped = LIKELY_THOUSANDS.fullmatch(text.translate(PLAIN))
    if grouped and not signs.thousands and grouped.group(1) not in signs.decimal and len(signs.decimal) == 1:
        key = f'`table: {{thousands: "{grouped.group(1)}"}}`'
        return f"{needed}: for thousands separators set {key}, correct or drop the row"
    said = f" (decimal sign {signs.decimal})" if len(signs.decimal) == 1 else ""
    return f"{needed}{said}, correct the row, drop it, or leave such rows out (`rows` of a mapping)"
