"""Presses and the planned cells that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from gelforge.indentation.plan import POSITION_MATCH_MM, PlannedCell
from gelforge.recording.checks import RecordingError


def press_table(readings: pd.DataFrame) -> pd.DataFrame:
    """Return one row per press: press, order, cell, x_mm, y_mm (sensor frame), depth_mm commanded, row."""
    held = readings[readings["phase"].isin(["load", "dwell"])]
    presses = held.groupby("press", sort=False).agg(
        order=("order", "first"),
        cell=("cell", "first"),
        x_mm=("x_mm", "first"),
        y_mm=("y_mm", "first"),
        depth_mm=("depth_mm", "max"),
    )
    lines = pd.Series(readings.index, index=readings["press"].to_numpy())
    presses["row"] = lines.groupby(level=0).first()
    return presses.reset_index()


def cells_of_presses(path: Path, readings: pd.DataFrame, cells: Mapping[str, PlannedCell]) -> np.ndarray:
    """Return the name of the planned cell (N,) of each reading, by position within 0.01 mm and by depth.

    Raises RecordingError for a press without its cell, or one whose recorded cell is another.
    """
    presses = press_table(readings)
    names = list(cells)
    tree = cKDTree([(cells[name].x_mm, cells[name].y_mm) for name in names])
    distance, nearest = tree.query(presses[["x_mm", "y_mm"]].to_numpy())
    joined = {}
    for press, gap, index in zip(presses.itertuples(), distance, nearest):
        cell = cells[names[index]]
        where = f"{path}, row {press.row}: press {press.press}"
        if gap > POSITION_MATCH_MM:
            raise RecordingError(
                f"{where} at ({press.x_mm:.4f}, {press.y_mm:.4f}) mm has no planned cell within "
                f"{POSITION_MATCH_MM} mm; "
                f"the nearest is {cell.name} at ({cell.x_mm}, {cell.y_mm}) mm: add the position to the "
                "plan or correct "
                "stage_to_sensor"
            )
        if min(abs(depth - press.depth_mm) for depth in cell.depths_mm) > POSITION_MATCH_MM:
            raise RecordingError(
                f"{where}: depth_mm {press.depth_mm:.4f} is not among the depths {list(cell.depths_mm)} of "
                f"cell {cell.name}; "
                "add it to the plan"
            )
        if press.cell not in ("", cell.name):
            raise RecordingError(
                f"{where} names cell {press.cell!r} but lies at cell {cell.name!r}; correct or empty the "
                "column `cell`"
            )
        joined[press.press] = cell.name
    return readings["press"].map(joined).to_numpy(object)


def cells_from_presses(readings: list[pd.DataFrame]) -> dict[str, PlannedCell]:
    """Return a plan derived from recordings: one cell per position (within 0.01 mm) with the depths pressed there.

    A cell takes the recorded name where there is one, else p0000, p0001, ... in the order of first pressing.
    """
    presses = pd.concat([press_table(one) for one in readings], ignore_index=True)
    xy = presses[["x_mm", "y_mm"]].to_numpy()
    first = [min(near) for near in cKDTree(xy).query_ball_point(xy, POSITION_MATCH_MM)]
    cells: dict[str, PlannedCell] = {}
    for number, (index, group) in enumerate(presses.groupby(first)):
        recorded = [name for name in group["cell"].unique() if name]
        name = recorded[0] if recorded else f"p{number:04d}"
        if len(recorded) > 1 or name in cells:
            raise RecordingError(
                f"position ({xy[index][0]:.4f}, {xy[index][1]:.4f}) mm: recorded cells "
                f"{recorded or [name]} do not name "
                "one position each; correct or empty the column `cell`"
            )
        depths = tuple(float(depth) for depth in np.unique(group["depth_mm"].round(6)))
        cells[name] = PlannedCell(name, float(xy[index][0]), float(xy[index][1]), depths)
    return cells
