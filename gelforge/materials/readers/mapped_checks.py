"""What cannot be right in a mapped material test is refused, with file, row, value, limit and remedy."""

from __future__ import annotations

import numpy as np

from gelforge.config.foreign.mapping import Strain
from gelforge.csv_table import TableError
from gelforge.materials.basis.common_form import MaterialTest, Segment
from gelforge.materials.basis.segments import find_segments, first_reversal
from gelforge.materials.basis.stresses import LEAST_STRAIN, neo_hookean_shape
from gelforge.materials.readers.mapped_columns import nominal_stress_of, stretch_of

# The softest silicones break below a stretch of 20, foams densify at 0.1: per cent read as a number, or a length read as a
# stretch, fall out. Wrong units, signs and columns are refused, their right neighbours read (benchmarks/faults.py, inputs).
STRETCH = (0.05, 25.0)
# Adhesives are sheared up to 10; a shear 1000 times too large is refused (benchmarks/faults.py, inputs).
SHEAR = (-12.0, 12.0)
# Of the strained rows: the stress has the sign of the strain; of a pull recorded as negative none has
# (tests/materials/test_mapping.py).
SAME_SIGN = 0.8
# A person's rate: crosshead and gauge differ by up to 3, minutes and seconds by 60, milliseconds by 1000; times 1000 times
# too large are refused (benchmarks/faults.py, inputs).
DECLARED_RATE = 5.0
WRONG_UNIT = 1000.0  # between MPa, kPa and Pa, N and mN, mm and um (prefixes of NIST SP 811, 2008)
# Of the largest value, between two measures of the same test: a nominal strain declared as a true one is refused
# (tests/materials/test_mapping.py).
AGREES = 0.02
DISAGREEING_ROWS = 0.1  # of the rows: more is another column or unit, not an odd row
# Of the rows, and of the range: random order turns at two thirds of the rows (Bienayme 1874), by a third of the range. 12
# rows at random are named, coarse cycles are none (tests/materials/test_curve_defects.py).
TURNS, FAR_STEPS = 0.45, 0.1


def check_range(path, entry, table, test: MaterialTest) -> None:
    low, high = SHEAR if entry.kind == "simple_shear" else STRETCH
    for name, values in (("stretch", test.stretch), ("lateral stretch", test.stretch_2)):
        if values is None:
            continue
        outside = ~((values >= low) & (values <= high))
        if outside.any():
            i = int(np.argmax(outside))
            raise TableError(
                f"{path}, row {table.index[i]}: {entry.strain.column} gives a {name} of {values[i]:.4g}; between {low:g}"
                f" and {high:g} is expected; check the column, `measure` ({entry.strain.measure}) and `unit`"
            )
    reached = float(np.max(np.abs(test.stretch - test.at_rest)))
    if reached < LEAST_STRAIN:
        raise TableError(
            f"{path}: {entry.strain.column} reaches a strain of {reached:.3g}; {LEAST_STRAIN:g} at least is needed to"
            " find a constitutive model; check `unit` and `measure`, or test further"
        )


def checked_segments(path, entry, table, test, at_rest) -> tuple[Segment, ...]:
    if entry.history != "relaxation" and in_no_order(test.stretch):
        raise TableError(f"{path}: {test.sample}: {_unordered(entry, test)}")
    if entry.history != "monotonic":
        segments = find_segments(test.stretch, test.time_s, at_rest)
        if entry.history == "cyclic" and all(segment.kind != "load" for segment in segments):
            raise TableError(
                f"{path}: {test.sample}: the stretch never grows away from {at_rest:g}: no loading is found in"
                f" {len(test.stretch)} rows; check {entry.strain.column} and the order of the rows"
            )
        return segments
    if np.ptp(test.stretch) < LEAST_STRAIN / 2:
        raise TableError(
            f"{path}: {test.sample}: the stretch stays at {test.stretch[0]:.4g}; a monotonic test is declared, set"
            " `history: relaxation`"
        )
    back = first_reversal(test.stretch)
    if back is not None:
        order = ""
        if test.time_s is None:
            order = "; where the points are in no order, sort them with `corrections: {unsorted: sort}`"
        raise TableError(
            f"{path}, row {table.index[back]}: {test.sample}: stretch {test.stretch[back]:.5g} after"
            f" {test.stretch[:back][np.argmax(np.abs(test.stretch[:back] - test.stretch[0]))]:.5g};"
            f" a monotonic test is declared; set `history: cyclic`, or split the cycle{order}"
        )
    return (Segment("load", 0, len(test.stretch), 1),)


def in_no_order(stretch: np.ndarray) -> bool:
    """Return whether the stretch (n,) turns at nearly every other row, and far: points in any order, no cycles."""
    steps = np.diff(stretch)
    steps = steps[steps != 0]
    if len(steps) < 4:
        return False
    turns = float(np.mean(np.sign(steps[1:]) != np.sign(steps[:-1])))
    return turns > TURNS and float(np.median(np.abs(steps))) > FAR_STEPS * np.ptp(stretch)


def _unordered(entry, test: MaterialTest) -> str:
    turns = int((np.diff(np.sign(np.diff(test.stretch))) != 0).sum())
    remedy = "sort them by it, or set `corrections: {unsorted: sort}`"
    if test.time_s is not None:
        remedy = (
            f"check that {entry.time.column} and {entry.strain.column} belong together, or leave `time` out and set"
            " `corrections: {unsorted: sort}`"
        )
    return (
        f"the rows are in no order of the stretch, {entry.strain.column} turns at {turns} of {len(test.stretch)} rows;"
        f" {remedy}"
    )


def check_stiffness(path, entry, test: MaterialTest) -> list[str]:
    """Refuse a stress of the wrong sign or of a size that no material of the declared kind has.

    Return a sentence where the declared range is too wide to show a unit that is off by a thousand.
    """
    strained = np.abs(test.stretch - test.at_rest) > LEAST_STRAIN / 2
    if test.cauchy_difference is not None:
        if test.stretch_2 is None:
            raise TableError(
                f"{path}: a difference of Cauchy stresses needs the lateral stretch; give `lateral`"
            )
        stress, shape = test.cauchy_difference, test.stretch**2 - test.stretch_2**2
    else:
        stress, shape = test.nominal_stress, neo_hookean_shape(test.test, test.stretch, test.stretch_2)
    loaded = np.zeros(len(stress), dtype=bool)
    for segment in test.segments:
        loaded[segment.rows] |= segment.kind != "unload"
    chosen = strained & loaded & (np.abs(shape) > LEAST_STRAIN)
    if not chosen.any():
        raise TableError(f"{path}: {test.sample}: no strained row in its loading; check the columns")
    modulus = stress[chosen] / shape[chosen]
    agreeing = float((modulus > 0).mean())
    if agreeing < SAME_SIGN:
        raise TableError(
            f"{path}: {test.sample}: {entry.stress.column} has the sign of the strain in {agreeing:.0%} of the loaded"
            f" rows; {SAME_SIGN:.0%} at least are expected: check the columns, or set `sign: -1`"
        )
    typical = float(np.median(modulus)) * 1e3
    low, high = entry.plausible_shear_modulus_kPa
    if not low <= typical <= high:
        raise TableError(
            f"{path}: {test.sample}: all rows together give a shear modulus of {typical:.3g} kPa; {low:g} to {high:g}"
            " kPa is declared plausible: check the units and columns of strain and stress"
        )
    return unnoticed_unit(typical, (low, high), "a shear modulus", "kPa", "plausible_shear_modulus_kPa")


def unnoticed_unit(
    value: float, plausible: tuple[float, float], what: str, unit: str, key: str = ""
) -> list[str]:
    """Return a sentence where a value and its thousandfold or thousandth are both in the plausible range."""
    low, high = plausible
    others = [v for v in (value / WRONG_UNIT, value * WRONG_UNIT) if low <= v <= high]
    if not others:
        return []
    remedy = f"; narrow `{key}`" if key else "; compare it with the maker's data"
    return [
        f"units are not checked: {what} of {value:.3g} {unit} is plausible, and so is {others[0]:.3g} {unit}, as a unit"
        f" wrong by a thousand would give{remedy}"
    ]


def check_also(path, entry, table, test: MaterialTest) -> list[str]:
    """Return sentences about rows in which another declared measure of the test disagrees; refuse many."""
    said = []
    for column in entry.also:
        if isinstance(column, Strain):
            mine, (other, _) = test.stretch, stretch_of(path, entry, table, column)
        else:
            mine = test.nominal_stress
            other, _ = nominal_stress_of(path, entry, table, column, test.stretch, test.stretch_2)
        wrong = ~(np.abs(other - mine) <= AGREES * np.max(np.abs(mine)))
        share = float(wrong.mean())
        if not wrong.any():
            wrong = np.sign(other) * np.sign(mine) < 0
        if not wrong.any():
            continue
        i = int(np.argmax(wrong))
        text = (
            f"{column.column} gives {other[i]:.4g} where {mine[i]:.4g} is read from the main column"
            f" (row {table.index[i]} and {int(wrong.sum()) - 1} more)"
        )
        if share > DISAGREEING_ROWS:
            raise TableError(
                f"{path}: {text}; both must describe the same test: check columns, units and measures"
            )
        said.append(text)
    return said


def check_declared_rate(path, entry, rate) -> None:
    if entry.rate_per_s is None or rate is None:
        return
    factor = rate[0] / entry.rate_per_s
    if not 1 / DECLARED_RATE <= factor <= DECLARED_RATE:
        raise TableError(
            f"{path}: the columns give a rate of {rate[0]:.4g} 1/s, the mapping declares {entry.rate_per_s:g} 1/s;"
            f" within a factor of {DECLARED_RATE:g} is expected: check the unit of {entry.time.column}"
        )
