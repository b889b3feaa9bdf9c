"""What the commands of this folder share: the option that names a local copy of a public set, and a table."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before the libraries start theirs


def parser_of(doc: str | None, repository: str) -> argparse.ArgumentParser:
    """Return a parser with --source, the folder with a copy of a repository."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--source", type=Path, required=True, help=f"folder with a copy of github.com/{repository}"
    )
    return parser


def found(source: Path, name: str) -> Path:
    """Return a file or folder of the copy. Ends the command where it is missing."""
    path = source / name
    if not path.exists():
        raise SystemExit(f"{path}: is missing; --source names the folder with a copy of the repository")
    return path


def show_table(rows: list[list[str]], names: list[str]) -> None:
    """Print rows as a table in Markdown."""
    for row in [names, ["--"] * len(names), *rows]:
        print("| " + " | ".join(row) + " |")
    print()
