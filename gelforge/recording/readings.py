"""A recorded session: its description and its readings, as force on the sensor in the sensor's frame."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import shorten

import numpy as np
import pandas as pd

from gelforge.config import ForceSensor, Sensor, Session, load_session
from gelforge.csv_table import read_csv
from gelforge.files import check_seal, digest, file_sha256, write_product_table
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.tolerance import tolerance_of_stage_mm
from gelforge.indentation.sensor.stage_frame import stage_to_sensor
from gelforge.recording.imaging.images import check_images
from gelforge.recording.plausibility.findings import Finding, Findings
from gelforge.recording.plausibility.indentations import at_commanded_depth
from gelforge.recording.plausibility.repeats import RAW
from gelforge.recording.plausibility.session import SessionData, apply_findings, examine, refuse
from gelforge.recording.plausibility.streams import FORCE, ForceLog, check_ends, gap_findings, read_force_log
from gelforge.recording.tables import checks
from gelforge.recording.tables.checks import RecordingError
from gelforge.recording.tables.join import cells_of_presses, path_steps

AXES = ("x", "y", "z")
COLUMNS = [
    *("session", "press", "cell", "order", "time_s", "phase", "x_mm", "y_mm", "depth_mm"),
    *("speed_mm_per_s", "dwell_s"),
    *RAW,
    *FORCE,
    "image",
    "excluded",  # names of the tests that took the force or the image out of this row
]


@dataclass(frozen=True)
class Recording:
    """A session with its readings, columns as in COLUMNS, in the order taken; images lie in folder/images."""

    session: Session
    readings: pd.DataFrame
    folder: Path
    findings: Findings = field(default_factory=Findings)
    excluded_images: Mapping[str, int] = field(default_factory=dict)  # at depth, by indentation
    cells: Mapping[str, PlannedCell] = field(default_factory=dict)  # the plan that presses were joined to

    def __repr__(self) -> str:
        table, synthetic = self.readings, ", SYNTHETIC" if self.session.synthetic else ""
        images = int((table["image"] != "").sum())
        lines = [
            f"Recording {self.session.session}{synthetic}: {table['press'].nunique()} indentations, {len(table)} readings,"
            f" {images} images; depth to {table['depth_mm'].max():.4g} mm"
        ]
        forces = (f"{name} {table[name].min():.4g} to {table[name].max():.4g} N" for name in FORCE)
        return "\n".join(
            [
                *lines,
                "  " + ", ".join(forces),
                *(f"  ! {shorten(line, 160)}" for line in self.findings.lines()),
            ]
        )


def _no_session(folder: Path) -> str:
    """Return what to do about a path that is no session's folder."""
    if not folder.is_dir():
        what = "a file" if folder.exists() else "no such folder"
        return f"{folder}: {what}; name a session's folder, with session.yaml and indentations.csv in it"
    below = sorted(file.parent.name for file in folder.glob("*/session.yaml"))
    other = f"name one of the sessions in this folder ({', '.join(below[:5])}), or " if below else ""
    return f"{folder / 'session.yaml'}: missing; {other}describe the session (see docs/file-formats.md)"


def read_recording(
    folder: str | Path, cells: Mapping[str, PlannedCell] | None = None, sensor: Sensor | None = None
) -> Recording:
    """Return a checked session: positions in the sensor frame, forces on the sensor, zero subtracted, indentations joined
    to sites.

    Images are checked for presence, size and completeness from their headers. A sample of them is decoded and tested with
    the session as a whole.

    Parameters
    ----------
    folder : str or Path
        The session's folder, with session.yaml and indentations.csv; it has the session's name.
    cells : mapping of str to PlannedCell, optional
        Planned sites, joined by position and depth (`cells_of_presses`). Without them the column `cell` stays as
        recorded.
    sensor : Sensor, optional
        Positions are checked against its outline.

    Returns
    -------
    Recording
        Session, readings (one row per reading, forces in N, positions in mm) and findings.

    Raises
    ------
    RecordingError
        For a session that cannot be true; the message names file, row, value and remedy.
    """
    folder = Path(folder)
    if not (folder / "session.yaml").is_file():
        raise RecordingError(_no_session(folder))
    session = load_session(folder / "session.yaml")
    if session.session != folder.resolve().name:
        raise RecordingError(
            f"{folder / 'session.yaml'}: session {session.session!r} in a folder named "
            f"{folder.resolve().name!r}; "
            "give both the same name"
        )
    path = folder / "indentations.csv"
    table = _read_table(path, folder / "ft.csv")
    checks.check_rows(path, table)
    checks.check_clock(path, table)
    checks.check_repeated_rows(path, table)
    raw, log, gaps = _raw_force(table, folder, session)
    refuse(folder, Findings(session.session, tuple(gaps)))
    read = np.isfinite(raw).all(axis=1) if gaps else np.ones(len(raw), bool)
    checks.check_raw_force(path, table[read], raw[read], session.force)

    readings = table.copy()
    readings["session"] = session.session
    readings[["x_mm", "y_mm"]] = stage_to_sensor(table[["x_mm", "y_mm"]].to_numpy(), session.stage_to_sensor)
    tolerance = tolerance_of_stage_mm(session.stage_to_sensor.repeatability_mm)
    if cells:
        tolerance = next(iter(cells.values())).within_mm
    checks.check_positions(path, readings, sensor, tolerance)
    readings[RAW] = raw
    readings[FORCE] = force_on_sensor(raw, session.force)
    if not session.force.tared:
        readings[FORCE] -= zero_force(path, readings)
    if cells is not None:
        readings["cell"] = cells_of_presses(path, readings, cells)
    check_images(folder, readings["image"], session)
    findings = examine(SessionData(folder, session, readings, cells, log, tolerance), gaps)
    checks.check_force(path, readings, session.force)
    kept = apply_findings(readings, findings, FORCE)
    lost = at_commanded_depth(readings) & (readings["image"] != "") & (kept["image"] == "")
    excluded_images = readings.loc[lost, "press"].value_counts().to_dict()
    kept = kept[COLUMNS].reset_index(drop=True)
    return Recording(session, kept, folder, findings, excluded_images, cells or {})


def force_on_sensor(raw: np.ndarray, force: ForceSensor) -> np.ndarray:
    """Return recorded forces as the force on the sensor, in the sensor frame.

    Parameters
    ----------
    raw : numpy.ndarray
        (N, 3) [N] along the axes of the force sensor.
    force : ForceSensor
        Its axes in the sensor frame, and the body that it measures the force on.

    Returns
    -------
    numpy.ndarray
        (N, 3) [N]; opposite where the force on the indenter is measured.
    """
    sign = -1.0 if force.acts_on == "indenter" else 1.0
    return sign * raw @ np.asarray(force.axes, dtype=float).T


def zero_force(path: Path, readings: pd.DataFrame) -> np.ndarray:
    """Return for each reading the mean force (N, 3) [N] of its indentation's zero rows.

    Raises RecordingError for an indentation without a zero row.
    """
    zero = readings[readings["phase"] == "zero"].groupby("press")[FORCE].mean()
    without = ~readings["press"].isin(zero.index)
    if without.any():
        line = without.idxmax()
        raise RecordingError(
            f"{path}, row {line}: indentation {readings.at[line, 'press']} has no zero row; record the force "
            "before contact, "
            "or set force.tared: true in session.yaml if zero is already subtracted"
        )
    return zero.loc[readings["press"]].to_numpy()


def sample_rows(recording: Recording) -> pd.DataFrame:
    """Return the readings that may become samples, with the column `step`: -1, or the step of the path that is followed.

    Zero rows, load and dwell rows at the commanded depth, and of indentations that follow a path of the plan all rows at its
    steps.
    """
    readings, cells = recording.readings, recording.cells
    step = path_steps(readings, cells)
    follows = readings["cell"].isin([name for name, cell in cells.items() if cell.follows_a_path])
    at_depth = np.where(follows, step >= 0, at_commanded_depth(readings))
    return readings.assign(step=step)[(readings["phase"] == "zero").to_numpy() | at_depth]


def raw_digest(folder: str | Path) -> str:
    """Return the digest of a session's description and tables, without its images.

    Parameters
    ----------
    folder : str or Path
        The session's folder.

    Returns
    -------
    str
        64 hexadecimal digits; tables that are not there do not count.
    """
    files = [Path(folder) / name for name in ("session.yaml", "indentations.csv", "ft.csv")]
    return digest({path.name: file_sha256(path) for path in files if path.is_file()})


def write_readings(path: str | Path, recording: Recording) -> None:
    """Write all readings of a session, raw and corrected, as CSV.

    Parameters
    ----------
    path : str or Path
        The file.
    recording : Recording
        The digest of its folder is written with it.
    """
    write_product_table(path, recording.readings, "%.9g", raw_digest(recording.folder))


def read_readings(path: str | Path) -> pd.DataFrame:
    """Return the readings that `write_readings` wrote, columns as in COLUMNS; names stay text.

    Parameters
    ----------
    path : str or Path
        recordings/<session>.csv.

    Returns
    -------
    pandas.DataFrame
        A row for each reading.

    Raises
    ------
    RecordingError
        For a file that is missing, damaged or edited.
    TableError
        For a column or a value that is missing.
    """
    always = ["order", "time_s", "x_mm", "y_mm"]
    check_seal(path, f"make the readings again (snakemake -R {path})", RecordingError)
    table = read_csv(
        path,
        numbers=always,
        optional_numbers=["depth_mm", "speed_mm_per_s", "dwell_s", *RAW, *FORCE],
        texts=["session", "press", "phase"],
        optional_texts=["cell", "image", "excluded"],
    )
    return table[COLUMNS].astype({"order": int}).reset_index(drop=True)


def _read_table(path: Path, ft: Path) -> pd.DataFrame:
    """Return indentations.csv with every column of the format; forces may be absent where ft.csv holds them."""
    has_log = os.path.lexists(ft)  # a pipe or a dangling link is refused where it is read
    force_needed = () if has_log else FORCE
    force_optional = FORCE if has_log else ()
    return read_csv(
        path,
        numbers=["order", "time_s", "x_mm", "y_mm", *force_needed],
        optional_numbers=["depth_mm", "speed_mm_per_s", "dwell_s", *force_optional],
        texts=["press", "phase"],
        optional_texts=["cell", "image"],
    )


def _raw_force(
    table: pd.DataFrame, folder: Path, session: Session
) -> tuple[np.ndarray, ForceLog | None, list[Finding]]:
    """Return the forces as recorded (N, 3) [N], from ft.csv where it stands next to the table, NaN in its gaps."""
    path = folder / "ft.csv"
    if not os.path.lexists(path):
        return table[FORCE].to_numpy(), None, []
    log = read_force_log(path, session.force.delay_s)
    check_ends(path, table, log)
    raw = log.at(table["time_s"].to_numpy())
    return raw, log, gap_findings(table, raw, log, session)
