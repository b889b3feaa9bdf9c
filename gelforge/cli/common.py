"""Arguments that several commands share; standard library only."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

CONFIG = Path("config")
STUDY_KEY = re.compile(r"""^study:\s*["']?([A-Za-z0-9_-]+)["']?\s*(?:#.*)?$""", re.MULTILINE)
FRESH = "solve anew what an earlier job that was broken off has solved from the same inputs"


def add_command(commands, name: str, run: str, text: str) -> argparse.ArgumentParser:
    """Add a command that calls `run`, a function of gelforge.cli such as study.check.check, with its arguments."""
    command = commands.add_parser(name, help=text, description=text)
    command.add_argument("--debug", action="store_true", help="show the traceback of an error")
    command.set_defaults(run=run)
    return command


def study_names(*_, **__) -> dict[str, Path]:
    """Return the files of the folder config that describe a study, by the name that their key `study` gives.

    The demo's is config/config.yaml, where Snakemake's catalog looks for it. Also a completer of argcomplete.
    """
    files = (path for path in sorted(CONFIG.glob("*.yaml")) if path.is_file())
    texts = ((path, path.read_bytes().decode("utf-8", "replace")) for path in files)
    return {found[1]: path for path, text in texts if (found := STUDY_KEY.search(text))}


def study_file(text: str) -> Path:
    """Return the YAML file of a study given by its name or its file; a file is opened, and may be refused, later."""
    if text.endswith((".yaml", ".yml")) or "/" in text or Path(text).is_file():
        return Path(text)
    if (own := CONFIG / f"{text}.yaml").is_file():
        return own
    names = study_names()
    if text in names:
        return names[text]
    known = ", ".join(sorted(names)) or "none; run this in the folder that holds config"
    raise argparse.ArgumentTypeError(
        f"no study {text!r}; the studies in {CONFIG} are {known}; or name a YAML file"
    )


def add_study(command, *options: str, text: str = "the study", **settings) -> None:
    """Add the argument that names a study, the same in every command."""
    argument = command.add_argument(
        *(options or ("--study",)),
        type=study_file,
        metavar="STUDY",
        help=f"{text}: a name, such as demo, or a YAML file",
        **settings,
    )
    argument.completer = study_names


def add_laws(command, **settings) -> None:
    """Add the argument that names the files of constitutive models."""
    command.add_argument(
        "--laws",
        type=Path,
        metavar="JSON",
        help="constitutive models (law.json) of the materials",
        **settings,
    )


def study_command(commands, name: str, run: str, text: str) -> argparse.ArgumentParser:
    """Add a command that needs a study."""
    command = add_command(commands, name, run, text)
    add_study(command, required=True)
    return command
