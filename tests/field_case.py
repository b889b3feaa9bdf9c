"""Shared field cases, which were written with former keys."""

import shutil
from pathlib import Path


def study_file(case: Path, folder: Path) -> Path:
    """Return a copy of a case's study with `learning.steps` in place of `learning.epochs`."""
    copy = folder / case.name
    copy.write_text(case.read_text(encoding="utf-8").replace("epochs:", "steps:"), encoding="utf-8")
    return copy


def session_folder(case: Path, folder: Path) -> Path:
    """Return a copy of a case's session, whose contact points are found at every indentation, with today's keys."""
    copy = Path(shutil.copytree(case, folder / case.name))
    session = copy / "session.yaml"
    keys = session.read_text(encoding="utf-8")
    today = "\n  press_scatter_mm: 0.005\n  session_scatter_mm: 0"
    session.write_text(keys.replace("\n  scatter_mm: 0.005", today), encoding="utf-8")
    return copy
