"""A plan made of what was pressed: the positions and depths of a study's sessions (plan.from: sessions)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gelforge.config import NAME, ConfigError, Study, load_session
from gelforge.csv_table import read_columns
from gelforge.indentation.paths.places import gaps_to, visited
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.stage_frame import first_outside, stage_to_sensor

# Depths that differ by less than 0.001 mm are one step of a site: a tenth of that within which readings join a step
# (paths/places.py).
DEPTH_DIGITS = 3


@dataclass(frozen=True)
class RecordedPlace:
    """Where one indentation was made [mm], in the sensor's frame; site: as the recording names it, else empty."""

    press: str
    site: str
    x_mm: float
    y_mm: float
    depth_mm: float
    where: str  # file and row, for messages


def cells_from_sessions(study: Study, tolerance_mm: float) -> dict[str, PlannedCell]:
    """Return the sites that a study's sessions press, each with the depths pressed there. Raises ConfigError."""
    if study.virtual_lab:
        raise ConfigError(
            "plan.from: sessions, but virtual_lab makes the sessions from the plan; give a grid or a file"
        )
    if not study.sessions:
        raise ConfigError(
            "plan.from: sessions, but `sessions` names none; add one, or let `gelforge import --study` do so"
        )
    width = study.sensor.width_x_mm, study.sensor.width_y_mm
    recorded = [places_of(study.session_folder(name), width) for name in study.sessions]
    return cells_from_presses([one for places in recorded for one in places], tolerance_mm)


def cells_from_presses(
    presses: Sequence[RecordedPlace], tolerance_mm: float, prefix: str = "p"
) -> dict[str, PlannedCell]:
    """Return a site for each position that is visited, with the depths pressed there.

    A site lies at its first indentation: sessions that are added later do not move it. It takes the recorded name where
    there is one, else prefix and number, p0000, p0001, ..., in the order of first pressing.

    Parameters
    ----------
    presses : sequence of RecordedPlace
        In the order recorded [mm].
    tolerance_mm : float
        Positions within it are one site.
    prefix : str
        Of names that are made.

    Returns
    -------
    dict of str to PlannedCell
        By name, in the order of first pressing.

    Raises
    ------
    ConfigError
        Where one name stands for two positions.
    """
    xy = np.array([(one.x_mm, one.y_mm) for one in presses]).reshape(-1, 2)
    first = visited(xy, tolerance_mm, [one.site for one in presses])
    cells: dict[str, PlannedCell] = {}
    for number, begins in enumerate(np.unique(first).tolist()):
        members = [presses[k] for k in np.flatnonzero(first == begins).tolist()]
        begun = members[0]
        name = next((one.site for one in members if one.site), f"{prefix}{number:04d}")
        if name in cells:
            other = cells[name]
            raise ConfigError(
                f"{begun.where}: site {name!r} lies at ({begun.x_mm:.4f}, {begun.y_mm:.4f}) mm,"
                f" {gaps_to(xy[begins], (other.x_mm, other.y_mm))[0]:.3g} mm from an earlier indentation of that name,"
                f" limit {tolerance_mm:g} mm; correct or empty the column `cell`"
            )
        depths = tuple(sorted({round(one.depth_mm, DEPTH_DIGITS) for one in members}))
        cells[name] = PlannedCell(name, begun.x_mm, begun.y_mm, depths, within_mm=tolerance_mm)
    return cells


def places_of(folder: Path, width_mm: tuple[float, float]) -> tuple[RecordedPlace, ...]:
    """Return where a session's indentations were made, in the order recorded; what else they hold is checked by the reader.

    Parameters
    ----------
    folder : Path
        Of the session.
    width_mm : tuple of float
        Of the sensor along x and y [mm].

    Returns
    -------
    tuple of RecordedPlace
        Positions and depths [mm] in the sensor frame.

    Raises
    ------
    ConfigError
        For a session that is not there, or whose positions cannot be right.
    TableError
        For a table that cannot be read.
    """
    table, described = folder / "indentations.csv", folder / "session.yaml"
    for path in (described, table):
        if not path.is_file():
            raise ConfigError(
                f"{path}: missing; plan.from: sessions takes positions and depths from it: record or import the session, or"
                " remove it from `sessions`"
            )
    return _places_of(folder, width_mm, (table.stat().st_mtime_ns, described.stat().st_mtime_ns))


@lru_cache(maxsize=64)
def _places_of(
    folder: Path, width_mm: tuple[float, float], changed_ns: tuple[int, int]
) -> tuple[RecordedPlace, ...]:
    table = folder / "indentations.csv"
    optional: dict[str, Any] = {"optional_numbers": ["depth_mm"], "optional_texts": ["cell"]}
    rows, columns = read_columns(table, numbers=["x_mm", "y_mm"], texts=["press", "phase"], **optional)
    stage = load_session(folder / "session.yaml").stage_to_sensor
    xy = stage_to_sensor(np.column_stack([columns["x_mm"], columns["y_mm"]]), stage)
    if wrong := first_outside(xy, width_mm):
        raise ConfigError(f"{table}, row {rows[wrong[0]]}: {wrong[1]}")
    depth, phase = np.array(columns["depth_mm"], float), np.array(columns["phase"])
    if (phase == "shear").any():
        k = int((phase == "shear").argmax())
        raise ConfigError(
            f"{table}, row {rows[k]}: indentation {columns['press'][k]} moves sideways; plan.from: sessions takes straight"
            " indentations: write its path into a plan file (plan.file)"
        )
    places: dict[str, RecordedPlace] = {}
    for k in np.flatnonzero(np.isin(phase, ["load", "dwell"])).tolist():
        press, site = columns["press"][k], columns["cell"][k]
        if not (np.isfinite(depth[k]) and depth[k] > 0):
            raise ConfigError(
                f"{table}, row {rows[k]}: depth_mm {depth[k]:g} in phase {phase[k]}; it must be positive"
            )
        if site and not NAME.fullmatch(site):
            raise ConfigError(
                f"{table}, row {rows[k]}: site {site!r} is not a name; use letters, digits, '_' and '-'"
            )
        known = places.get(press)
        x, y = (known.x_mm, known.y_mm) if known else map(float, np.round(xy[k], 6))
        deepest = max(float(depth[k]), known.depth_mm if known else 0.0)
        site = known.site if known else site
        places[press] = RecordedPlace(press, site, x, y, deepest, f"{table}, row {rows[k]}")
    if not places:
        raise ConfigError(f"{table}: no load or dwell row; plan.from: sessions finds no indentation there")
    return tuple(places.values())
