"""Readers of material tests: samples.csv and one CSV per sample in, stress against stretch out.

Cauchy stress in the loading direction as in Sferrazza et al. 2019, sec. II-C: F lam_1 / (w0 h0) for uniaxial
tension and pure shear, p r / (2 h0 lam_3) with lam_3 = 1 / (lam_1 lam_2) at the apex of an inflated membrane.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import NAME
from gelforge.csv_table import TableError, read_comments, read_csv
from gelforge.materials.basis.common_form import HISTORIES, MaterialTest, Segment
from gelforge.materials.basis.segments import find_segments, first_reversal
from gelforge.materials.basis.stresses import LEAST_RADIUS_TO_THICKNESS, membrane_cauchy, too_thick
from gelforge.materials.imaging.piece_pictures import (
    PICTURE_SETTINGS,
    has_pictures,
    picture_files,
    tracked_inflation,
    tracked_tension,
)
from gelforge.materials.plausibility.falls import fall_while_loading, fall_words
from gelforge.materials.plausibility.findings import corrected, findings, rate_while_loading
from gelforge.materials.plausibility.odd_rows import check_rows
from gelforge.materials.readers.mapped_checks import in_no_order, unnoticed_unit
from gelforge.materials.readers.small_files import small_test_files
from gelforge.materials.small_tests.trials import THICKNESS, THICKNESS_MM, Mean, sheet_thickness
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, principal_stretches

RELAXATION = "relaxation"  # as a `test` in samples.csv: a strip in uniaxial tension whose stretch is held
KEEP = "keep_odd_rows"  # confirms what odd_rows.py would refuse
CUT = "cut_after_fall"  # ends a curve where its stress falls at once
# made where samples.csv asks for them, stated in the findings
CORRECTIONS = ("toe", "zero_force", "zero_strain", KEEP, CUT)
CIRCUMSTANCES = ("strain_rate_per_s", "age_days", "temperature_C", "cycle")

# Sheets and strips, with ends less than a factor of 1000 apart: a width in m is refused (test_reading_material_tests.py).
WIDTH_MM = (1.0, 300.0)
# A strain or per cent in place of a stretch is refused (test_reading_material_tests.py).
STRETCH = (0.2, 15.0)
# Secant modulus of a sample, from gels (0.5 kPa) to filled rubber (Shore A 90, 5 MPa). 20 kPa with the force in mN or kN
# are refused (test_reading_material_tests.py); where a unit wrong by 1000 would stay inside, a finding says so.
SHEAR_MODULUS_MPA = (0.5e-3, 5.0)
# Needed to find a constitutive model: a strip from 1 to 1.03 is refused (test_reading_material_tests.py).
LEAST_STRETCH_RANGE = 0.05
# Between a sample and the median of its material: scatter of curing stays below 2, a file in other units 25 times softer is
# refused (test_reading_material_tests.py).
LARGEST_MODULUS_RATIO = 10.0
# Relative distance of a tracked stretch_2 from the load case: 1 where 1.6 is expected is refused
# (test_reading_material_tests.py).
LATERAL_STRETCH = 0.2


def input_files(folder: str | Path) -> list[Path]:
    """Return every file that decides a material's results.

    samples.csv, the files of all samples that it lists, in its order, the pictures that these name, and the small
    tests next to them; the latter alone where there is no samples.csv.
    """
    tables, small = _tables(Path(folder)), small_test_files(folder)
    pictures = [picture for table in tables[1:] if table.is_file() for picture in picture_files(table)]
    return [*tables, *dict.fromkeys(pictures), *small]


def _tables(folder: Path) -> list[Path]:
    path = folder / "samples.csv"
    if not os.path.lexists(path):
        if small_test_files(folder):
            return []
        below = sorted(table.parent.relative_to(folder).as_posix() for table in folder.glob("*/samples.csv"))
        remedy = (
            "list the specimens in it (docs/file-formats.md), or give a mapping that says what the files in this folder"
            " hold (--mapping, in Python mapping=; docs/material-mappings.md)"
        )
        if below:
            remedy = f"name the folder of one material: {', '.join(below)}"
        raise TableError(f"{path}: no such file; {remedy}")
    return [path, *(folder / name for name in _read_samples(folder)["file"])]


def declared_synthetic(folder: str | Path) -> bool:
    """Return whether a comment above the header of any file of a material says "synthetic"."""
    return any(
        "synthetic" in comment.lower()
        for path in (*_tables(Path(folder)), *small_test_files(folder))
        if path.suffix == ".csv"
        for comment in read_comments(path)
    )


def read_material_tests(folder: str | Path) -> list[MaterialTest]:
    """Return the tests of a material's samples, as in samples.csv; none where a folder holds small tests only.

    Raises TableError with file, row, value, limit and remedy for anything that cannot be right.
    """
    folder = Path(folder)
    if not _tables(folder):
        return []
    samples, sections = _read_samples(folder), {}
    if os.path.lexists(folder / THICKNESS):
        sections = sheet_thickness(folder / THICKNESS)
    curves = [_read_sample(folder, line, row, sections) for line, row in samples.iterrows()]
    moduli = _check_stress_level(folder, list(samples["file"]), curves)
    least, most = SHEAR_MODULUS_MPA
    limits = 1e3 * least, 1e3 * most
    odd = (unnoticed_unit(1e3 * modulus, limits, "a shear modulus", "kPa") for modulus in moduli)
    return [replace(curve, findings=(*curve.findings, *said)) for curve, said in zip(curves, odd)]


def _read_samples(folder: Path) -> pd.DataFrame:
    path = folder / "samples.csv"
    samples = read_csv(
        path,
        texts=("file", "test", "sample"),
        optional_numbers=("width_mm", "thickness_mm", *CIRCUMSTANCES, *PICTURE_SETTINGS),
        optional_texts=("history", "corrections"),
    )
    known = (*LOAD_CASES, RELAXATION)
    seen: dict[tuple, int] = {}
    for line, row in samples.iterrows():
        where, name = f"{path}, row {line}", row["sample"]
        if row.test not in known:
            raise TableError(f"{where}: test is {row.test!r}; one of {list(known)} is expected")
        if not NAME.fullmatch(name) or name == "mean":
            raise TableError(f"{where}: sample is {name!r}; use letters, digits, '_', '-', not 'mean'")
        if row.history not in ("", *HISTORIES):
            raise TableError(
                f"{where}: history is {row.history!r}; one of {list(HISTORIES)} is expected, or empty"
            )
        if unknown := set(row.corrections.split()) - set(CORRECTIONS):
            raise TableError(f"{where}: corrections has {sorted(unknown)}; known are {list(CORRECTIONS)}")
        key = row.test, name, 1 if np.isnan(row["cycle"]) else int(row["cycle"])
        if (before := seen.setdefault(key, line)) != line:
            found = f"{row.test} sample {name!r} is also in row {before}"
            raise TableError(f"{where}: {found}; give each its own name (or its `cycle`)")
    samples["history"] = [
        RELAXATION if row.test == RELAXATION else row.history or HISTORIES[0] for _, row in samples.iterrows()
    ]
    return samples


def _read_sample(folder: Path, line: int, row: pd.Series, sections: dict[str, Mean]) -> MaterialTest:
    path = folder / row.file
    if not path.is_file():
        where = f"{folder / 'samples.csv'}, row {line}"
        raise TableError(f"{where}: file {row.file!r} is not in {folder}; add it or drop the row")
    if "nominal_stress_kPa" in read_csv(path).columns:
        columns = ("stretch_1", "nominal_stress_kPa")
        said: list[str] = []
        table = read_csv(path, numbers=columns, optional_numbers=("time_s", "stretch_2"))
        stretch, time_s = _checked_stretch(path, table, row.history), table["time_s"].to_numpy()
        stress = table["nominal_stress_kPa"].to_numpy() * 1e-3 * stretch
        if not np.isnan(time_s).any():
            _check_time(path, table)
        elif row.history == RELAXATION:
            raise TableError(f"{path}: time_s is missing or empty; a hold needs the time of every row")
        else:
            time_s = None
        _check_lateral(path, row, table)
    else:
        h0, thickness_said = _thickness(folder, line, row, sections)
        if row.test == "equibiaxial":
            table, stress, said = _inflation(path, h0, row)
        else:
            width = _dimension(folder, line, row, "width_mm", WIDTH_MM)
            table, stress, said = _tension(path, width * h0, row)
        stretch, time_s = table["stretch_1"].to_numpy(), table["time_s"].to_numpy()
        said = [*said, *thickness_said]
    return _material_test(folder, row, table, stress / stretch, time_s, said)


def _thickness(folder: Path, line: int, row: pd.Series, sections: dict[str, Mean]) -> tuple[float, list[str]]:
    """Return the thickness h0 [mm] of a sample, from its sections where samples.csv leaves it empty; and findings."""
    measured = sections.get(row["sample"])
    if np.isnan(row["thickness_mm"]) and measured:
        said = f"thickness {measured.value:.4g} mm, the mean of {measured.count} sections in {THICKNESS}"
        return measured.value, [said]
    h0 = _dimension(folder, line, row, "thickness_mm", THICKNESS_MM)
    if measured and not measured.interval[0] <= h0 <= measured.interval[1]:
        low, high = measured.interval
        return h0, [
            f"thickness_mm {h0:g} in samples.csv is used, but its sections in {THICKNESS} say {measured.value:.4g}"
            f" (95 % interval {low:.4g} to {high:.4g})"
        ]
    return h0, []


def _material_test(
    folder: Path, row: pd.Series, table: pd.DataFrame, nominal_stress, time_s, said: Sequence[str]
) -> MaterialTest:
    known = {name: None if np.isnan(row[name]) else float(row[name]) for name in CIRCUMSTANCES}
    stretch, lateral = table["stretch_1"].to_numpy(), table["stretch_2"].to_numpy()
    segments: tuple[Segment, ...] = (Segment("load", 0, len(stretch), 1),)
    if row.history != HISTORIES[0]:
        segments = find_segments(stretch, time_s)
    test = MaterialTest(
        "uniaxial" if row.test == RELAXATION else row.test,
        row["sample"],
        stretch,
        nominal_stress,
        time_s,
        lateral if np.isfinite(lateral).any() else None,
        history=row.history,
        material=folder.name,
        age_days=known["age_days"],
        temperature_C=known["temperature_C"],
        cycle=None if known["cycle"] is None else int(known["cycle"]),
        segments=segments,
        findings=tuple(said),
        source=row.file,
    )
    words = set(row.corrections.split())
    fall = fall_while_loading(test)
    if fall and CUT in words:
        stop = fall.row + 1
        left = float(np.ptp(test.stretch[:stop]))
        if left < LEAST_STRETCH_RANGE:
            raise TableError(
                f"{folder / row.file}, {fall_words(fall, table.index)}: the stretch before it has a range of {left:.3g},"
                f" {LEAST_STRETCH_RANGE:g} at least is needed to find a constitutive model; leave the sample out, or confirm"
                f" it with `{KEEP}`"
            )
        said = [*said, f"corrected: {fall_words(fall, table.index)}; cut there ({CUT})"]
        time_s = None if time_s is None else time_s[:stop]
        return _material_test(folder, row, table.iloc[:stop], nominal_stress[:stop], time_s, said)
    if fall and KEEP not in words:
        raise TableError(
            f"{folder / row.file}, {fall_words(fall, table.index)}; cut the curve there with `{CUT}` among the corrections"
            f" in samples.csv, or confirm it with `{KEEP}`"
        )
    rate, stated = rate_while_loading(test), known["strain_rate_per_s"]
    odd = findings(test, stated, "is in samples.csv")
    used = rate[0] if rate and stated is None else stated
    test = replace(test, rate_per_s=used, findings=(*test.findings, *odd))
    if KEEP not in words:
        remedy = f"or confirm it with `{KEEP}` among the corrections in samples.csv"
        check_rows(folder / row.file, table.index, test, remedy, "zero_force" in words, "toe" in words)
    return corrected(test, **{name: True for name in words - {KEEP, CUT}})


Curve = tuple[pd.DataFrame, np.ndarray, list[str]]  # table of the sample, Cauchy stress [MPa], findings


def _tension(path: Path, area_mm2: float, row: pd.Series) -> Curve:
    """Return time_s, stretch_1 and stretch_2 of a strip as a table, its Cauchy stress F lam_1 / (w0 h0), findings."""
    if has_pictures(path):
        table, said = tracked_tension(path, row)
    else:
        columns = ("time_s", "force_N", "stretch_1")
        table, said = read_csv(path, numbers=columns, optional_numbers=("stretch_2",)), []
    stretch = _checked_stretch(path, table, row.history)
    _check_time(path, table)
    _check_lateral(path, row, table)
    return table, table["force_N"].to_numpy() * stretch / area_mm2, said


def _inflation(path: Path, h0: float, row: pd.Series) -> Curve:
    """Return the same of the apex of a membrane, its Cauchy stress p r / (2 h0 lam_3)."""
    if has_pictures(path):
        table, said = tracked_inflation(path, row)
    else:
        columns = ("time_s", "pressure_kPa", "apex_radius_mm", "stretch_1")
        table, said = read_csv(path, numbers=columns, optional_numbers=("stretch_2",)), []
    stretch = _checked_stretch(path, table, row.history)
    _check_time(path, table)
    _check_lateral(path, row, table)
    r = table["apex_radius_mm"].to_numpy()
    if (i := too_thick(r, h0)) is not None:
        raise TableError(
            f"{path}, row {table.index[i]}: apex_radius_mm {r[i]:g} with a thickness of {h0:g} mm;"
            f" p r / (2 h0 lam_3) needs r >= {LEAST_RADIUS_TO_THICKNESS:g} h0 (a thin membrane);"
            " check the units, or use a thinner or wider membrane"
        )
    lateral = table["stretch_2"].to_numpy()
    stretch_2 = np.where(np.isfinite(lateral), lateral, stretch)
    return table, membrane_cauchy(table["pressure_kPa"].to_numpy() * 1e-3, r, h0, stretch, stretch_2), said


def _dimension(folder: Path, line: int, row: pd.Series, name: str, limits: tuple[float, float]) -> float:
    value = float(row[name])
    if not limits[0] <= value <= limits[1]:  # also catches an empty cell
        stated = "empty" if np.isnan(value) else f"{value:g}"
        raise TableError(
            f"{folder / 'samples.csv'}, row {line}: {name} is {stated}; between {limits[0]:g} and"
            f" {limits[1]:g} mm is expected, {'fill it' if stated == 'empty' else 'check the unit'}"
        )
    return value


def _checked_stretch(path: Path, table: pd.DataFrame, history: str) -> np.ndarray:
    """Return stretch_1 (n,); of a test that is not declared otherwise it must run one way."""
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
    extent = max(np.ptp(values), np.max(np.abs(values - 1))) if history == RELAXATION else np.ptp(values)
    if extent < LEAST_STRETCH_RANGE:
        raise TableError(
            f"{path}: stretch_1 runs from {values.min():g} to {values.max():g}; a range of"
            f" {LEAST_STRETCH_RANGE:g} at least is needed to find a constitutive model, test further"
        )
    if history != RELAXATION and in_no_order(values):
        raise TableError(f"{path}: the rows are in no order of stretch_1; sort them by it, or by time")
    i = first_reversal(values) if history == HISTORIES[0] else None
    if i is not None:
        furthest = values[:i][np.argmax(np.abs(values[:i] - values[0]))]
        raise TableError(
            f"{path}, row {table.index[i]}: stretch_1 {values[i]:g} after {furthest:g};"
            " a monotonic test is expected, keep one loading, or write cyclic or relaxation into the column `history`"
            " of samples.csv"
        )
    return values


def _check_time(path: Path, table: pd.DataFrame) -> None:
    time = table["time_s"].to_numpy()
    if (np.diff(time) < 0).any():
        i = int(np.argmax(np.diff(time) < 0)) + 1
        steps = f"time_s {time[i]:g} after {time[i - 1]:g}"
        raise TableError(f"{path}, row {table.index[i]}: {steps}; sort the rows by time")


def _check_lateral(path: Path, row: pd.Series, table: pd.DataFrame) -> None:
    """Refuse a tracked stretch_2 that belongs to another load case."""
    test = "uniaxial" if row.test == RELAXATION else row.test
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


def _check_stress_level(folder: Path, names: list[str], curves: list[MaterialTest]) -> np.ndarray:
    """Return the samples' shear moduli (n,) [MPa]; refuse those of no soft elastomer or far from the other samples."""
    moduli = np.array([_secant_shear_modulus(curve) for curve in curves])
    low, high = SHEAR_MODULUS_MPA
    typical = float(np.median(moduli))
    remedy = "check the units of force, pressure, width and thickness"
    found = "all rows together give a shear modulus of"
    levels = [f"{folder / n}: {found} {m * 1e3:.3g} kPa" for n, m in zip(names, moduli)]
    for text, modulus in zip(levels, moduli):
        if not low <= modulus <= high:
            raise TableError(f"{text}; a soft elastomer has {low * 1e3:g} to {high * 1e3:g} kPa, {remedy}")
    for text, modulus in zip(levels, moduli):
        if not 1 / LARGEST_MODULUS_RATIO <= modulus / typical <= LARGEST_MODULUS_RATIO:
            raise TableError(
                f"{text}, the median of the samples {typical * 1e3:.3g} kPa; within a factor of"
                f" {LARGEST_MODULUS_RATIO:g} is expected, {remedy}"
            )
    return moduli
