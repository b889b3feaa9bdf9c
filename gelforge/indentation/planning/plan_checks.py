"""What cannot be meant in a plan: two sites at one place, and lengths in metres or inches."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.indentation.paths.places import pairs_within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.sizes import UNITS

# Of a grid: that of Sferrazza et al. 2019 has 1681; a spacing in metres has a million times as many.
MOST_CELLS = 200_000
# 100 times those of the article's mesh; their factors alone would need a terabyte (memory by unknowns:
# benchmarks/cell_cost.py)
MOST_ELEMENTS = 5e6
# Of one indentation: at a second each (seconds of a site: benchmarks/cell_cost.py) they take three hours, and 100 resolve
# any history.
MOST_STEPS = 1e4


def check_places(cells: Mapping[str, PlannedCell], within_mm: float) -> None:
    """Refuse sites that stand at one place, as a recorded indentation joins the plan by its position.

    Paths may share a place where they differ: a shear to the left and one to the right.
    """
    names = list(cells)
    places = np.array([(cells[name].x_mm, cells[name].y_mm) for name in names]).reshape(-1, 2)
    for i, j in sorted(map(tuple, pairs_within(places, within_mm))):
        one, two = cells[names[i]], cells[names[j]]
        if not (one.follows_a_path or two.follows_a_path):
            raise ConfigError(
                f"sites {one.name} and {two.name} are both at ({one.x_mm:g}, {one.y_mm:g}) mm, within {within_mm:g} mm:"
                " give one site the depths of both"
            )
        if _way(one) == _way(two):
            raise ConfigError(
                f"sites {one.name} and {two.name} follow the same path from ({one.x_mm:g}, {one.y_mm:g}) mm; remove one"
            )


def _way(cell: PlannedCell) -> tuple:
    return cell.depths_mm, cell.phases, cell.shears_mm, cell.tilts_deg, cell.twists_deg


def check_unit(cells: Mapping[str, PlannedCell], study: Study) -> None:
    """Ask about a plan all of whose positions or depths would also fit the sensor in metres, or all of them in inches.

    `plan.mm_per_unit` mends a file in another unit, or confirms millimetres.
    """
    if study.plan.mm_per_unit is not None or not cells:
        return
    sensor = study.sensor
    places = np.array([(cell.x_mm, cell.y_mm) for cell in cells.values()])
    largest = np.abs(places).max(axis=0)
    deepest = max(cell.deepest_mm for cell in cells.values())
    sizes = (sensor.width_x_mm, sensor.width_y_mm, sensor.height_mm)
    measured = (*largest, deepest)
    of_file = study.plan.file is not None
    for unit in ("metres", "inches"):
        factor = UNITS[unit]
        fits = [0 < factor * length <= size for length, size in zip(measured, sizes)]
        if not (any(fits) if unit == "metres" else all(fits) and of_file and len(cells) > 1):
            continue
        where = f"{study.plan.file}: " if of_file else ""
        mends = f"`plan.mm_per_unit: {factor:g}` reads {unit}" if of_file else "correct the numbers"
        raise ConfigError(
            f"{where}the plan reaches x {largest[0]:.3g}, y {largest[1]:.3g}, depth {deepest:.3g} mm on a sensor of"
            f" {sizes[0]:g} x {sizes[1]:g} x {sizes[2]:g} mm; are these {unit}? {mends},"
            " `plan.mm_per_unit: 1` confirms millimetres"
        )


def check_mesh(study: Study) -> None:
    """Refuse element sizes that would give a mesh beyond any memory: a length or a size in another unit."""
    sensor, mesh = study.sensor, study.mechanics.mesh.used
    rim = 2 * sensor.flange.width_mm if sensor.flange else 0.0
    far, radius, height = max(mesh.far_mm, mesh.near_mm), mesh.near_radius_mm, sensor.height_mm
    sides = (sensor.width_x_mm + rim, sensor.width_y_mm + rim, height)
    coarse = float(np.prod([max(side / far, 1.0) for side in sides]))
    area = min(np.pi * radius**2, sensor.width_x_mm * sensor.width_y_mm)
    fine = area * min(height, radius) / mesh.near_mm**3
    if coarse + fine > MOST_ELEMENTS:
        key = "near_mm" if fine > coarse else "far_mm"
        raise ConfigError(
            f"mechanics.mesh: {key} {getattr(mesh, key):g} mm gives some {coarse + fine:.2g} elements in a body of"
            f" {sides[0]:g} x {sides[1]:g} x {sides[2]:g} mm, at most {MOST_ELEMENTS:.0e} are meshed; make it larger, or"
            " correct the sensor's lengths"
        )


def check_steps(cells: Mapping[str, PlannedCell], study: Study) -> None:
    """Refuse steps of an indentation with history that nobody could solve one after the other."""
    step = study.mechanics.effects.history.timing.step_mm
    deepest = max((cell.deepest_mm for cell in cells.values()), default=0.0)
    if deepest > MOST_STEPS * step:
        raise ConfigError(
            f"mechanics.effects.history.timing.step_mm {step:g} mm: {deepest / step:.2g} steps to {deepest:g} mm, at most"
            f" {MOST_STEPS:g} are solved; make it larger"
        )


def check_count(count: int) -> None:
    """Refuse a grid of more sites than anyone would press."""
    if count > MOST_CELLS:
        raise ConfigError(
            f"plan.grid.spacing_mm gives {count} sites; at most {MOST_CELLS} are planned, make it larger (it is in mm)"
        )
