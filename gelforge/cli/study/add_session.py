"""What a new session needs in its study: its name in `sessions`, its positions in the plan (`gelforge import --study`)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gelforge.config import ConfigError, Study, load_study, study_from
from gelforge.config.basis.yaml_text import NoYaml, parsed
from gelforge.csv_table import TableError
from gelforge.files import write_text
from gelforge.indentation.paths.places import DEPTH_MATCH_MM, gaps_to, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.planning.recorded_plan import RecordedPlace, cells_from_presses, places_of
from gelforge.indentation.planning.tolerance import place_tolerance_mm
from gelforge.recording.readings import read_recording
from gelforge.recording.tables.checks import RecordingError

FLOW_LIST = re.compile(r"^sessions:[ \t]*\[(?P<names>[^\]\n]*)\]", re.MULTILINE)
BLOCK_LIST = re.compile(r"^sessions:[ \t]*(?:#[^\n]*)?\n(?P<rows>(?:[ \t]*-[ \t]+[^\n]*\n)+)", re.MULTILINE)
KEYS = ("cell", "x_mm", "y_mm", "depth_mm")  # of a row that is added to a plan file


def check_place(study: Study, path: Path, out: Path) -> None:
    """Raise ConfigError unless the study reads a session from the folder `out`."""
    wanted = study.session_folder(out.resolve().name)
    if wanted.resolve() != out.resolve():
        raise ConfigError(f"--out {out}: {path} reads its sessions from {wanted.parent}; use --out {wanted}")
    if study.virtual_lab:
        raise ConfigError(
            f"{path}: its sessions are made by {study.virtual_lab}; remove virtual_lab to read recorded ones"
        )


def add_session(path: Path, name: str) -> list[str]:
    """Add a session to a study's YAML file, and its positions to the plan file; return what was done, a line each.

    Comments of both files stay. What cannot be changed so, as the positions of a grid, is said with the line to write.
    """
    study = load_study(path)
    said = [] if name in study.sessions else [_name_session(path, study, name)]
    if study.plan.file:
        said.append(_extend_plan(study, study.plan.file, name))
    return [line for line in said if line]


def unjoined(path: Path, out: Path) -> list[str]:
    """Return why a study cannot use a session's indentations, and what to write in it; nothing where it can."""
    study = load_study(path)
    try:
        read_recording(out, plan_cells(study), study.sensor)
    except (ConfigError, RecordingError, TableError) as error:
        of_a_grid = [
            f"study      {path}: to plan what was pressed, replace the plan's grid by  from: sessions"
        ]
        return [f"not joined {error}", *(of_a_grid if study.plan.grid else [])]
    return []


def _name_session(path: Path, study: Study, name: str) -> str:
    """Add a session's name to the list `sessions` where the file still says the same otherwise; else say what to write."""
    wanted = [*study.sessions, name]
    text = path.read_text(encoding="utf-8")
    changed = with_session(text, wanted)
    if changed is not None:
        before = study.model_copy(update={"sessions": wanted})
        if _read_from(changed, path) == before:
            write_text(path, changed)
            return f"study      {path}: {name} added to sessions"
    return f"study      {path}: add {name} to its sessions, the line is  sessions: [{', '.join(wanted)}]"


def with_session(text: str, wanted: list[str]) -> str | None:
    """Return the text of a study with the last wanted session added to its list; None where there is no such list."""
    last = wanted[-1]
    if match := FLOW_LIST.search(text):
        names = match["names"].strip()
        return (
            text[: match.start("names")]
            + (f"{names}, {last}" if names else last)
            + text[match.end("names") :]
        )
    if match := BLOCK_LIST.search(text):
        row = match["rows"].splitlines()[-1]
        dash = row[: row.index("-")]
        return text[: match.end("rows")] + f"{dash}- {last}\n" + text[match.end("rows") :]
    if re.search(r"^sessions:", text, re.MULTILINE) or len(wanted) > 1:
        return None
    return text.rstrip("\n") + f"\n\nsessions: [{last}]\n"


def _read_from(text: str, path: Path) -> Study | None:
    """Return the study that a text describes, None where it is none; `path` names it."""
    try:
        return study_from(parsed(text), str(path))
    except (ConfigError, NoYaml):
        return None


# ------------------------------------------------------------------------------------------------ the plan
def _extend_plan(study: Study, plan: Path, name: str) -> str:
    """Append to a plan file the positions and depths of a session that it lacks; return what was done."""
    tolerance = place_tolerance_mm(study.model_copy(update={"sessions": sorted({*study.sessions, name})}))
    pressed = places_of(study.session_folder(name), (study.sensor.width_x_mm, study.sensor.width_y_mm))
    planned = plan_cells(study) if plan.exists() else {}
    paths = [cell.name for cell in planned.values() if cell.follows_a_path]
    if paths:
        return f"plan       {plan}: site {paths[0]} follows a path; add what {name} pressed by hand"
    new = missing_rows(pressed, planned, tolerance, name)
    if not new:
        return f"plan       {plan}: has every position and depth of {name}"
    text = plan.read_text(encoding="utf-8-sig") if plan.exists() else ",".join(KEYS) + "\n"
    unit = study.plan.mm_per_unit or 1.0
    lines = [_line(text, site, *(round(length / unit, 9) for length in lengths)) for site, *lengths in new]
    write_text(plan, text.rstrip("\n") + "\n" + "\n".join(lines) + "\n")
    added = {site for site, *_ in new}
    return (
        f"plan       {plan}: {len(new)} depths at {len(added)} sites added, {len(added - set(planned))} of these sites new"
        f" (positions within {tolerance:g} mm are one site)"
    )


def missing_rows(
    pressed: Sequence[RecordedPlace], planned: dict[str, PlannedCell], tolerance_mm: float, session: str
) -> list[tuple[str, float, float, float]]:
    """Return site, x, y and depth [mm] of what was pressed and is not planned.

    A new site that the recording does not name bears the session's name and a number.
    """
    rows, elsewhere = [], []
    known = {name: list(cell.depths_mm) for name, cell in planned.items()}
    places = np.array([(cell.x_mm, cell.y_mm) for cell in planned.values()]).reshape(-1, 2)
    for one in pressed:
        gaps = gaps_to(places, (one.x_mm, one.y_mm))
        if not len(gaps) or not within(gaps.min(), tolerance_mm):
            elsewhere.append(one)
            continue
        site = list(planned.values())[int(gaps.argmin())]
        if not within(np.abs(np.array(known[site.name]) - one.depth_mm).min(), DEPTH_MATCH_MM):
            known[site.name].append(one.depth_mm)
            rows.append((site.name, site.x_mm, site.y_mm, one.depth_mm))
    for cell in cells_from_presses(elsewhere, tolerance_mm, f"{session}_").values():
        rows += [(cell.name, cell.x_mm, cell.y_mm, depth) for depth in cell.depths_mm]
    return rows


def _line(text: str, *values: object) -> str:
    """Return a row of a table (its text) with these values under KEYS, and nothing under the other names of its header."""
    header = next(line for line in text.splitlines() if line.strip() and line.strip()[0] not in "#%")
    separator = ";" if ";" in header else ","
    decimal = "," if separator == ";" and re.search(r"\d,\d", text) else "."
    named = {
        key: value if isinstance(value, str) else str(value).replace(".", decimal)
        for key, value in zip(KEYS, values)
    }
    return separator.join(named.get(name.strip().strip('"'), "") for name in header.split(separator))
