"""Units as testing machines write them, and what they are in mm, N, MPa, s, degC and plain numbers."""

from __future__ import annotations

import re

# unit -> (quantity, factor, offset): value * factor + offset. Factors are exact by definition (NIST SP 811, 2008).
UNITS: dict[str, tuple[str, float, float]] = {
    "1": ("number", 1.0, 0.0),
    "%": ("number", 1e-2, 0.0),
    "mm": ("length", 1.0, 0.0),
    "cm": ("length", 10.0, 0.0),
    "um": ("length", 1e-3, 0.0),
    "nm": ("length", 1e-6, 0.0),
    "m": ("length", 1e3, 0.0),
    "in": ("length", 25.4, 0.0),
    "N": ("force", 1.0, 0.0),
    "kN": ("force", 1e3, 0.0),
    "mN": ("force", 1e-3, 0.0),
    "uN": ("force", 1e-6, 0.0),
    "nN": ("force", 1e-9, 0.0),
    "gf": ("force", 9.80665e-3, 0.0),
    "kgf": ("force", 9.80665, 0.0),
    "lbf": ("force", 4.4482216152605, 0.0),
    "MPa": ("pressure", 1.0, 0.0),
    "kPa": ("pressure", 1e-3, 0.0),
    "Pa": ("pressure", 1e-6, 0.0),
    "bar": ("pressure", 0.1, 0.0),
    "mbar": ("pressure", 1e-4, 0.0),
    "psi": ("pressure", 4.4482216152605 / 25.4**2, 0.0),
    "kgf/cm2": ("pressure", 9.80665e-2, 0.0),
    "s": ("time", 1.0, 0.0),
    "ms": ("time", 1e-3, 0.0),
    "us": ("time", 1e-6, 0.0),
    "ns": ("time", 1e-9, 0.0),
    "min": ("time", 60.0, 0.0),
    "h": ("time", 3600.0, 0.0),
    "h:mm:ss": ("time", 1.0, 0.0),  # a text, read as seconds
    "1/s": ("rate", 1.0, 0.0),
    "%/s": ("rate", 1e-2, 0.0),
    "degC": ("temperature", 1.0, 0.0),
    "degF": ("temperature", 5 / 9, -160 / 9),
    "K": ("temperature", 1.0, -273.15),
}
# other spellings that machines and people use; exact, as mN and MN differ by their case
SPELLINGS = {
    "-": "1",
    "mm/mm": "1",
    "percent": "%",
    "pct": "%",
    "micron": "um",
    "inch": "in",
    "g": "gf",
    "kg": "kgf",
    "kp": "kgf",
    "lb": "lbf",
    "lbs": "lbf",
    "KPa": "kPa",
    "Mpa": "MPa",
    "N/mm2": "MPa",
    "kN/m2": "kPa",
    "N/m2": "Pa",
    "lbf/in2": "psi",
    "kg/cm2": "kgf/cm2",
    "sec": "s",
    "Sec": "s",
    "seconds": "s",
    "hh:mm:ss": "h:mm:ss",
    "m:ss": "h:mm:ss",
    "mm:ss": "h:mm:ss",
    "msec": "ms",
    "hr": "h",
    "/s": "1/s",
    "s-1": "1/s",
    "percent/s": "%/s",
    "C": "degC",
    "°C": "degC",
    "°F": "degF",
}
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
    unit = SPELLINGS.get(text, text)
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
    match = re.search(
        r"[\[({]\s*([^\[\](){}]+?)\s*[\])}]\s*$|_([A-Za-z]{1,3})$|(?: /| in|,) ?(\S+)\s*$", column
    )
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
