"""Readers of material tests: samples.csv and one CSV per sample in, stress against stretch out.

Cauchy stress in the loading direction as in Sferrazza et al. 2019, sec. II-C: F lam_1 / (w0 h0) for uniaxial
tension and pure shear, p r / (2 h0 lam_3) with lam_3 = 1 / (lam_1 lam_2) at the apex of an inflated membrane.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import NAME
from gelforge.csv_table import TableError, read_comments, read_csv
from gelforge.mechanics.homogeneous import LOAD_CASES, principal_stretches

TESTS_NOT_FITTED = ("relaxation",)

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
BACK_STEP = 0.01  # of the tested range: noise of the optical strain measurement, not a reversal
LEAST_RADIUS_TO_THICKNESS = 10.0  # the membrane formula needs h0 << r; bending is then below (h0/r)^2 = 1 %
LATERAL_STRETCH = 0.2  # relative distance of a tracked stretch_2 from the load case


@dataclass(frozen=True)
class SampleCurve:
    """The measured curve of one sample: stretch (n,) and Cauchy stress (n,) [MPa] along the load."""

    test: str
    sample: str
    stretch: np.ndarray
    cauchy_stress: np.ndarray

    @property
    def nominal_stress(self) -> np.ndarray:
        """Return the force per undeformed area (n,) [MPa]."""
        return self.cauchy_stress / self.stretch


def input_files(folder: str | Path) -> list[Path]:
    """Return samples.csv and the files of all samples that it lists, in its order."""
    folder = Path(folder)
    return [folder / "samples.csv", *(folder / name for name in _read_samples(folder)["file"])]


def declared_synthetic(folder: str | Path) -> bool:
    """Return whether a comment above the header of any file of a material says "synthetic"."""
    return any(
        "synthetic" in comment.lower() for path in input_files(folder) for comment in read_comments(path)
    )


def read_material_tests(folder: str | Path) -> list[SampleCurve]:
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
    samples = read_csv(path, texts=("file", "test", "sample"), optional_numbers=("width_mm", "thickness_mm"))
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


def _read_sample(folder: Path, line: int, row: pd.Series) -> SampleCurve:
    path = folder / row.file
    if not path.is_file():
        raise TableError(
            f"{folder / 'samples.csv'}, row {line}: file {row.file!r} is not in {folder};"
            " add it or drop the row"
        )
    if "nominal_stress_kPa" in read_csv(path).columns:
        table = read_csv(path, numbers=("stretch_1", "nominal_stress_kPa"))
        stretch = _checked_stretch(path, table)
        return SampleCurve(
            row.test, row["sample"], stretch, table["nominal_stress_kPa"].to_numpy() * 1e-3 * stretch
        )
    h0 = _dimension(folder, line, row, "thickness_mm", THICKNESS_MM)
    if row.test == "equibiaxial":
        stress, stretch = _inflation(path, h0)
    else:
        stress, stretch = _tension(path, row.test, _dimension(folder, line, row, "width_mm", WIDTH_MM) * h0)
    return SampleCurve(row.test, row["sample"], stretch, stress)


def _tension(path: Path, test: str, area_mm2: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the Cauchy stress F lam_1 / (w0 h0) [MPa] and the stretch of a uniaxial or pure-shear sample."""
    table = read_csv(path, numbers=("time_s", "force_N", "stretch_1"), optional_numbers=("stretch_2",))
    stretch = _checked_stretch(path, table)
    _check_time(path, table)
    _check_lateral(path, test, table)
    return table["force_N"].to_numpy() * stretch / area_mm2, stretch


def _inflation(path: Path, h0: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the Cauchy stress p r / (2 h0 lam_3) [MPa] and the stretch at the apex of a membrane."""
    columns = ("time_s", "pressure_kPa", "apex_radius_mm", "stretch_1")
    table = read_csv(path, numbers=columns, optional_numbers=("stretch_2",))
    stretch = _checked_stretch(path, table)
    _check_time(path, table)
    _check_lateral(path, "equibiaxial", table)
    r = table["apex_radius_mm"]
    if (r < LEAST_RADIUS_TO_THICKNESS * h0).any():
        line = r.index[r < LEAST_RADIUS_TO_THICKNESS * h0][0]
        raise TableError(
            f"{path}, row {line}: apex_radius_mm {r[line]:g} with a thickness of {h0:g} mm;"
            f" p r / (2 h0 lam_3) needs r >= {LEAST_RADIUS_TO_THICKNESS:g} h0 (a thin membrane);"
            " check the units, or use a thinner or wider membrane"
        )
    lateral = table["stretch_2"].to_numpy()
    lam_3 = 1 / (stretch * np.where(np.isfinite(lateral), lateral, stretch))
    return table["pressure_kPa"].to_numpy() * 1e-3 * r.to_numpy() / (2 * h0 * lam_3), stretch


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
    loading = np.sign(values[np.argmax(np.abs(values - values[0]))] - values[0])  # -1 in compression
    furthest = np.maximum.accumulate(loading * values)
    back = furthest - loading * values > BACK_STEP * extent
    if back.any():
        i = int(np.argmax(back))
        raise TableError(
            f"{path}, row {table.index[i]}: stretch_1 {values[i]:g} after {loading * furthest[i]:g};"
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


def _secant_shear_modulus(curve: SampleCurve) -> float:
    """Return the median neo-Hookean shear modulus [MPa], sigma_1 / (lam_1^2 - lam_3^2), of strained rows."""
    strained = np.abs(curve.stretch - 1) > LEAST_STRETCH_RANGE / 2
    lam = principal_stretches(curve.test, curve.stretch[strained])
    return float(np.median(curve.cauchy_stress[strained] / (lam[:, 0] ** 2 - lam[:, 2] ** 2)))


def _check_stress_level(folder: Path, names: list[str], curves: list[SampleCurve]) -> None:
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
