"""Units as testing machines write them, and what they are in mm, N, MPa, s, degC and plain numbers."""

from __future__ import annotations

import re

POUND_N = 4.4482216152605  # 0.45359237 kg at 9.80665 m/s^2 (NIST SP 811, 2008)
# quantity -> unit -> factor. Factors are exact by definition (NIST SP 811, 2008).
FACTORS = {
    "number": {"1": 1.0, "%": 1e-2},
    "length": {"mm": 1.0, "cm": 10.0, "um": 1e-3, "nm": 1e-6, "m": 1e3, "in": 25.4},
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "nN": 1e-9, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": POUND_N},
    "pressure": {
        "MPa": 1.0, "kPa": 1e-3, "Pa": 1e-6, "bar": 0.1, "mbar": 1e-4, "psi": POUND_N / 25.4**2, "kgf/cm2": 9.80665e-2,
    },
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "h:mm:ss": 1.0},  # text, read as s
    "rate": {"1/s": 1.0, "%/s": 1e-2},
    "temperature": {"degC": 1.0, "degF": 5 / 9, "K": 1.0},
}  # fmt: skip
OFFSETS = {"degF": -160 / 9, "K": -273.15}  # of degC (NIST SP 811, 2008)
# unit -> (quantity, factor, offset): value * factor + offset
UNITS = {
    unit: (quantity, factor, OFFSETS.get(unit, 0.0))
    for quantity, units in FACTORS.items()
    for unit, factor in units.items()
}
# other spellings that machines and people use; exact, as mN and MN differ by their case
SPELLINGS = {
    "1": "- mm/mm",
    "%": "percent pct",
    "um": "micron",
    "in": "inch",
    "gf": "g",
    "kgf": "kg kp",
    "lbf": "lb lbs",
    "MPa": "Mpa N/mm2",
    "kPa": "KPa kN/m2",
    "Pa": "N/m2",
    "psi": "lbf/in2",
    "kgf/cm2": "kg/cm2",
    "s": "sec Sec seconds",
    "ms": "msec",
    "h": "hr",
    "h:mm:ss": "hh:mm:ss m:ss mm:ss",
    "1/s": "/s s-1",
    "%/s": "percent/s",
    "degC": "C °C",
    "degF": "°F",
}
UNIT_OF = {spelling: unit for unit, spellings in SPELLINGS.items() for spelling in spellings.split()}
UNIT_AT_END = re.compile(r"[\[({]\s*([^\[\](){}]+?)\s*[\])}]\s*$|_([A-Za-z]{1,3})$|(?: /| in|,) ?(\S+)\s*$")
BRACKETS = {"(": ")", "[": "]", "{": "}"}


def unit_named(text: str) -> str | None:
    """Return the unit that a text names, in brackets or not, in any usual spelling.

    Parameters
    ----------
    text : str
        Such as "[kPa]", "µm" or "N/mm²".

    Returns
    -------
    str or None
        A key of UNITS; None for another text.

    Examples
    --------
    >>> unit_named("[µm]")
    'um'
    """
    text = _bare(text)
    for sign, plain in (("µ", "u"), ("μ", "u"), ("²", "2"), ("^", ""), ("⁻¹", "-1")):
        text = text.replace(sign, plain)
    unit = UNIT_OF.get(text, text)
    return unit if unit in UNITS else None


def known_unit(text: str) -> str:
    """Return the unit that a text names.

    Parameters
    ----------
    text : str
        As of `unit_named`.

    Returns
    -------
    str
        A key of UNITS.

    Raises
    ------
    ValueError
        For a text that names none; the message lists all.
    """
    unit = unit_named(text)
    if unit is None:
        raise ValueError(f"unit {text!r} is not known; one of {sorted(UNITS)}")
    return unit


def unit_in_header(column: str) -> str | None:
    """Return the unit that the name of a column ends in.

    Parameters
    ----------
    column : str
        Such as "Load (N)", "Load / N", "Load in N", "Load, N" or "load_N".

    Returns
    -------
    str or None
        A key of UNITS; None where it names none.
    """
    match = UNIT_AT_END.search(column)
    return unit_named(next(filter(None, match.groups()))) if match else None


def looks_like_a_unit(text: str) -> bool:
    """Return whether a cell can only be a unit: a known one, or a short text in brackets.

    Parameters
    ----------
    text : str
        The cell.

    Returns
    -------
    bool
        True for "mm", "[foo]" and "(N)"; False for "load".
    """
    return _bare(text) != text.strip() or unit_named(text) is not None


def _bare(text: str) -> str:
    text = text.strip()
    if len(text) > 1 and BRACKETS.get(text[0]) == text[-1]:
        return text[1:-1].strip()
    return text
