"""Indentations and the planned sites that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from gelforge.indentation.paths.places import DEPTH_MATCH_MM, ROUNDING_MM, gaps_to, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.recording.tables.checks import RecordingError


def press_table(readings: pd.DataFrame) -> pd.DataFrame:
    """Return one row per indentation of a session's readings.

    Parameters
    ----------
    readings : pandas.DataFrame
        Of a Recording: columns press, phase, order, cell, x_mm, y_mm and depth_mm.

    Returns
    -------
    pandas.DataFrame
        Columns press, order, cell, x_mm and y_mm (sensor frame), depth_mm (the largest commanded) and row (line of the
        file).
    """
    held = readings[readings["phase"].isin(["load", "dwell"])]
    first = {name: (name, "first") for name in ("order", "cell", "x_mm", "y_mm")}
    presses = held.groupby("press", sort=False).agg(**first, depth_mm=("depth_mm", "max"))
    lines = pd.Series(readings.index, index=readings["press"].to_numpy())
    presses["row"] = lines.groupby(level=0).first()
    return presses.reset_index()


def cells_of_presses(path: Path, readings: pd.DataFrame, cells: Mapping[str, PlannedCell]) -> np.ndarray:
    """Return the name of the planned site of each reading: the nearest within its `within_mm` that has the depth.

    An indentation that moves sideways joins a path that passes where its last `shear` row stands.

    Parameters
    ----------
    path : Path
        Of the table, for messages.
    readings : pandas.DataFrame
        N readings, positions and depths in mm.
    cells : mapping of str to PlannedCell
        Sites of the plan.

    Returns
    -------
    numpy.ndarray
        (N,) of str.

    Raises
    ------
    RecordingError
        For an indentation without its site, and one whose recorded site is another.
    """
    presses = press_table(readings)
    names = list(cells)
    tree = cKDTree([(cells[name].x_mm, cells[name].y_mm) for name in names])
    places = presses[["x_mm", "y_mm"]].to_numpy()
    distance, nearest = tree.query(places)
    tolerance = max(cell.within_mm for cell in cells.values())
    around = tree.query_ball_point(places, tolerance + ROUNDING_MM)
    ends = readings[readings["phase"] == "shear"].groupby("press").last()
    joined = {}
    for press, gap, index, near in zip(presses.itertuples(), distance, nearest, around):
        where = f"{path}, row {press.row}: indentation {press.press}"
        end = ends.loc[press.press] if press.press in ends.index else None
        here = [cells[names[k]] for k in sorted(near)] or [cells[names[index]]]
        cell = _cell_of(press, end, here, where)
        if not within(gap, tolerance):
            raise RecordingError(
                f"{where} at ({press.x_mm:.4f}, {press.y_mm:.4f}) mm has no planned site within "
                f"{tolerance:g} mm; the nearest is {cell.name} at ({cell.x_mm}, {cell.y_mm}) mm, {gap:.3g} mm away: correct "
                "stage_to_sensor, state its repeatability_mm, or take the plan from the recordings (plan: {from: sessions})"
            )
        if not _has_depth(cell, press.depth_mm):
            raise RecordingError(
                f"{where}: depth_mm {press.depth_mm:.4f} is not among the depths {list(cell.depths_mm)} of "
                f"site {cell.name}, within {DEPTH_MATCH_MM} mm; add it to the plan, or take the plan from the recordings "
                "(plan: {from: sessions})"
            )
        if end is not None and not _passes(cell, end):
            raise RecordingError(
                f"{where} moves sideways to {_offset(cell, end)} mm at depth {end.depth_mm:g} mm, which is no step of site "
                f"{cell.name}, within {tolerance:g} mm; add such a path to the plan (shear_x_mm, shear_y_mm)"
            )
        if press.cell not in ("", cell.name):
            raise RecordingError(
                f"{where} names site {press.cell!r} but lies at site {cell.name!r}; correct or empty the "
                "column `cell`"
            )
        joined[press.press] = cell.name
    return readings["press"].map(joined).to_numpy(object)


def _cell_of(press, end: pd.Series | None, here: list[PlannedCell], where: str) -> PlannedCell:
    """Return the site of those at an indentation's position that it joins: the one it names, else the one that it fits.

    end: its last reading while it moved sideways, None of a straight indentation, which fits any of these sites; a site
    without a path comes first then. Where none fits the first is returned, which is refused afterwards.
    """
    named = [cell for cell in here if cell.name == press.cell]
    if named:
        return named[0]
    if end is None:
        deep = [cell for cell in here if _has_depth(cell, press.depth_mm)]
        place = press.x_mm, press.y_mm
        return min(
            deep or here, key=lambda c: (c.follows_a_path, round(gaps_to((c.x_mm, c.y_mm), place)[0], 6))
        )
    fitting = [cell for cell in here if _passes(cell, end)]
    if len(fitting) > 1:
        raise RecordingError(
            f"{where} fits the paths of sites {[cell.name for cell in fitting]}; name its site in the column `cell`"
        )
    return (fitting or here)[0]


def _has_depth(cell: PlannedCell, depth_mm: float) -> bool:
    """Return whether a site has a depth."""
    return bool(within(np.abs(np.array(cell.depths_mm) - depth_mm).min(), DEPTH_MATCH_MM))


def _offset(cell: PlannedCell, row: pd.Series) -> str:
    """Return where a reading was taken from a site's position, in words."""
    return f"({row.x_mm - cell.x_mm:.4g}, {row.y_mm - cell.y_mm:.4g})"


def _passes(cell: PlannedCell, end: pd.Series) -> bool:
    """Return whether a reading (phase, x_mm, y_mm, depth_mm) was taken at a step of a site's path."""
    return bool((steps_of_path(cell, pd.DataFrame([end])) >= 0).all())


# Phases of a plan at whose steps a reading of a phase may have been taken; a wait has the forces of the step before it.
PLANNED = {
    "load": {"load", "dwell"},
    "dwell": {"load", "dwell"},
    "shear": {"shear", "dwell"},
    "unload": {"unload", "dwell"},
}


def steps_of_path(cell: PlannedCell, rows: pd.DataFrame) -> np.ndarray:
    """Return the step (n,) of a site's path at which each reading of one indentation was taken, -1 where at none.

    rows: phase, x_mm, y_mm (sensor frame), depth_mm in the order taken. A reading belongs to the first step, not before that
    of an earlier reading, whose depth is its own within 0.01 mm and whose position within the site's `within_mm`. Steps that
    turn are no reading's: a recording does not state them.
    """
    count = len(cell.depths_mm)
    shears = np.array(cell.shears_mm or np.zeros((count, 2)))
    pose = np.column_stack([cell.depths_mm, shears + [cell.x_mm, cell.y_mm]])  # (D, 3)
    upright = ~np.array(cell.tilts_deg or np.zeros((count, 2))).any(axis=1)
    upright &= ~np.array(cell.twists_deg or np.zeros(count)).astype(bool)
    phases = np.array(cell.phases or ("load",) * count)
    read = rows[["depth_mm", "x_mm", "y_mm"]].to_numpy()
    steps, first = np.full(len(rows), -1), 0
    for number, phase in enumerate(rows["phase"]):
        same = upright & np.isin(phases, list(PLANNED.get(phase, ())))
        same &= within(np.abs(pose[:, 0] - read[number, 0]), DEPTH_MATCH_MM)
        same &= within(gaps_to(pose[:, 1:], read[number, 1:]), cell.within_mm)
        later = np.flatnonzero(same[first:])
        if len(later):
            first += later[0]
            steps[number] = first
    return steps


def path_steps(readings: pd.DataFrame, cells: Mapping[str, PlannedCell]) -> np.ndarray:
    """Return for each reading (N,) the step of its site's path, see `steps_of_path`; -1 elsewhere."""
    steps = np.full(len(readings), -1)
    paths = {name for name, cell in cells.items() if cell.follows_a_path}
    followed = np.flatnonzero(readings["cell"].isin(paths))
    for _, rows in readings.iloc[followed].groupby("press", sort=False):
        at = readings.index.get_indexer(rows.index)
        steps[at] = steps_of_path(cells[rows["cell"].iloc[0]], rows)
    return steps
