"""Seals: the SHA-256 of truth and of verdict are published before the other is opened, and checked before scoring."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

SEALED, REGISTER = "sealed.json", "judged.json"  # of a set: published before judging; written case by case
JUDGED = ("verdict.json", "readings.csv")  # what the seal of a verdict covers


class SealBroken(ValueError):
    """A file that is not what was sealed."""


def text_of(content: Any) -> str:
    """Return the one JSON text of a content."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"))


def digest(*parts: str | bytes) -> str:
    """Return the SHA-256 of some texts or bytes, one after the other, each with its length before it."""
    found = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        found.update(f"{len(data)}:".encode() + data)
    return found.hexdigest()


def salt_of(seed: int, case: str) -> str:
    """Return a salt that the seed repeats, so that a set can be made again: with it equal truths have unequal hashes."""
    return digest("salt", str(seed), case)[:32]


def seal(path: Path, truth: dict, salt: str) -> str:
    """Write a truth with its salt and return the hash that is published."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        json.dumps({"salt": salt, "truth": truth}, indent=1, sort_keys=True) + "\n", encoding="utf-8"
    )
    return digest(salt, text_of(truth))


def opened(path: Path, published: str) -> dict:
    """Return a sealed truth. Raises SealBroken where it is not the one whose hash was published."""
    content = json.loads(path.read_text(encoding="utf-8"))
    found = digest(content["salt"], text_of(content["truth"]))
    if found != published:
        raise SealBroken(
            f"{path}: SHA-256 {found[:12]}... is not the published {published[:12]}...; "
            "the truth was changed after it was sealed: generate the set anew and judge it again"
        )
    return content["truth"]


def digest_of_files(*paths: Path) -> str:
    """Return the SHA-256 of some files' bytes, an absent one as nothing."""
    return digest(*(path.read_bytes() if path.is_file() else b"" for path in paths))


def check_files(published: str, *paths: Path) -> None:
    """Raise SealBroken where files are not those whose hash was published."""
    found = digest_of_files(*paths)
    if found != published:
        raise SealBroken(
            f"{paths[0]}: SHA-256 {found[:12]}... is not {published[:12]}..., written when the case was judged; "
            "the verdict was changed afterwards: judge the case again"
        )


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def write(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
