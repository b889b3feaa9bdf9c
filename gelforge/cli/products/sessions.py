"""A study's sessions: as they are described, as they were recorded, and the labels that are their own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gelforge.config import Study, load_session, session_study


def session_of(study: Study, name: str):
    """Return the description of one of the study's sessions."""
    return load_session(study.session_folder(name) / "session.yaml")


def image_sessions(study: Study) -> list[str]:
    """Return the sessions that have a camera; the others measure force only."""
    return [name for name in study.sessions if session_of(study, name).camera is not None]


def feature_path(study: Study, session: str) -> Path:
    return study.results_folder / "features" / f"{session}.h5"


def recording_of(study: Study, session: str):
    """Return a session of the study, checked and joined to the plan."""
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.recording.readings import read_recording

    return read_recording(study.session_folder(session), plan_cells(study), study.sensor)


def print_findings(recording) -> None:
    """Print what the tests of a session found, a line per test."""
    for level in ("excluded", "note"):
        for line in recording.findings.lines(level):
            print(f"{level:<10} {recording.session.session}: {line}")


def session_presses(study: Study, session: str) -> list:
    """Return the presses of a session in the order recorded, from its readings."""
    from gelforge.dataset.recorded_presses import recorded_presses
    from gelforge.files import check_table_inputs
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.recording.readings import raw_digest, read_readings

    path = study.results_folder / "recordings" / f"{session}.csv"
    remedy = f"make the readings again (snakemake -R {path})"
    check_table_inputs(path, raw_digest(study.session_folder(session)), remedy)
    return recorded_presses(read_readings(path), plan_cells(study), study)


def own_labels(study: Study, cells: dict, laws: dict | None = None) -> dict:
    """Return by session where labels that are its own are; with laws also what their digests must be."""
    from gelforge.dataset.recorded_presses import presses_digest
    from gelforge.dataset.session_labels import OwnCells, OwnPresses
    from gelforge.indentation.solving.inputs import inputs_digest

    labels: dict[str, OwnPresses | OwnCells] = {}
    for name in study.sessions:
        changed = session_study(study, session_of(study, name))
        folder = study.results_folder / "sessions" / name
        if study.mechanics.effects.history.softens:
            digest = presses_digest(changed, laws, session_presses(changed, name)) if laws else None
            labels[name] = OwnPresses(folder / "presses.h5", digest)
        elif changed is not study:
            files = {cell: folder / "cells" / f"{cell}.h5" for cell in cells}
            solved = {cell: replace(planned, between="") for cell, planned in cells.items()}
            digests = {cell: inputs_digest(changed, laws, solved[cell]) for cell in cells} if laws else {}
            labels[name] = OwnCells(files, digests)
    return labels
