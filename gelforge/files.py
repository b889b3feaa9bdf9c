"""Files that are whole or absent, and digests that say what made them."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic(target: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside target; synced and renamed on success, removed on failure.

    The temporary name holds the process id, so that an orphan that finishes late cannot disturb its successor.
    """
    target = Path(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.stem}.{os.getpid()}.tmp{target.suffix}")
    try:
        yield temporary
        with open(temporary, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(target: str | Path, text: str) -> None:
    """Write a UTF-8 text file, whole or not at all."""
    with atomic(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(target: str | Path, content) -> None:
    """Write JSON with sorted keys, whole or not at all: the same content gives the same bytes."""
    write_text(target, json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n")


def file_sha256(path: str | Path) -> str:
    """Return the SHA-256 of a file's bytes, as hexadecimal text."""
    with open(path, "rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def digest(content) -> str:
    """Return the SHA-256 of a JSON-able content, independent of the order of keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def source_digest(*parts: str) -> str:
    """Return the SHA-256 over files of this package: folders or files, e.g. ("mechanics", "learning/data.py").

    Of a folder every file counts, templates, styles and data too, except what Python compiles and hidden files.
    """
    package = Path(__file__).parent
    lines = []
    for part in parts:
        found = sorted((package / part).rglob("*")) if (package / part).is_dir() else [package / part]
        for path in found:
            hidden = any(name.startswith((".", "__pycache__")) for name in path.relative_to(package).parts)
            if hidden or not path.is_file():
                continue
            lines.append(f"{path.relative_to(package).as_posix()} {file_sha256(path)}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def write_table(folder: str | Path, name: str, table) -> None:
    """Write a pandas table as <name>.csv and <name>.md in a folder."""
    write_text(Path(folder) / f"{name}.csv", table.to_csv(index=False))
    write_text(Path(folder) / f"{name}.md", table.to_markdown(index=False, floatfmt=".4g") + "\n")
