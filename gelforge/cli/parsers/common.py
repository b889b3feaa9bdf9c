"""What the parsers of all commands share."""

from __future__ import annotations

import argparse
from pathlib import Path

FRESH = "solve anew what an earlier job that was broken off has solved from the same inputs"


def add_command(commands, name: str, run: str, text: str) -> argparse.ArgumentParser:
    """Add a command that calls `run`, a module of gelforge.cli and its function, with its arguments."""
    command = commands.add_parser(name, help=text, description=text)
    command.add_argument("--debug", action="store_true", help="show the traceback of an error")
    command.set_defaults(run=run)
    return command


def study_command(commands, name: str, run: str, text: str) -> argparse.ArgumentParser:
    """Add a command that needs a study."""
    command = add_command(commands, name, run, text)
    command.add_argument(
        "--study", type=Path, required=True, metavar="YAML", help="the study's configuration"
    )
    return command
