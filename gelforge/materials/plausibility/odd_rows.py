"""Rows of a material test that cannot belong to its curve: single values, a start under load, a copy of another sample.

`corrections: {odd_rows: keep}` of a mapping, or `keep_odd_rows` among the corrections of samples.csv, confirms them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gelforge.csv_table import TableError
from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.statistics import ROWS_OF_SCATTER, channel_step, row_noise
from gelforge.materials.plausibility.rest_force import REST, rest_words
from gelforge.robust import SIGMA_OF_MEDIAN

# Faulty curves are refused and their right neighbours read (tests/materials/test_odd_rows.py, test_curve_defects.py):
SINGLE_SHARE = 0.1  # of the loading's range: load cells err by a hundredth of this, a lost digit by more
# The same of a first or last row, which has a neighbour on one side only: a last row a thousand times too small is refused,
# the turn of a cycle of 12 rows passes (test_odd_rows.py).
END_SHARE = 0.5
# Of the rows' scatter about their neighbours: far beyond noise, also that of heavy tails. Rows that scatter by 5 % pass,
# one at 1.4 times its stress under noise of 0.1 % is refused (test_odd_rows.py).
SIGMAS = 20.0
# Of a coarse channel, which rounds one row up and the next down: single steps of 2.5 kPa are no odd rows
# (test_curve_defects.py).
STEPS = 2.0
# Of the largest strain: rows nearer to rest than this. There a gel whose stress is the root of its strain bears 32 %, a
# filled rubber 47 % and a start under load more than START_STRESS (test_odd_rows.py).
START_STRAIN = 0.1
# Of the largest: an elastomer bears a fifth of it there, a column that was swapped any. 47 % pass (test_odd_rows.py).
START_STRESS = 0.5
# Of the largest stress, the least that matters of what rest itself seems to bear: time read as pressure has more than 30 %
# and is refused, a load cell's zero of 9 % passes (test_odd_rows.py).
REST_STRESS = 0.2
# Of the stress near rest, by a straight line to rest: any power of the strain above 0.2 has less, and 0.25 passes
# (test_odd_rows.py).
REST_SHARE = 0.7
# Rows at the largest stress, and share of the stretch that they cover: curves cut at 0.5 and 0.8 of their stress are named,
# those that flatten by themselves pass (test_curve_defects.py).
LEAST_FLAT, FLAT_STRETCH = 5, 0.02
# Below a maximum of a parabola level k has sqrt(k) - sqrt(k - 1) of the rows of the largest one: the first has 2.2 times
# the median of so many, and more where a curve tends to a plateau; a curve that is cut off has as many rows in each
# (test_curve_defects.py).
FEW_LEVELS, LEAST_LEVEL, SLOWER = 12, 3, 2.0
# Of the largest stress, beyond which it doubles the small-strain modulus: preloads by 8 % of strain are refused, an offset
# of 7 % of the stress is a note (test_curve_defects.py).
LEAST_REST_STRESS = 0.1


def check_rows(
    path: Path, lines: Sequence[int], test: MaterialTest, remedy: str, zeroed: bool = False, toe: bool = False
) -> None:
    """Refuse a single row far off its curve, and a start under load unless the force is zeroed, or its origin moved (toe).

    lines: the row numbers in the file; remedy: how to confirm. Raises TableError.
    """
    if not np.isfinite(test.nominal_stress).all():
        return
    for segment in test.segments:
        if segment.kind == "hold":
            continue
        row = single_row(test.stretch[segment.rows], test.nominal_stress[segment.rows])
        if row is not None:
            i = segment.start + row
            raise TableError(
                f"{path}, row {lines[i]}: a nominal stress of {test.nominal_stress[i] * 1e3:.4g} kPa at"
                f" {test.abscissa} {test.stretch[i]:.4g}, far off the neighbouring rows; correct or drop the row, {remedy}"
            )
        if segment.kind == "load":
            flat = flat_top(test.stretch[segment.rows], test.nominal_stress[segment.rows])
            if flat is not None:
                i = segment.start + flat
                raise TableError(
                    f"{path}, row {lines[i]}: from here on the stress stays at {test.nominal_stress[i] * 1e3:.4g} kPa to the"
                    f" last digit, its largest value, while the {test.abscissa} goes on: the load cell is saturated; leave"
                    f" these rows out, {remedy}"
                )
    first = next((segment for segment in test.segments if segment.kind == "load"), None)
    if first is None or zeroed or test.test == "biaxial":
        return
    strain = np.abs(test.stretch[first.rows] - test.at_rest)
    stress = np.abs(test.nominal_stress[first.rows])
    near = strain <= START_STRAIN * strain.max()
    if near.sum() >= 2 and np.median(stress[near]) > START_STRESS * stress.max():
        raise TableError(
            f"{path}: {np.median(stress[near]) / stress.max():.0%} of the largest stress is there before a tenth of the"
            f" strain; {START_STRESS:.0%} at most are expected: check the columns, subtract the force at rest"
            f" (`zero_force`), {remedy}"
        )
    if toe:
        return
    resting = strain <= REST
    if resting.any():
        rest = float(np.median(test.nominal_stress[first.rows][resting]))
        if abs(rest) > max(
            LEAST_REST_STRESS * stress.max(), 5 * row_noise(stress, ROWS_OF_SCATTER) / np.sqrt(resting.sum())
        ):
            raise TableError(
                f"{path}: {rest * 1e3:.4g} kPa, {abs(rest) / stress.max():.0%} of the largest stress, at {test.abscissa}"
                f" {test.at_rest:g}; {LEAST_REST_STRESS:.0%} at most are expected: {rest_words(test, rest)}, {remedy}"
            )
    if near.sum() < 3:
        return
    unstrained = _stress_at_rest(strain[near], stress[near])
    if unstrained > max(REST_STRESS * stress.max(), REST_SHARE * np.median(stress[near])):
        raise TableError(
            f"{path}: the rows before a tenth of the strain lead to {unstrained / stress.max():.0%} of the largest stress at"
            f" {test.abscissa} {test.at_rest:g}; {REST_STRESS:.0%} at most are expected: check the columns;"
            f" {rest_words(test, unstrained * np.sign(np.median(test.nominal_stress[first.rows])))}, {remedy}"
        )


def _stress_at_rest(strain: np.ndarray, stress: np.ndarray) -> float:
    """Return where a straight line through rows (n,) meets no strain; 0 where they are at one strain."""
    return float(np.polyfit(strain, stress, 1)[1]) if np.ptp(strain) else 0.0


def flat_top(stretch: np.ndarray, stress: np.ndarray) -> int | None:
    """Return the first of many rows at exactly the largest stress while the stretch goes on; None where there are none.

    Of a coarse channel rows are equal elsewhere too. A curve that flattens by itself slows down before: the level next to
    the largest has more rows than those below it.
    """
    size = np.abs(stress)
    # forces that are equal make stresses that are nearly so
    size = np.round(size / max(size.max(), 1e-300), 9)
    top = size == size.max()
    others = size[~top]
    if (
        top.sum() < LEAST_FLAT
        or len(others) < ROWS_OF_SCATTER
        or np.ptp(stretch[top]) < FLAT_STRETCH * np.ptp(stretch)
    ):
        return None
    _, counts = np.unique(others, return_counts=True)
    below = counts[-1 - FEW_LEVELS : -1]
    slows_down = counts[-1] >= LEAST_LEVEL and len(below) and counts[-1] >= SLOWER * np.median(below)
    return int(np.argmax(top)) if counts.max() < top.sum() / 2 and not slows_down else None


def single_row(stretch: np.ndarray, stress: np.ndarray) -> int | None:
    """Return a row whose stress (or force) is far off that of its neighbours, which agree; None where there is none."""
    if len(stress) < ROWS_OF_SCATTER:
        return None
    off = stress[1:-1] - (stress[:-2] + stress[2:]) / 2
    scatter = max(SIGMAS * SIGMA_OF_MEDIAN * np.median(np.abs(off)), STEPS * channel_step(stress))
    extent = np.quantile(stress, 0.95) - np.quantile(stress, 0.05)
    steady = np.abs(np.diff(np.sign(np.diff(stretch)))) == 0  # the stretch goes one way past the row
    agree = np.abs(stress[2:] - stress[:-2]) < np.abs(off)
    odd = (np.abs(off) > max(scatter, SINGLE_SHARE * extent)) & steady & agree
    if odd.any():
        return int(np.argmax(np.abs(off) * odd)) + 1
    for end, one, two in ((0, 1, 2), (-1, -2, -3)):
        gap = abs(stress[end] - (2 * stress[one] - stress[two]))
        if gap > max(scatter, END_SHARE * extent):
            return end % len(stress)
    return None


def check_copies(where: str, tests: Sequence[MaterialTest]) -> None:
    """Refuse two samples of one material that hold the same curve: a file was copied or named twice."""
    seen: dict[bytes, MaterialTest] = {}
    for test in tests:
        curve = np.stack([test.stretch, np.nan_to_num(test.nominal_stress), _or_zero(test)])
        if len(test.stretch) < ROWS_OF_SCATTER:
            continue
        before = seen.setdefault(np.round(curve, 12).tobytes(), test)
        if before is not test:
            raise TableError(
                f"{where}: {before.test} {before.sample} ({before.source}) and {test.test} {test.sample}"
                f" ({test.source}) hold the same values; name each sample's own file"
            )


def _or_zero(test: MaterialTest) -> np.ndarray:
    other = test.cauchy_difference
    return np.zeros(len(test.stretch)) if other is None else np.nan_to_num(other)
