"""The commands and their arguments; standard library only."""

from __future__ import annotations

import argparse
import os
import re
from difflib import get_close_matches
from typing import NoReturn

from gelforge.cli.commands import COMMANDS
from gelforge.cli.shared_arguments import Command, OneOf
from gelforge.cli.values import study_file, study_names
from gelforge.cli.workflow_commands import COMMANDS as WORKFLOW_COMMANDS

GROUPS = """\
a study            init, examples, check, show, explain, report, tables, adapt, unlock
by hand            import, press, characterise, verify, mismatch, mismatch-materials
models             model, export, predict, live
cameras            calibrate-camera, camera-pose
what the workflow runs
                   fit-law, plan, simulate, level, derive, sensitivities, simulate-session, readings, features, join,
                   manifest, agreement, train, evaluate, onnx-check
synthetic data     solve-synthesis, synthesise, virtual-materials, virtual-cell, virtual-session
"""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the nearest word for one that it does not know."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and where help is, and exit with status 2."""
        if unknown := re.fullmatch(r"argument (\S+): invalid choice: '(.*)' \(choose from (.*)\)", message):
            what, word, choices = unknown.groups()
            near = get_close_matches(word, re.findall(r"[\w-]+", choices), n=1)
            remedy = f"; did you mean {near[0]}?" if near else ""
            if what == "dataset":  # of `export`
                message = f"{word!r} is not expected; a model is named by --study or --model, a dataset by: export dataset"
            elif what == "COMMAND":
                message = f"no command {word!r}{remedy}"
            elif near:
                message = f"argument {what}: {word!r}{remedy}"
        if len(message) > 300:  # a pattern that the shell has expanded to many files
            message = f"{message[:300]} ..."
        self.exit(2, f"{self.prog}: {message} (help: {self.prog} --help)\n")


def complete(top: argparse.ArgumentParser) -> None:
    """Answer a shell that completes a line, where argcomplete is installed; the shell names itself in the environment."""
    if "_ARGCOMPLETE" in os.environ:
        try:
            import argcomplete
        except ModuleNotFoundError:
            return
        argcomplete.autocomplete(top)


def parser() -> argparse.ArgumentParser:
    """Return the parser of every command."""
    from gelforge import __version__

    top = Parser(
        prog="gelforge",
        description="Force-distribution labels, datasets and models for soft, vision-based tactile sensors.",
        epilog=GROUPS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=__version__)
    places: dict[str, argparse._SubParsersAction] = {"": top.add_subparsers(metavar="COMMAND", required=True)}
    parsers: dict[str, argparse.ArgumentParser] = {}
    for name, command in (COMMANDS | WORKFLOW_COMMANDS).items():
        above, _, last = name.rpartition(" ")
        if above not in places:
            places[above] = parsers[above].add_subparsers(metavar=last)
        parsers[name] = places[above].add_parser(last, help=command.text, description=command.text)
        _fill(parsers[name], command)
    return top


def _fill(parser: argparse.ArgumentParser, command: Command) -> None:
    """Add the arguments of a command to its parser."""
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    parser.set_defaults(run=command.run)
    for row in command.arguments:
        one_of = isinstance(row, OneOf)
        place = parser.add_mutually_exclusive_group(required=True) if one_of else parser
        for names, settings in row.arguments if isinstance(row, OneOf) else [row]:
            added = place.add_argument(*names, **settings)
            if added.type is study_file:
                added.completer = study_names  # type: ignore[attr-defined]
