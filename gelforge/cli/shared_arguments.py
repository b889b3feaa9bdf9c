"""How a row of the tables of commands is written, and the arguments that several rows share; standard library only."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from gelforge.cli.values import study_file


class Argument(NamedTuple):
    """What argparse adds to a command: its names, and settings as of `add_argument`."""

    names: list[str]
    settings: dict[str, Any]


class OneOf(NamedTuple):
    """Arguments of which one is required."""

    arguments: tuple[Argument, ...]


class Command(NamedTuple):
    """A function of gelforge.cli, such as study.check.check; what it does, in words; its arguments."""

    run: str
    text: str
    arguments: tuple[Argument | OneOf, ...]


def command(run: str, text: str, *arguments: Argument | OneOf) -> Command:
    return Command(run, text, arguments)


def arg(names: str, text: str, kind: Callable | None = None, **settings) -> Argument:
    """Return an argument; names: with spaces between; kind: makes a value of its text."""
    return Argument(names.split(), {"help": text} | ({"type": kind} if kind else {}) | settings)


need = partial(arg, required=True)
flag = partial(arg, action="store_true")


def written(what: str, **settings) -> Argument:
    """Return the argument that names the file or folder to write."""
    return need("--out", f"{what} to write", Path, **settings)


def study(names: str = "--study", text: str = "the study", **settings) -> Argument:
    """Return the argument that names a study, the same in every command."""
    return arg(
        names, f"{text}: a name, such as demo, or a YAML file", study_file, metavar="STUDY", **settings
    )


laws = partial(arg, "--laws", "constitutive models (law.json) of the materials", Path, metavar="JSON")
FOLDER, HDF5 = written("folder"), written("HDF5 file")
