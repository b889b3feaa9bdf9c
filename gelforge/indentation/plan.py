"""The plan of a study: its cells, each one position with all its depths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gelforge.config import NAME, ConfigError, Study
from gelforge.indentation.symmetry import D4, transform_points

if TYPE_CHECKING:  # pandas takes 0.3 s to import: only those who make or read tables pay for it
    import pandas as pd

POSITION_MATCH_MM = 0.01  # recorded presses join the plan within this distance


@dataclass(frozen=True)
class PlannedCell:
    """One position [mm] in the sensor's frame with its increasing depths [mm]."""

    name: str
    x_mm: float
    y_mm: float
    depths_mm: tuple[float, ...]
    source: str | None = None  # the cell that this one mirrors
    symmetry: str | None = None  # the element of D4 that carries the source here


def plan_cells(study: Study) -> dict[str, PlannedCell]:
    """Return the study's cells by name, in the order of the plan, with mirrored cells naming their source."""
    cells = _from_file(study.plan.file) if study.plan.file else _from_grid(study)
    check_inside(cells, study)
    return _with_sources(cells, study) if study.plan.symmetry == "d4" else cells


CORNER_MM = 5.0  # the article's "corner": this far from two edges


def landmarks(cells: dict[str, PlannedCell], study: Study) -> dict[str, PlannedCell]:
    """Return the cells at "centre" and "corner" (5 mm from two edges, that of large x and y first) that exist."""
    wx, wy = study.sensor.width_x_mm, study.sensor.width_y_mm
    corners = [(x, y) for x in (wx - CORNER_MM, CORNER_MM) for y in (wy - CORNER_MM, CORNER_MM)]
    found = {}
    for name, places in (("centre", [(wx / 2, wy / 2)]), ("corner", corners)):
        there = (
            cell
            for x, y in places
            for cell in cells.values()
            if max(abs(cell.x_mm - x), abs(cell.y_mm - y)) <= POSITION_MATCH_MM
        )
        if cell := next(there, None):
            found[name] = cell
    return found


def variant_cells(cells: dict[str, PlannedCell], study: Study, variant: str) -> dict[str, PlannedCell]:
    """Return the cells of a variant, each to be solved itself: a variant need not have the plan's symmetry."""
    names = study.variants[variant].cells or [cell.name for cell in landmarks(cells, study).values()]
    unknown = [name for name in names if name not in cells]
    if unknown:
        raise ConfigError(f"variants.{variant}.cells: {unknown} are not in the plan; name cells of the plan")
    if not names:
        raise ConfigError(
            f"variants.{variant}: the plan has no cell at the centre or {CORNER_MM:g} mm from two edges; name `cells`"
        )
    return {name: replace(cells[name], source=None, symmetry=None) for name in names}


def plan_table(cells: dict[str, PlannedCell]) -> pd.DataFrame:
    """Return the plan as a table, one row per cell and depth."""
    import pandas as pd

    rows = [
        (c.name, c.x_mm, c.y_mm, depth, c.source or "", c.symmetry or "")
        for c in cells.values()
        for depth in c.depths_mm
    ]
    return pd.DataFrame(rows, columns=["cell", "x_mm", "y_mm", "depth_mm", "source", "symmetry"])


def _axis(width: float, spacing: float, margin: float) -> np.ndarray:
    span = width - 2 * margin
    if span < 0:
        raise ConfigError(
            f"plan.grid.margin_mm {margin} exceeds half the sensor's width {width} mm; make it smaller"
        )
    count = int(np.floor(span / spacing + 1e-9)) + 1
    return width / 2 + spacing * (np.arange(count) - (count - 1) / 2)


def _from_grid(study: Study) -> dict[str, PlannedCell]:
    grid, sensor = study.plan.grid, study.sensor
    xs = _axis(sensor.width_x_mm, grid.spacing_mm, grid.margin_mm)
    ys = _axis(sensor.width_y_mm, grid.spacing_mm, grid.margin_mm)
    digits = len(str(max(len(xs), len(ys)) - 1))
    depths = tuple(study.plan.depths_mm)
    cells = {}
    for iy, y in enumerate(ys):
        for ix, x in enumerate(xs):
            name = f"x{ix:0{digits}d}_y{iy:0{digits}d}"
            cells[name] = PlannedCell(name, round(float(x), 6), round(float(y), 6), depths)
    return cells


def _from_file(path: Path) -> dict[str, PlannedCell]:
    from gelforge.csv_table import read_csv  # loads pandas, which a mirrored cell's job does without

    table = read_csv(path, numbers=("x_mm", "y_mm", "depth_mm"), texts=("cell",))
    cells = {}
    for name, rows in table.groupby("cell", sort=False):
        if not NAME.fullmatch(str(name)):
            raise ConfigError(f"{path}: cell {name!r} is not a name; use letters, digits, '_' and '-'")
        numbers = rows[["x_mm", "y_mm", "depth_mm"]].to_numpy(float)
        if not np.isfinite(numbers).all():
            raise ConfigError(
                f"{path}: cell {name} has an empty or non-finite number; fill x_mm, y_mm and depth_mm"
            )
        if np.ptp(numbers[:, :2], axis=0).max() > 1e-9:
            raise ConfigError(f"{path}: cell {name} has several positions; give each position its own cell")
        depths = tuple(sorted(numbers[:, 2]))
        if depths[0] <= 0 or len(set(depths)) < len(depths):
            raise ConfigError(f"{path}: cell {name} has depths {depths}; they must be positive and differ")
        cells[str(name)] = PlannedCell(str(name), float(numbers[0, 0]), float(numbers[0, 1]), depths)
    return cells


def check_inside(cells: dict[str, PlannedCell], study: Study) -> None:
    sensor = study.sensor
    for cell in cells.values():
        if not (0 <= cell.x_mm <= sensor.width_x_mm and 0 <= cell.y_mm <= sensor.width_y_mm):
            raise ConfigError(
                f"cell {cell.name}: position ({cell.x_mm}, {cell.y_mm}) mm lies outside the sensor "
                f"({sensor.width_x_mm} x {sensor.width_y_mm} mm); correct the plan"
            )
        deepest = cell.depths_mm[-1]
        if deepest >= 0.6 * sensor.height_mm or deepest > study.indenter.radius_mm:
            raise ConfigError(
                f"cell {cell.name}: depth {deepest} mm is beyond 0.6 of the soft height {sensor.height_mm} mm "
                f"or the ball's radius {study.indenter.radius_mm} mm; press less deep"
            )


def _with_sources(cells: dict[str, PlannedCell], study: Study) -> dict[str, PlannedCell]:
    sensor = study.sensor
    if sensor.width_x_mm != sensor.width_y_mm or sensor.bins.nx != sensor.bins.ny:
        raise ConfigError(
            f"plan.symmetry: d4 needs a square sensor and square bins; found {sensor.width_x_mm} x {sensor.width_y_mm} mm, "
            f"{sensor.bins.nx} x {sensor.bins.ny} bins; use symmetry: none"
        )
    width = sensor.width_x_mm
    solved: dict[tuple, str] = {}
    related = {}
    for cell in cells.values():
        position = np.array([cell.x_mm, cell.y_mm])
        images = [tuple(np.round(transform_points(s, position, width), 6)) for s in D4]
        source = next(
            (solved[image, cell.depths_mm] for image in images if (image, cell.depths_mm) in solved), None
        )
        if source is None:
            solved[tuple(np.round(position, 6)), cell.depths_mm] = cell.name
            related[cell.name] = cell
            continue
        origin = np.array([cells[source].x_mm, cells[source].y_mm])
        symmetry = next(s for s in D4 if np.abs(transform_points(s, origin, width) - position).max() < 1e-6)
        related[cell.name] = PlannedCell(cell.name, cell.x_mm, cell.y_mm, cell.depths_mm, source, symmetry)
    if len(cells) > 1 and len(solved) == len(cells):
        raise ConfigError(
            "plan.symmetry: d4, but no two positions of the plan are mirror images; use symmetry: none"
        )
    return related
