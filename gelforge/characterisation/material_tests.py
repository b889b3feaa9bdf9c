"""Readers of material tests: samples.csv and one CSV per sample in, stress against stretch out.

Cauchy stress in the loading direction as in Sferrazza et al. 2019, sec. II-C: F lam_1 / (w0 h0) for uniaxial
tension and pure shear, p r / (2 h0 lam_3) with lam_3 = 1 / (lam_1 lam_2) at the apex of an inflated membrane.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.characterisation.common_form import MaterialTest
from gelforge.characterisation.piece_pictures import (
    PICTURE_SETTINGS,
    has_pictures,
    picture_files,
    tracked_inflation,
    tracked_tension,
)
from gelforge.characterisation.segments import first_reversal
from gelforge.characterisation.stresses import LEAST_RADIUS_TO_THICKNESS, membrane_cauchy, too_thick
from gelforge.config import NAME
from gelforge.csv_table import TableError, read_comments, read_csv
from gelforge.mechanics.homogeneous import LOAD_CASES, principal_stretches

TESTS_NOT_FITTED = ("relaxation",)
CIRCUMSTANCES = ("strain_rate_per_s", "age_days", "temperature_C", "cycle")

# Plausible ranges. They are wide enough for silicones, gels and rubbers as thin sheets, and narrow enough
# that a value in the wrong unit (factor 1000) falls out.
THICKNESS_MM = (0.02, 15.0)
WIDTH_MM = (1.0, 300.0)
STRETCH = (0.2, 15.0)
SHEAR_MODULUS_MPA = (0.5e-3, 5.0)  # secant modulus of a sample
LEAST_STRETCH_RANGE = 0.05
LARGEST_MODULUS_RATIO = (
    10.0  # between a sample and the median of its material: scatter of curing stays below 2
)
LATERAL_STRETCH = 0.2  # relative distance of a tracked stretch_2 from the load case


def input_files(folder: str | Path) -> list[Path]:
    """Return samples.csv, the files of all samples that it lists, in its order, and the pictures that these name."""
    tables = _tables(Path(folder))
    pictures = [picture for table in tables[1:] if table.is_file() for picture in picture_files(table)]
    return [*tables, *dict.fromkeys(pictures)]


def _tables(folder: Path) -> list[Path]:
    return [folder / "samples.csv", *(folder / name for name in _read_samples(folder)["file"])]


def declared_synthetic(folder: str | Path) -> bool:
    """Return whether a comment above the header of any file of a material says "synthetic"."""
    return any(
        "synthetic" in comment.lower() for path in _tables(Path(folder)) for comment in read_comments(path)
    )


def read_material_tests(folder: str | Path) -> list[MaterialTest]:
    """Return the curves of a material's uniaxial, pure-shear and equibiaxial samples, as in samples.csv.

    Raises TableError with file, row, value, limit and remedy for anything that cannot be right.
    """
    folder = Path(folder)
    samples = _read_samples(folder)
    curves, names = [], []
    for line, row in samples.iterrows():
        if row.test in TESTS_NOT_FITTED:
            continue
        curves.append(_read_sample(folder, line, row))
        names.append(row.file)
    if not curves:
        raise TableError(
            f"{folder / 'samples.csv'}: no sample of {list(LOAD_CASES)}; one at least is needed for a law"
        )
    _check_stress_level(folder, names, curves)
    return curves


def _read_samples(folder: Path) -> pd.DataFrame:
    path = folder / "samples.csv"
    samples = read_csv(
        path,
        texts=("file", "test", "sample"),
        optional_numbers=("width_mm", "thickness_mm", *CIRCUMSTANCES, *PICTURE_SETTINGS),
    )
    known = (*LOAD_CASES, *TESTS_NOT_FITTED)
    seen: dict[tuple, int] = {}
    for line, row in samples.iterrows():
        if row.test not in known:
            raise TableError(f"{path}, row {line}: test is {row.test!r}; one of {list(known)} is expected")
        if not NAME.fullmatch(row["sample"]) or row["sample"] == "mean":
            raise TableError(
                f"{path}, row {line}: sample is {row['sample']!r}; use letters, digits, '_', '-', not 'mean'"
            )
        if (row.test, row["sample"]) in seen:
            raise TableError(
                f"{path}, row {line}: {row.test} sample {row['sample']!r} is also in row"
                f" {seen[row.test, row['sample']]}; give each its own name"
            )
        seen[row.test, row["sample"]] = line
    return samples


def _read_sample(folder: Path, line: int, row: pd.Series) -> MaterialTest:
    path = folder / row.file
    if not path.is_file():
        raise TableError(
            f"{folder / 'samples.csv'}, row {line}: file {row.file!r} is not in {folder};"
            " add it or drop the row"
        )
    if "nominal_stress_kPa" in read_csv(path).columns:
        table = read_csv(path, numbers=("stretch_1", "nominal_stress_kPa"))
        stretch = _checked_stretch(path, table)
        return _material_test(folder, row, stretch, table["nominal_stress_kPa"].to_numpy() * 1e-3)
    h0 = _dimension(folder, line, row, "thickness_mm", THICKNESS_MM)
    if row.test == "equibiaxial":
        stress, stretch, time_s, said = _inflation(path, h0, row)
    else:
        width = _dimension(folder, line, row, "width_mm", WIDTH_MM)
        stress, stretch, time_s, said = _tension(path, row.test, width * h0, row)
    return _material_test(folder, row, stretch, stress / stretch, time_s, said)


def _material_test(
    folder: Path, row: pd.Series, stretch, nominal_stress, time_s=None, said: Sequence[str] = ()
) -> MaterialTest:
    known = {name: None if np.isnan(row[name]) else float(row[name]) for name in CIRCUMSTANCES}
    return MaterialTest(
        row.test,
        row["sample"],
        stretch,
        nominal_stress,
        time_s,
        material=folder.name,
        rate_per_s=known["strain_rate_per_s"],
        age_days=known["age_days"],
        temperature_C=known["temperature_C"],
        cycle=None if known["cycle"] is None else int(known["cycle"]),
        findings=tuple(said),
        source=row.file,
    )


Curve = tuple[
    np.ndarray, np.ndarray, np.ndarray, list[str]
]  # Cauchy stress [MPa], stretch, time [s], findings


def _tension(path: Path, test: str, area_mm2: float, row: pd.Series) -> Curve:
    """Return the Cauchy stress F lam_1 / (w0 h0) [MPa], stretch, time [s] and findings of a strip."""
    if has_pictures(path):
        table, said = tracked_tension(path, row)
    else:
        columns = ("time_s", "force_N", "stretch_1")
        table, said = read_csv(path, numbers=columns, optional_numbers=("stretch_2",)), []
    stretch = _checked_stretch(path, table)
    _check_time(path, table)
    _check_lateral(path, test, table)
    return table["force_N"].to_numpy() * stretch / area_mm2, stretch, table["time_s"].to_numpy(), said


def _inflation(path: Path, h0: float, row: pd.Series) -> Curve:
    """Return the Cauchy stress p r / (2 h0 lam_3) [MPa], stretch, time [s] and findings at the apex of a membrane."""
    if has_pictures(path):
        table, said = tracked_inflation(path, row)
    else:
        columns = ("time_s", "pressure_kPa", "apex_radius_mm", "stretch_1")
        table, said = read_csv(path, numbers=columns, optional_numbers=("stretch_2",)), []
    stretch = _checked_stretch(path, table)
    _check_time(path, table)
    _check_lateral(path, "equibiaxial", table)
    r = table["apex_radius_mm"].to_numpy()
    if (i := too_thick(r, h0)) is not None:
        raise TableError(
            f"{path}, row {table.index[i]}: apex_radius_mm {r[i]:g} with a thickness of {h0:g} mm;"
            f" p r / (2 h0 lam_3) needs r >= {LEAST_RADIUS_TO_THICKNESS:g} h0 (a thin membrane);"
            " check the units, or use a thinner or wider membrane"
        )
    lateral = table["stretch_2"].to_numpy()
    stretch_2 = np.where(np.isfinite(lateral), lateral, stretch)
    stress = membrane_cauchy(table["pressure_kPa"].to_numpy() * 1e-3, r, h0, stretch, stretch_2)
    return stress, stretch, table["time_s"].to_numpy(), said


def _dimension(folder: Path, line: int, row: pd.Series, name: str, limits: tuple[float, float]) -> float:
    value = float(row[name])
    if not limits[0] <= value <= limits[1]:  # also catches an empty cell
        found = "empty" if np.isnan(value) else f"{value:g}"
        raise TableError(
            f"{folder / 'samples.csv'}, row {line}: {name} is {found}; between {limits[0]:g} and"
            f" {limits[1]:g} mm is expected, {'fill it' if found == 'empty' else 'check the unit'}"
        )
    return value


def _checked_stretch(path: Path, table: pd.DataFrame) -> np.ndarray:
    """Return stretch_1 (n,) of a monotonic test."""
    stretch = table["stretch_1"]
    if (stretch <= 0).any():
        line = stretch.index[stretch <= 0][0]
        raise TableError(
            f"{path}, row {line}: stretch_1 is {stretch[line]:g}; a stretch is current over initial length,"
            " above 0 and 1 at rest; write 1 + strain"
        )
    outside = (stretch < STRETCH[0]) | (stretch > STRETCH[1])
    if outside.any():
        line = stretch.index[outside][0]
        raise TableError(
            f"{path}, row {line}: stretch_1 is {stretch[line]:g}; between {STRETCH[0]:g} and {STRETCH[1]:g}"
            " is expected (1 at rest); convert strain or per cent to stretch"
        )
    values = stretch.to_numpy()
    extent = np.ptp(values)
    if extent < LEAST_STRETCH_RANGE:
        raise TableError(
            f"{path}: stretch_1 runs from {values.min():g} to {values.max():g}; a range of"
            f" {LEAST_STRETCH_RANGE:g} at least is needed to find a law, test further"
        )
    i = first_reversal(values)
    if i is not None:
        furthest = values[:i][np.argmax(np.abs(values[:i] - values[0]))]
        raise TableError(
            f"{path}, row {table.index[i]}: stretch_1 {values[i]:g} after {furthest:g};"
            " a monotonic test is expected, keep one loading and drop the rest"
        )
    return values


def _check_time(path: Path, table: pd.DataFrame) -> None:
    time = table["time_s"].to_numpy()
    if (np.diff(time) < 0).any():
        i = int(np.argmax(np.diff(time) < 0)) + 1
        raise TableError(
            f"{path}, row {table.index[i]}: time_s {time[i]:g} after {time[i - 1]:g}; sort the rows by time"
        )


def _check_lateral(path: Path, test: str, table: pd.DataFrame) -> None:
    """Refuse a tracked stretch_2 that belongs to another load case."""
    expected = principal_stretches(test, table["stretch_1"].to_numpy())[:, 1]
    wrong = (table["stretch_2"] / expected - 1).abs() > LATERAL_STRETCH  # false where stretch_2 is empty
    if wrong.any():
        i = int(np.argmax(wrong))
        raise TableError(
            f"{path}, row {table.index[i]}: stretch_2 is {table['stretch_2'].iloc[i]:g} where {test} has"
            f" {expected[i]:.3g} (within {LATERAL_STRETCH:.0%}); check `test` in samples.csv and the column"
        )


def _secant_shear_modulus(curve: MaterialTest) -> float:
    """Return the median neo-Hookean shear modulus [MPa], sigma_1 / (lam_1^2 - lam_3^2), of strained rows."""
    strained = np.abs(curve.stretch - 1) > LEAST_STRETCH_RANGE / 2
    lam = principal_stretches(curve.test, curve.stretch[strained])
    return float(np.median(curve.cauchy_stress[strained] / (lam[:, 0] ** 2 - lam[:, 2] ** 2)))


def _check_stress_level(folder: Path, names: list[str], curves: list[MaterialTest]) -> None:
    """Refuse samples whose stiffness is out of the range of soft elastomers or far from the other samples."""
    moduli = np.array([_secant_shear_modulus(curve) for curve in curves])
    low, high = SHEAR_MODULUS_MPA
    typical = float(np.median(moduli))
    remedy = "check the units of force, pressure, width and thickness"
    found = [
        f"{folder / n}: all rows together give a shear modulus of {m * 1e3:.3g} kPa"
        for n, m in zip(names, moduli)
    ]
    for text, modulus in zip(found, moduli):
        if not low <= modulus <= high:
            raise TableError(f"{text}; a soft elastomer has {low * 1e3:g} to {high * 1e3:g} kPa, {remedy}")
    for text, modulus in zip(found, moduli):
        if not 1 / LARGEST_MODULUS_RATIO <= modulus / typical <= LARGEST_MODULUS_RATIO:
            raise TableError(
                f"{text}, the median of the samples {typical * 1e3:.3g} kPa; within a factor of"
                f" {LARGEST_MODULUS_RATIO:g} is expected, {remedy}"
            )
