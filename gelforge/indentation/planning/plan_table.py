"""The plan of a study as a table, read from a file or made of sites."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gelforge.config import NAME, ConfigError
from gelforge.csv_table import read_columns
from gelforge.indentation.paths.planned_cell import PlannedCell

if TYPE_CHECKING:  # pandas takes 0.3 s to import: only those who make or read tables pay for it
    import pandas as pd

PHASES = ("load", "shear", "tilt", "twist", "dwell", "unload")
PATH_NUMBERS = ("shear_x_mm", "shear_y_mm", "tilt_x_deg", "tilt_y_deg", "twist_deg")


def plan_table(cells: dict[str, PlannedCell]) -> pd.DataFrame:
    """Return the plan as a table, one row per site and depth.

    Parameters
    ----------
    cells : dict of str to PlannedCell
        Sites of the plan.

    Returns
    -------
    pandas.DataFrame
        Positions and depths [mm]; the columns of a path only where a site follows one.
    """
    import pandas as pd

    rows = [
        (c.name, c.x_mm, c.y_mm, depth, c.source or "", c.symmetry or "")
        for c in cells.values()
        for depth in c.depths_mm
    ]
    table = pd.DataFrame(rows, columns=["cell", "x_mm", "y_mm", "depth_mm", "source", "symmetry"])
    if any(c.between for c in cells.values()):
        table["interpolated"] = [bool(c.between) for c in cells.values() for _ in c.depths_mm]
    if any(c.follows_a_path for c in cells.values()):
        path = [step for c in cells.values() for step in _steps(c)]
        table = table.join(pd.DataFrame(path, columns=["phase", *PATH_NUMBERS]))
    return table


def _steps(cell: PlannedCell) -> list[tuple]:
    """Return phase, shears, tilts and twist of each depth of a site."""
    count = len(cell.depths_mm)
    phases, none = cell.phases or ("load",) * count, ((0.0, 0.0),) * count
    moves = zip(phases, cell.shears_mm or none, cell.tilts_deg or none, cell.twists_deg or (0.0,) * count)
    return [(phase, *shear, *tilt, twist) for phase, shear, tilt, twist in moves]


def cells_from_file(path: Path, mm_per_unit: float) -> dict[str, PlannedCell]:
    """Return the sites of a plan's file; mm_per_unit: of its lengths. Raises ConfigError or TableError."""
    of_place = ("x_mm", "y_mm", "depth_mm")
    optional: dict[str, Any] = {"optional_numbers": PATH_NUMBERS, "optional_texts": ("phase",)}
    _, columns = read_columns(path, numbers=of_place, texts=("cell",), **optional)
    names, phases = columns["cell"], columns["phase"]
    places = np.column_stack([columns[name] for name in of_place])
    moves = np.nan_to_num(np.column_stack([columns[name] for name in PATH_NUMBERS]))
    places, moves[:, :2] = places * mm_per_unit, moves[:, :2] * mm_per_unit  # the others are angles
    rows_of: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        rows_of.setdefault(name, []).append(row)
    cells = {}
    for name, rows in rows_of.items():
        if not NAME.fullmatch(name):
            raise ConfigError(f"{path}: site {name!r} is not a name; use letters, digits, '_' and '-'")
        numbers, turns = places[rows], moves[rows]
        if not np.isfinite(numbers).all():
            raise ConfigError(
                f"{path}: site {name} has an empty or non-finite number; fill x_mm, y_mm and depth_mm"
            )
        if np.ptp(numbers[:, :2], axis=0).max() > 1e-9:
            raise ConfigError(f"{path}: site {name} has several positions; give each position its own site")
        x, y = float(numbers[0, 0]), float(numbers[0, 1])
        phased = [phases[row] for row in rows]
        if turns.any() or any(phased):
            cells[name] = _path(path, name, (x, y), numbers[:, 2], turns, phased)
            continue
        depths = tuple(sorted(numbers[:, 2]))
        if depths[0] <= 0 or len(set(depths)) < len(depths):
            raise ConfigError(
                f"{path}: site {name} has depths {depths}; they must be positive and differ, unless phase or shear_x_mm, "
                "shear_y_mm make its rows a path"
            )
        cells[name] = PlannedCell(name, x, y, depths)
    return cells


def _path(
    file: Path,
    name: str,
    place: tuple[float, float],
    depths: np.ndarray,
    turns: np.ndarray,
    phases: list[str],
) -> PlannedCell:
    """Return a site whose rows are followed in the order of the file; an empty phase is found from what moves."""
    if depths[0] <= 0:
        raise ConfigError(
            f"{file}: site {name}: its path begins at depth {depths[0]:g} mm; begin with a positive depth"
        )
    before = np.vstack([np.zeros(6), np.column_stack([depths, turns])[:-1]])
    moves = np.column_stack([depths, turns]) - before
    for row, move in enumerate(moves):
        phases[row] = phases[row] or _phase(move)
        if phases[row] not in PHASES:
            raise ConfigError(f"{file}: site {name}: phase {phases[row]!r} is not one of {', '.join(PHASES)}")
    shears, tilts = ([(float(a), float(b)) for a, b in turns[:, k : k + 2]] for k in (0, 2))
    return PlannedCell(
        name,
        *place,
        tuple(map(float, depths)),
        phases=tuple(phases),
        shears_mm=tuple(shears) if turns[:, :2].any() else (),
        tilts_deg=tuple(tilts) if turns[:, 2:4].any() else (),
        twists_deg=tuple(map(float, turns[:, 4])) if turns[:, 4].any() else (),
    )


def _phase(move: np.ndarray) -> str:
    """Return what a step (depth, shear x, y, tilt x, y, twist) is called."""
    if move[0]:
        return "load" if move[0] > 0 else "unload"
    return "shear" if move[1:3].any() else "tilt" if move[3:5].any() else "twist" if move[5] else "dwell"
