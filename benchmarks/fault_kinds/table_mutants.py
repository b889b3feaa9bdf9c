"""Mutants of a table: what a person, a machine or a transfer does to a CSV file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.fault_kinds.input_world import Input


@dataclass(frozen=True)
class Mutant:
    """One mutated file: its bytes, what was done, whether a person could mean it, and whether it has to be accepted."""

    content: bytes
    what: str
    can_be_meant: bool = False  # see the docstring of inputs.py
    honest: bool = False  # a right neighbour


class Table:
    """Lines of a table: what stands above the header, the header, and rows of cells."""

    def __init__(self, content: bytes, of: Input):
        lines = content.decode().splitlines()
        self.separator, self.of = of.separator, of
        at = next(i for i, line in enumerate(lines) if set(of.numbers) <= set(line.split(of.separator)))
        self.above, self.header = lines[:at], lines[at].split(of.separator)
        rows = [line.split(of.separator) for line in lines[at + 1 :]]
        self.units = [row for row in rows if row[0].startswith("(")]
        self.rows = rows[len(self.units) :]

    def text(self, header=None, rows=None, separator=None) -> bytes:
        separator = separator or self.separator
        lines = [header or self.header, *self.units, *(self.rows if rows is None else rows)]
        return ("\n".join([*self.above, *(separator.join(cells) for cells in lines)]) + "\n").encode()

    def column(self, rng) -> int:
        return self.header.index(self.of.numbers[rng.integers(len(self.of.numbers))])

    def changed(self, columns, rows, change: Callable[[str], str]) -> bytes:
        """Return the table with some cells changed."""
        new = [list(cells) for cells in self.rows]
        for row in rows:
            for column in columns:
                new[row][column] = change(new[row][column])
        return self.text(rows=new)

    def number(self, text: str, change: Callable[[float], float]) -> str:
        """Return a number's text changed, in the table's decimal sign; other text as it is."""
        comma = "," in text and self.separator == ";"
        try:
            value = f"{change(float(text.replace(',', '.') if comma else text)):.9g}"
        except ValueError:
            return text
        return value.replace(".", ",") if comma else value


# Recorded forces across the press may have any sign and, next to a large normal force, any small size.
LATERAL = ("fx_N", "fy_N")
TIMES = ("time_s", "Zeit")  # of a material test: slower and faster ones exist
POSITIONS = ("x_mm", "y_mm")
NOISE = 0.1  # of a column's range: a single value that is off by less is not told from noise (odd_rows.SINGLE_SHARE)


def not_a_number(table: Table, rng) -> Mutant:
    column, row = table.column(rng), int(rng.integers(len(table.rows)))
    word = ("nan", "NaN", "inf", "-inf", "1e999", "N/A", "#DIV/0!", "", "--", "1_0", "0x10", "9" * 400)[
        rng.integers(12)
    ]
    said = f"{table.header[column]} in row {row} is {word[:12]!r}"
    return Mutant(table.changed([column], [row], lambda _: word), said)


def sign(table: Table, rng) -> Mutant:
    column = table.column(rng)
    name = table.header[column]
    content = table.changed([column], range(len(table.rows)), lambda t: table.number(t, lambda v: -v))
    return Mutant(content, f"{name} with the other sign", name in LATERAL)


def factor(table: Table, rng) -> Mutant:
    column, size = table.column(rng), float(rng.choice([1000.0, 1e-3]))
    name = table.header[column]
    content = table.changed([column], range(len(table.rows)), lambda t: table.number(t, lambda v: size * v))
    material = name in TIMES and table.of.command in ("gel", "foreign")
    material |= (
        name == "order" and size > 1
    )  # presses may be counted in thousands: what counts is which comes first
    return Mutant(content, f"{name} times {size:g}", (name in LATERAL and size < 1) or material)


def factor_of_one_value(table: Table, rng) -> Mutant:
    column, size = table.column(rng), float(rng.choice([1000.0, 1e-3]))
    row = int(rng.integers(len(table.rows)))
    content = table.changed([column], [row], lambda t: table.number(t, lambda v: size * v))
    values = [float(cells[column].replace(",", ".") or "nan") for cells in table.rows]
    moved = abs(size - 1) * abs(values[row]) < NOISE * float(np.ptp(values))
    return Mutant(content, f"{table.header[column]} in row {row} times {size:g}", moved)


def swapped(table: Table, rng) -> Mutant:
    one = table.column(rng)
    others = [table.header.index(name) for name in table.of.numbers if table.header.index(name) != one]
    two = int(rng.choice(others)) if others else (one + 1) % len(table.header)
    header = list(table.header)
    header[one], header[two] = header[two], header[one]
    names = {header[one], header[two]}
    return Mutant(
        table.text(header),
        f"{header[one]} and {header[two]} swapped",
        names <= set(LATERAL) or names <= set(POSITIONS),
    )


def missing(table: Table, rng) -> Mutant:
    column = table.column(rng)
    rows = [cells[:column] + cells[column + 1 :] for cells in (table.header, *table.units, *table.rows)]
    lines = "\n".join([*table.above, *(table.separator.join(cells) for cells in rows)])
    return Mutant((lines + "\n").encode(), f"without {table.header[column]}")


def duplicated(table: Table, rng) -> Mutant:
    column = table.column(rng)
    rows = [[*cells, cells[column]] for cells in (table.header, *table.units, *table.rows)]
    lines = "\n".join([*table.above, *(table.separator.join(cells) for cells in rows)])
    return Mutant((lines + "\n").encode(), f"{table.header[column]} twice")


def shuffled(table: Table, rng) -> Mutant:
    rows = [table.rows[i] for i in rng.permutation(len(table.rows))]
    return Mutant(table.text(rows=rows), "rows shuffled")


def repeated(table: Table, rng) -> Mutant:
    first = int(rng.integers(len(table.rows)))
    last = min(first + int(rng.integers(1, 6)), len(table.rows))
    rows = [*table.rows[:last], *table.rows[first:]]
    # a machine may write a reading twice; where there are no times, a position that falls back by a row is its noise
    material = table.of.command in ("gel", "foreign")
    read_twice = material and last - first <= (1 if set(TIMES) & set(table.header) else 2)
    read_twice |= (
        table.of.path.endswith("night/indentations.csv") and last - first == 1
    )  # its forces are in ft.csv
    return Mutant(table.text(rows=rows), f"rows {first} to {last - 1} twice", read_twice)


def truncated(table: Table, rng) -> Mutant:
    content = table.text()
    at = int(rng.integers(len(content)))
    last = content[:at].decode().splitlines()[-1:]
    whole = bool(last) and len(last[0].split(table.separator)) == len(table.header)
    # a table that ends with a row, be its last number shorter, may have been written so
    return Mutant(content[:at], f"cut after {at} bytes", whole)


def encoding(table: Table, rng) -> Mutant:
    text = table.text().decode()
    name = ("utf-8-sig", "utf-16", "utf-32", "latin-1", "cp037", "cp1252")[rng.integers(6)]
    if name in ("latin-1", "cp1252"):
        text = text.replace(table.header[0], f"{table.header[0]}{table.separator}Größe µ", 1)
    return Mutant(text.encode(name), name)


def decimal_comma(table: Table, rng) -> Mutant:
    separator = (",", ";", "\t")[rng.integers(3)]
    rows = [[cell.replace(".", ",") for cell in cells] for cells in table.rows]
    return Mutant(table.text(rows=rows, separator=separator), f"decimal commas, separated by {separator!r}")


def thousands(table: Table, rng) -> Mutant:
    column = table.column(rng)
    grouped = [f"{1000 + k:,.1f}" for k in range(len(table.rows))]
    rows = [[*cells[:column], f'"{text}"', *cells[column + 1 :]] for cells, text in zip(table.rows, grouped)]
    return Mutant(table.text(rows=rows), f"{table.header[column]} with thousands separators")


def clock(table: Table, rng) -> Mutant:
    column = table.column(rng)
    rows = [
        [*cells[:column], f"{k // 3600}:{k // 60 % 60:02d}:{k % 60:02d}", *cells[column + 1 :]]
        for k, cells in enumerate(table.rows)
    ]
    return Mutant(table.text(rows=rows), f"{table.header[column]} as h:mm:ss")


def stacked(table: Table, rng) -> Mutant:
    again = Table(table.text(), table.of)
    again.above = []
    title = "" if rng.integers(2) else f"Specimen {rng.integers(2, 9)}\n"
    return Mutant(table.text() + title.encode() + again.text(), "the table again below itself")


def saturated(table: Table, rng) -> Mutant:
    """Clip the force across the press, or of a test machine, at a part of its largest value."""
    names = [name for name in ("fz_N", "force_N", "Kraft") if name in table.header]
    column = table.header.index(names[0]) if names else table.column(rng)
    comma = table.separator == ";"
    values = [
        abs(float((cells[column] or "0").replace(",", ".") if comma else cells[column] or 0))
        for cells in table.rows
    ]
    limit = float(f"{rng.uniform(0.5, 0.8) * max(values):.3g}")
    change = lambda value: min(max(value, -limit), limit)  # noqa: E731
    return Mutant(
        table.changed([column], range(len(table.rows)), lambda text: table.number(text, change)),
        f"{table.header[column]} clipped at {limit:g}",
        not names,
    )


def falls_early(table: Table, rng) -> Mutant:
    """Let a specimen break after a few rows: the force of a test machine is a hundredth from there on."""
    names = [name for name in ("force_N", "Kraft") if name in table.header]
    column = table.header.index(names[0]) if names else table.column(rng)
    row = int(rng.integers(2, max(3, len(table.rows) // 4)))
    content = table.changed(
        [column], range(row, len(table.rows)), lambda text: table.number(text, lambda value: 0.01 * value)
    )
    return Mutant(content, f"{table.header[column]} falls to a hundredth after {row} rows", not names)


def unit_in_the_header(table: Table, rng) -> Mutant:
    """Write a unit behind the name of a column, as machines do; often another than the file's."""
    column, unit = table.column(rng), ("s", "N", "mm", "Nm", "counts/N")[rng.integers(5)]
    header = [*table.header[:column], f"{table.header[column]} ({unit})", *table.header[column + 1 :]]
    return Mutant(table.text(header), f"{header[column]} in the header")


def separator_too_many(table: Table, rng) -> Mutant:
    row, before = int(rng.integers(len(table.rows))), int(rng.integers(len(table.header) + 1))
    rows = [list(cells) for cells in table.rows]
    rows[row].insert(before, "")
    return Mutant(
        table.text(rows=rows), f"a separator too many in row {row}, before cell {before}", len(rows) == 1
    )


def damaged(table: Table, rng) -> Mutant:
    content = bytearray(table.text())
    at = int(rng.integers(len(content)))
    damage = (b"\x00", b'"', b"\xff", b"\n", b"\r", b",", b"\x0c", b";")[rng.integers(8)]
    content[at:at] = damage
    return Mutant(bytes(content), f"{damage!r} inserted at byte {at}")


MUTATIONS: dict[str, Callable[[Table, np.random.Generator], Mutant]] = {
    "no number": not_a_number,
    "sign": sign,
    "factor 1000": factor,
    "factor 1000 of one value": factor_of_one_value,
    "columns swapped": swapped,
    "column missing": missing,
    "column duplicated": duplicated,
    "rows shuffled": shuffled,
    "rows repeated": repeated,
    "truncated": truncated,
    "encoding": encoding,
    "decimal comma": decimal_comma,
    "thousands separators": thousands,
    "times of a clock": clock,
    "stacked tables": stacked,
    "saturated": saturated,
    "falls early": falls_early,
    "unit in the header": unit_in_the_header,
    "separator too many": separator_too_many,
    "byte inserted": damaged,
}
