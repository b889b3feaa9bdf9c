"""The files of small tests in a folder: friction, sheet thickness, indentations of a ball."""

from __future__ import annotations

import os
from itertools import chain
from pathlib import Path

from gelforge.config import ConfigError
from gelforge.config.foreign.mapping import load_microindentation
from gelforge.materials.readers.mapped_files import read_microindentation
from gelforge.materials.small_tests.small_effects import Press, SmallTests
from gelforge.materials.small_tests.trials import FRICTION, THICKNESS, sheet_thickness, static_friction


def small_test_files(folder: str | Path) -> list[Path]:
    """Return the small tests of a folder: friction.csv, thickness.csv, and the files of indentations."""
    folder = Path(folder)
    # what is there and no file, a pipe or a dangling link, is refused where it is read
    named = [folder / name for name in (FRICTION, THICKNESS) if os.path.lexists(folder / name)]
    tables = (sidecar.with_suffix(".csv") for sidecar in sorted(folder.glob("*.yaml")))
    presses = [press_files(table) for table in tables if os.path.lexists(table)]
    return list(dict.fromkeys([*named, *chain.from_iterable(presses)]))


def press_files(path: Path) -> list[Path]:
    """Return the files of an indentation <name>.csv: itself, <name>.yaml, and the test on a rigid board named there."""
    sidecar = path.with_suffix(".yaml")
    try:
        board = load_microindentation(sidecar).rigid_board
    except ConfigError:
        board = None  # reading the indentation says what is wrong with its sidecar
    return [path, sidecar, *([path.with_name(board)] if board else [])]


def read_small_tests(folder: str | Path) -> SmallTests:
    """Return the small tests of a folder; raises TableError or ConfigError with file, value and remedy."""
    files = small_test_files(folder)
    by_name = {path.name: path for path in files}
    presses = [path for path in files if path.with_suffix(".yaml") in files and path.suffix == ".csv"]
    return SmallTests(
        static_friction(by_name[FRICTION]) if FRICTION in by_name else None,
        sheet_thickness(by_name[THICKNESS]) if THICKNESS in by_name else {},
        tuple(map(read_press, presses)),
    )


def read_press(path: str | Path) -> Press:
    """Return an indentation in the project's own format and the test on a rigid board, if its sidecar names one."""
    test, sidecar = read_microindentation(path)
    board = None
    if sidecar.rigid_board is not None:
        board, _ = read_microindentation(Path(path).with_name(sidecar.rigid_board), sidecar)
    return Press(test, sidecar.layer_thickness_mm, board)
