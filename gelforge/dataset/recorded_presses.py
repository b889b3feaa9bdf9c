"""The indentations of a recorded session as the finite elements follow them: their places, their order, their times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Study, load_session
from gelforge.csv_table import read_csv
from gelforge.files import digest, source_digest
from gelforge.indentation.paths.places import DEPTH_MATCH_MM, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.sensor.stage_frame import stage_to_sensor
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.recording.tables.checks import RecordingError
from gelforge.recording.tables.join import cells_of_presses, press_table
from gelforge.recording.tables.path_through import path_through

Laws = Mapping[str, PrincipalLaw]  # by material


@dataclass(frozen=True)
class RecordedPress:
    """One press of a session: straight down at a planned position to a planned depth [mm]."""

    name: str
    cell: str
    order: int
    depth_mm: float
    path: Trajectory  # its last pose is the one whose forces are the label


def recorded_presses(
    readings: pd.DataFrame, cells: Mapping[str, PlannedCell], study: Study
) -> list[RecordedPress]:
    """Return the indentations of a session's readings, in the order recorded.

    Where the study's materials relax, an indentation passes its load and dwell readings when they were taken, up to the
    last one at its depth. Otherwise it goes down without time.

    Parameters
    ----------
    readings : pandas.DataFrame
        As `read_presses` returns them.
    cells : mapping of str to PlannedCell
        Sites of the plan.
    study : Study
        Its effects say whether time counts.

    Returns
    -------
    list of RecordedPress
        Site and trajectory of each.

    Raises
    ------
    RecordingError
        For an indentation that moves sideways, on a sensor that softens.
    """
    history = study.mechanics.effects.history
    sideways = readings.loc[readings["phase"] == "shear", "press"]
    if len(sideways):
        raise RecordingError(
            f"indentation {sideways.iloc[0]} moves sideways; on a sensor that softens (mechanics.effects.history.mullins)"
            " indentations"
            " are followed straight down only: remove such indentations from the session, or the effect from the study"
        )
    rows_of = readings.groupby("press").indices
    presses = []
    for press in press_table(readings).sort_values("order", kind="stable").itertuples():
        planned = cells[press.cell]
        depth = min(planned.depths_mm, key=lambda known: abs(known - press.depth_mm))
        place = (planned.x_mm, planned.y_mm)
        path = Trajectory(*place, (depth,), ("load",), approach=study.plan.approach)
        if history.relaxes:
            path = _timed(path, readings.iloc[rows_of[press.press]], history.timing)
        presses.append(RecordedPress(press.press, press.cell, int(press.order), depth, path))
    return presses


def _timed(path: Trajectory, rows: pd.DataFrame, timing) -> Trajectory:
    """Return an indentation through its load and dwell readings, time counted from the first touch.

    The touch is as long before the first of them as the stage needs at timing.speed_mm_per_s; between two readings the stage
    moves evenly, in steps of at most timing.step_mm.
    """
    held = rows[rows["phase"].isin(["load", "dwell"])]
    depths, times = held["depth_mm"].to_numpy(), held["time_s"].to_numpy()
    deepest = within(depths.max() - depths, DEPTH_MATCH_MM)
    last = np.flatnonzero(deepest)[-1] + 1
    depths = np.where(deepest, path.depths_mm[0], depths)[:last]
    times = times[:last] - times[0] + depths[0] / timing.speed_mm_per_s
    way = path_through(depths.tolist(), times.tolist(), timing.step_mm)
    return path.changed(depths_mm=way.depths_mm, phases=way.phases, times_s=way.times_s)


def presses_digest(study: Study, laws: Laws, presses: Sequence[RecordedPress]) -> str:
    """Return the digest of all that decides the labels of a session's indentations.

    Parameters
    ----------
    study : Study
        As it was in the session.
    laws : mapping of str to PrincipalLaw
        By material.
    presses : sequence of RecordedPress
        In their order.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    paths = [[p.name, p.cell, p.path.x_mm, p.path.y_mm, p.path.depths_mm, p.path.times_s] for p in presses]
    sources = source_digest(
        "dataset/presses_in_order.py", "dataset/recorded_presses.py", "recording/tables/path_through.py"
    )
    return digest([inputs_digest(study, laws, PlannedCell("", 0.0, 0.0, ())), paths, sources])


def read_presses(folder: Path, cells: Mapping[str, PlannedCell]) -> pd.DataFrame:
    """Return what `recorded_presses` needs of a session's folder, without forces and images.

    Parameters
    ----------
    folder : Path
        The session's folder.
    cells : mapping of str to PlannedCell
        Sites that the indentations are joined to.

    Returns
    -------
    pandas.DataFrame
        Columns press, phase, order, time_s, x_mm and y_mm (sensor frame), depth_mm and cell.

    Raises
    ------
    RecordingError
        For an indentation that cannot be joined.
    TableError
        For a missing column or value.
    """
    path = folder / "indentations.csv"
    table = read_csv(
        path,
        numbers=["order", "time_s", "x_mm", "y_mm"],
        optional_numbers=["depth_mm"],
        texts=["press", "phase"],
        optional_texts=["cell"],
    )
    stage = load_session(folder / "session.yaml").stage_to_sensor
    table[["x_mm", "y_mm"]] = stage_to_sensor(table[["x_mm", "y_mm"]].to_numpy(), stage)
    return table.assign(cell=cells_of_presses(path, table, cells))


def pressed_cells(folder: Path, cells: Mapping[str, PlannedCell]) -> list[str]:
    """Return the sites that a session needs solved: those pressed, and those that these mirror.

    Parameters
    ----------
    folder : Path
        The session's folder.
    cells : mapping of str to PlannedCell
        Sites of the plan.

    Returns
    -------
    list of str
        Names, in the order of the plan.

    Raises
    ------
    RecordingError
        As `read_presses`.
    """
    pressed = set(read_presses(folder, cells)["cell"].dropna())
    needed = pressed | {cells[name].source for name in pressed}
    return [name for name in cells if name in needed]
