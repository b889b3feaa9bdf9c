"""Sessions that hold one recording under two names."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

import numpy as np

from gelforge.csv_table import read_columns
from gelforge.files import file_sha256
from gelforge.recording.imaging.images import image_path
from gelforge.recording.tables.checks import RecordingError

# Copies of a recording are found, and like ones are none (tests/recording/test_copies.py):
SAME_SHARE = 0.5  # of the smaller session's readings at depth
NUMBERS = ("time_s", "x_mm", "y_mm")
FORCES = ("fx_N", "fy_N", "fz_N")


def check_copies(folders: Mapping[str, Path]) -> None:
    """Refuse sessions of which two hold the same recording.

    Parameters
    ----------
    folders : mapping of str to Path
        By session; those without indentations.csv are passed over.

    Raises
    ------
    RecordingError
        Names both sessions and how many readings are equal.
    """
    readings = {
        name: _readings(folder) for name, folder in folders.items() if (folder / "indentations.csv").is_file()
    }
    for one, other in combinations(readings, 2):
        both = readings[one].keys() & readings[other].keys()
        least = min(len(readings[one]), len(readings[other]))
        if len(both) < max(SAME_SHARE * least, 1) or not _same_forces(folders[one], folders[other]):
            continue
        images = [(readings[one][row], readings[other][row]) for row in both]
        named = [pair for pair in images if all(pair)][:5]
        if all(_same_image(folders[one], a, folders[other], b) for a, b in named):
            raise RecordingError(
                f"{folders[other]}: sessions {one} and {other} hold the same recording, {len(both)} of {least} readings at"
                " depth are equal: it would count twice; remove one of them from `sessions`"
            )


def _readings(folder: Path) -> dict[bytes, str]:
    """Return the image, "" without one, of each reading at depth, by its time, stage position and force."""
    _, columns = read_columns(
        folder / "indentations.csv",
        numbers=NUMBERS,
        optional_numbers=FORCES,
        texts=["phase"],
        optional_texts=["image"],
    )
    held = np.isin(columns["phase"], ["load", "dwell"])
    numbers = np.nan_to_num(np.array([columns[name] for name in (*NUMBERS, *FORCES)], float).T)[held]
    images = np.array(columns["image"], object)[held]
    return {row.tobytes(): str(image) for row, image in zip(numbers, images)}


def _same_forces(one: Path, other: Path) -> bool:
    """Return whether two sessions have the same force log, or none next to their tables."""
    logs = [folder / "ft.csv" for folder in (one, other)]
    there = [path.is_file() for path in logs]
    return not any(there) or (all(there) and file_sha256(logs[0]) == file_sha256(logs[1]))


def _same_image(one: Path, a: str, other: Path, b: str) -> bool:
    """Return whether two images have the same bytes; one that is missing says nothing."""
    paths = image_path(one, a), image_path(other, b)
    return not all(path.is_file() for path in paths) or file_sha256(paths[0]) == file_sha256(paths[1])
