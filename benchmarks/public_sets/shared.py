"""What the commands of this folder share: the option that names a local copy of a public set, and a table."""

from __future__ import annotations

import argparse
from pathlib import Path


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
