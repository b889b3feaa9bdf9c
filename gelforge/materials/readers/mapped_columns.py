"""Declared columns of a table as stretch and nominal stress, in mm, N, MPa and s."""

from __future__ import annotations

from pathlib import Path
from typing import overload

import numpy as np
import pandas as pd

from gelforge.config.foreign.mapping import Column, Strain, Stress, TestMapping
from gelforge.csv_table import TableError
from gelforge.materials.basis.stresses import (
    LEAST_RADIUS_TO_THICKNESS,
    membrane_cauchy,
    nominal_from_cauchy,
    nominal_from_force,
    too_thick,
)
from gelforge.units import UNITS


@overload
def values(table: pd.DataFrame, column: Column) -> np.ndarray: ...
@overload
def values(table: pd.DataFrame, column: Column | None) -> np.ndarray | None: ...


def values(table: pd.DataFrame, column: Column | None) -> np.ndarray | None:
    """Return a column (n,) in mm, N, MPa, s, degC or as a plain number, with its sign."""
    if column is None:
        return None
    _, factor, offset = UNITS[column.known_unit]
    return column.sign * (table[column.column].to_numpy(dtype=float) * factor + offset)


def number_in_name(path: Path, entry: TestMapping, named: dict[str, str], key: str) -> float | None:
    if key not in named:
        return None
    assert entry.from_name is not None  # named holds what its pattern found
    text = named[key].replace(entry.from_name.decimal, ".")
    try:
        return float(text)
    except ValueError:
        raise TableError(
            f"{path}: {key} in the name is {named[key]!r}, which is no number; correct it"
        ) from None


def stretch_of(path, entry, table, strain: Strain) -> tuple[np.ndarray, list[str]]:
    """Return the stretch (n,), or the amount of shear, and what was assumed for it."""
    e = values(table, strain)
    if strain.measure in ("stretch", "shear"):
        return e, []
    if strain.measure == "engineering":
        return 1 + e, []
    if strain.measure == "true":
        return np.exp(np.clip(e, -700, 700)), []
    gauge, said = entry.gauge_length_mm, []
    if strain.measure == "displacement":
        return 1 + e / gauge, []
    if (e <= 0).any():
        i = int(np.argmax(e <= 0))
        raise TableError(
            f"{path}, row {table.index[i]}: gap {strain.column} is {e[i]:g} mm; it must be above 0"
        )
    if gauge is None:
        gauge = float(e[0])
        said.append(f"gauge length {gauge:.5g} mm taken from the first row's gap: contact there is assumed")
    return e / gauge, said


def nominal_stress_of(path, entry, table, stress: Stress, stretch, lateral):
    """Return the nominal stress (n,) [MPa] and, where only that is known, the Cauchy stress difference (n,)."""
    s = values(table, stress)
    if stress.measure == "nominal":
        return s, None
    if stress.measure == "cauchy":
        return (s if entry.kind == "simple_shear" else nominal_from_cauchy(s, stretch)), None
    if stress.measure == "force":
        return nominal_from_force(s, entry.cross_section_mm2), None
    if stress.measure == "inflation":
        radius = values(table, entry.radius)
        if (i := too_thick(radius, entry.thickness_mm)) is not None:
            raise TableError(
                f"{path}, row {table.index[i]}: radius {radius[i]:g} mm with a thickness of {entry.thickness_mm:g} mm;"
                f" p r / (2 h0 lam_3) needs r >= {LEAST_RADIUS_TO_THICKNESS:g} h0; check the units"
            )
        other = stretch if lateral is None else lateral
        return membrane_cauchy(s, radius, entry.thickness_mm, stretch, other) / stretch, None
    return np.full(len(s), np.nan), s


def lateral_of(path, entry, table, stretch) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the lateral stretch and nominal stress (n,), brought to the rows of the loading direction."""
    lateral = entry.lateral
    if lateral is None:
        return None, None
    lam = None
    if lateral.strain:
        lam, _ = stretch_of(path, entry, table, lateral.strain)
    elif lateral.extension_ratio is not None:
        lam = 1 + lateral.extension_ratio * (stretch - 1)
    if lateral.stress is None:
        return lam, None
    at = stretch if lateral.stress.at is None else stretch_of(path, entry, table, lateral.stress.at)[0]
    measured = lam if lateral.stress.at is None else None
    stress, _ = nominal_stress_of(path, entry, table, lateral.stress, measured, None)
    order = np.argsort(at, kind="stable")
    return lam, stress if lateral.stress.at is None else np.interp(stretch, at[order], stress[order])
