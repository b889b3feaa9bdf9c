"""How results are printed: a few lines with units, a number with its standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, isfinite, log10


def with_error(value: float, sigma: float | None) -> str:
    """Return a number with its standard deviation, to two digits of that; without one to four digits of its own.

    >>> with_error(-0.151583, 0.0212)
    '-0.152 +- 0.021'
    >>> with_error(126.0017, 0.0)
    '126 +- 0'
    """
    if sigma is None or not isfinite(sigma):
        return f"{value:.4g}"
    if sigma <= 0:
        return f"{value:.4g} +- 0"
    digits = max(1 - floor(log10(sigma)), 0)
    return f"{round(value, digits) + 0.0:.{digits}f} +- {sigma:.{digits}f}"


def components(values: Sequence[float], largest: float) -> list[str]:
    """Return the components of a vector to four digits of the largest value next to them: rounding stays out of sight.

    >>> components([-2.8e-13, 0.0318, -0.1515], 0.1515)
    ['0.0000', '0.0318', '-0.1515']
    """
    digits = min(max(3 - floor(log10(largest)), 0), 12) if largest > 0 else 0
    return [f"{round(float(value), digits) + 0.0:.{digits}f}" for value in values]


def table(head: Sequence[str], rows: Sequence[Sequence[str]], most: int = 8) -> str:
    """Return rows of text in columns under their heads, two spaces in front; the middle of more than `most` is left out."""
    if len(rows) > most:
        half = most // 2
        rows = [*rows[:half], ["..."] * len(head), *rows[-half + 1 :]]
    cells = [list(head), *(list(row) for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    return "\n".join("  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths)) for row in cells)
