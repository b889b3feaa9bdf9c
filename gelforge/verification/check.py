"""One verified number, and how a list of them becomes a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd


class VerificationFailed(ValueError):
    """A check came out beyond its limit."""


@dataclass(frozen=True)
class Check:
    """A quantity that the finite elements found, next to what it should be."""

    quantity: str
    source: str  # where the reference comes from
    reference: float
    found: float
    error: float  # relative to the reference where one is given, else the size of what should be zero
    limit: float

    @property
    def passed(self) -> bool:
        """Return whether the error is a number within the limit."""
        return bool(self.error <= self.limit)


def relative(quantity: str, source: str, reference: float, value: float, limit: float) -> Check:
    """Return a check whose error is |found - reference| / |reference|."""
    error = abs(value - reference) / abs(reference)
    return Check(quantity, source, float(reference), float(value), float(error), limit)


def absolute(quantity: str, source: str, reference: float, value: float, limit: float) -> Check:
    """Return a check whose error is |found - reference|."""
    return Check(quantity, source, float(reference), float(value), float(abs(value - reference)), limit)


def vanishing(quantity: str, source: str, value: float | np.floating, limit: float) -> Check:
    """Return a check of something that should be zero; value is a size, already made dimensionless."""
    return Check(quantity, source, 0.0, float(value), float(np.abs(value)), limit)


def check_table(checks: list[Check]) -> pd.DataFrame:
    """Return the checks as a table.

    Parameters
    ----------
    checks : iterable of Check
        As `run_checks` yields them.

    Returns
    -------
    pandas.DataFrame
        One row per check.
    """
    columns = ("quantity", "source", "reference", "found", "error", "limit")
    table = pd.DataFrame([[getattr(check, name) for name in columns] for check in checks], columns=columns)
    return table.assign(passed=[check.passed for check in checks])
