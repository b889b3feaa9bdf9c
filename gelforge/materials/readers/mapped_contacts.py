"""Mapped indentations of an indenter, and pairs of load cells, to the common form."""

from __future__ import annotations

import numpy as np

from gelforge.csv_table import TableError
from gelforge.materials.basis.common_form import ForcePair, IndentationTest
from gelforge.materials.basis.segments import first_reversal
from gelforge.materials.plausibility.findings import few_rows
from gelforge.materials.plausibility.odd_rows import flat_top, single_row
from gelforge.materials.readers.mapped_checks import unnoticed_unit
from gelforge.materials.readers.mapped_columns import values
from gelforge.materials.small_tests.microindentation import layer_factor

# Swapped columns and wrong units of an indentation are refused (tests/materials/test_odd_rows.py):
# of the ball's radius: the way to the contact included; um read as mm are 1000 times more
LARGEST_TRAVEL = 50.0

# Of gels to hard rubber (1 kPa to 15 MPa), a factor of 3 beyond, as the contact is coarse: depths 1000 times too small are
# refused (tests/materials/test_odd_rows.py).
YOUNGS_MODULUS_MPA = 3e-4, 50.0
# of the largest force at half the depth: 0.35 by Hertz, less on a thin layer, 0.5 of a flat punch
HALF_WAY = 0.62


def indentation_test(path, entry, table, sample, time, said, named) -> IndentationTest:
    position, force = values(table, entry.height), values(table, entry.force)
    segment = table[entry.segment].to_numpy() if entry.segment else None
    travel, push = float(np.ptp(position)), float(np.ptp(force))
    if not travel > 0 or not push > 0:
        raise TableError(
            f"{path}: travel {travel:g} mm and force range {push:g} N; both must change in an indentation"
        )
    backward = first_reversal(position) if segment is None else None
    if backward is not None:
        raise TableError(
            f"{path}, row {table.index[backward]}: {entry.height.column} turns back; name the segments with `segment`,"
            " or check the columns"
        )
    if entry.ball_radius_mm and travel > LARGEST_TRAVEL * entry.ball_radius_mm:
        raise TableError(
            f"{path}: {entry.height.column} travels {travel:.4g} mm with a ball of {entry.ball_radius_mm:g} mm radius;"
            f" {LARGEST_TRAVEL:g} radii at most are an indentation: check the units of both"
        )
    _check_press(path, entry, position, force)
    if entry.corrections.odd_rows == "refuse":
        _check_single_rows(path, table.index, position, force, segment)
    stiffness = push / travel * 1e3
    low, high = entry.plausible_stiffness_N_per_m
    if not low <= stiffness <= high:
        raise TableError(
            f"{path}: force range over travel is {stiffness:.3g} N/m; {low:g} to {high:g} N/m is declared plausible:"
            f" check the units of {entry.height.column} and {entry.force.column}"
        )
    odd = unnoticed_unit(stiffness, (low, high), "a force over travel", "N/m", "plausible_stiffness_N_per_m")
    said = [
        *said,
        *odd,
        *few_rows(len(force)),
        "the contact point is not in the file: it must be searched for",
    ]
    if entry.spring_constant_N_per_m:
        bending = force / entry.spring_constant_N_per_m * 1e3
        position = position - bending
        said.append(
            f"corrected: bending F/k up to {np.max(np.abs(bending)) * 1e3:.3g} um taken off the position"
        )
    elif entry.segment:
        said.append("no spring constant is given: the position contains the bending F/k")
    if time is None:
        said.append("no time column: creep and relaxation cannot be found")
    material = entry.material or named.get("material", "")
    layer = entry.layer_thickness_mm, entry.rigid_board
    about = material, entry.ball_radius_mm, tuple(said), path.name, *layer
    return IndentationTest(sample, position, force, time, segment, *about)


def _check_single_rows(path, lines, position, force, segment) -> None:
    names = [""] if segment is None else dict.fromkeys(segment)
    for name in names:
        rows = np.arange(len(force)) if segment is None else np.flatnonzero(segment == name)
        flat = flat_top(position[rows], force[rows] - force[rows[0]])
        if flat is not None:
            raise TableError(
                f"{path}, row {lines[rows[flat]]}: from here on the force stays at {force[rows[flat]]:.4g} N to the last"
                " digit, its largest value, while the indenter goes deeper: the load cell is saturated; leave these rows"
                " out, or confirm it (`odd_rows: keep`)"
            )
        row = single_row(position[rows], force[rows])
        if row is not None:
            raise TableError(
                f"{path}, row {lines[rows[row]]}: a force of {force[rows[row]]:.4g} N, far off the neighbouring rows;"
                " correct or drop the row, or confirm it"
                " (`odd_rows: keep` next to the ball's radius, of a mapping in `corrections`)"
            )


def check_modulus(path, test: IndentationTest, radius_mm: float, thickness_mm: float | None) -> None:
    """Refuse an indentation in the project's own format whose size of force no soft body has; its contact is taken coarsely.

    Raises TableError.
    """
    z, push = test.position_mm, test.force_N - np.median(test.force_N[: max(len(test.force_N) // 10, 3)])
    deepest = z.max() - z[push > 0.02 * push.max()].min()
    shape = np.sqrt(radius_mm) * deepest**1.5 * layer_factor(deepest, radius_mm, thickness_mm)
    E = push.max() / (16 / 9 * float(shape)) if shape > 0 else np.inf
    low, high = YOUNGS_MODULUS_MPA
    if not low <= E <= high:
        raise TableError(
            f"{path}: force and depth give a Young's modulus of some {E:.2g} MPa; {low:g} to {high:g} MPa is expected: check"
            " the units of depth_mm, force_N and ball_radius_mm, or confirm it with `odd_rows: keep` next to the radius"
        )


def _check_press(path, entry, position, force) -> None:
    """Refuse an indentation whose force does not stand out at its deepest end: columns swapped, or a wrong sign."""
    deep = position >= np.quantile(position, 0.98)
    shallow = position <= np.quantile(position, 0.3)
    rise = np.median(force[deep]) - np.median(force[shallow])
    if not rise > 0.2 * np.ptp(force):
        raise TableError(
            f"{path}: the force rises by {rise:.3g} N from the shallow to the deepest rows, {np.ptp(force):.3g} N is its"
            f" range; it should grow with depth: check columns {entry.height.column}, {entry.force.column} and their sign"
        )
    if entry.ball_radius_mm is None:
        return
    push = force - np.median(force[shallow])
    touched = position[push > 0.05 * push.max()].min()
    half = np.abs(position - (touched + position.max()) / 2) <= 0.1 * (position.max() - touched)
    share = float(np.median(push[half]) / push.max()) if half.any() else 0.0
    if share > HALF_WAY:
        raise TableError(
            f"{path}: half-way into the sample the force has reached {share:.0%} of its largest; a ball's force grows"
            f" faster than its depth, {HALF_WAY:.0%} at most are expected: are {entry.height.column} and"
            f" {entry.force.column} swapped?"
        )


def force_pair(path, entry, table, sample, time, said) -> ForcePair:
    one, two = values(table, entry.force), values(table, entry.force_2)
    largest = float(max(np.abs(one).max(), np.abs(two).max()))
    low, high = entry.plausible_force_N
    if not low <= largest <= high:
        raise TableError(
            f"{path}: the largest force is {largest:.3g} N; {low:g} to {high:g} N is declared; check units"
        )
    correlation = np.corrcoef(one, two)[0, 1]
    if correlation < 0.9:
        raise TableError(
            f"{path}: {entry.force.column} and {entry.force_2.column} do not go together (correlation"
            f" {correlation:.2f}); the same force is expected in both: check the columns"
        )
    odd = [*said, *few_rows(len(one))]
    odd += unnoticed_unit(largest, (low, high), "a force", "N", "plausible_force_N")
    repeated = 0 if time is None else int((np.diff(time) == 0).sum())
    if repeated:
        odd.append(f"{repeated} of {len(time)} rows repeat the time stamp of the row before (coarse clock)")
    position = table[entry.segment].to_numpy() if entry.segment else None
    return ForcePair(sample, one, two, time, position, tuple(odd), path.name)
