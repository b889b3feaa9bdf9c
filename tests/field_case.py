"""Shared field cases, which were written when training was stated in epochs."""

from pathlib import Path


def study_file(case: Path, folder: Path) -> Path:
    """Return a copy of a case's study with `learning.steps` in place of `learning.epochs`."""
    copy = folder / case.name
    copy.write_text(case.read_text(encoding="utf-8").replace("epochs:", "steps:"), encoding="utf-8")
    return copy
