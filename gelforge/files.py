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


def source_digest(*folders: str) -> str:
    """Return the SHA-256 over the Python sources of folders of this package, e.g. ("mechanics", "indentation")."""
    package = Path(__file__).parent
    lines = []
    for folder in folders:
        for path in sorted((package / folder).rglob("*.py")):
            lines.append(f"{path.relative_to(package).as_posix()} {file_sha256(path)}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def write_table(folder: str | Path, name: str, table) -> None:
    """Write a pandas table as <name>.csv and <name>.md in a folder."""
    write_text(Path(folder) / f"{name}.csv", table.to_csv(index=False))
    write_text(Path(folder) / f"{name}.md", table.to_markdown(index=False, floatfmt=".4g") + "\n")


def read_csv_table(path: str | Path, numbers, text=(), optional_numbers=(), error=ValueError):
    """Return a pandas table of a CSV file, its index the line number in the file (to name in errors).

    Comma or semicolon, decimal point or (with semicolons) comma, comment lines with # or % before the header,
    UTF-8 with or without byte order mark. Columns named in numbers and optional_numbers become float (empty: NaN),
    all others stay text (empty: ""). Raises error naming file, line, value and remedy for a missing file, a missing
    column or an unreadable number.
    """
    path = Path(path)
    table, separator = _read_words(path, error)
    missing = [name for name in (*numbers, *text) if name not in table.columns]
    if missing:
        raise error(f"{path}: columns {missing} are missing; found {list(table.columns)}")
    for name in table.columns:
        if name in numbers or name in optional_numbers:
            table[name] = _to_numbers(path, table[name], separator, error)
        else:
            table[name] = table[name].fillna("").str.strip()
    return table


def _read_words(path: Path, error):
    """Return a CSV's cells as text, the index the line number in the file, and its separator."""
    import io

    import pandas as pd

    if not path.is_file():
        raise error(f"{path}: no such file; put it there or correct the name")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as problem:
        raise error(f"{path}: not UTF-8 text ({problem}); save it as UTF-8 CSV") from None
    header = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), None)
    rows = [i for i in range(header + 1, len(lines)) if lines[i].strip()] if header is not None else []
    if not rows:
        raise error(f"{path}: empty; a header line and at least one row are expected")
    separator = ";" if ";" in lines[header] else ","
    body = "\n".join(lines[i] for i in (header, *rows))
    try:
        table = pd.read_csv(io.StringIO(body), sep=separator, dtype=str, keep_default_na=False, skipinitialspace=True)
    except pd.errors.ParserError as problem:
        raise error(f"{path}: not a table ({problem}); every row needs the header's columns") from None
    table.columns = table.columns.str.strip()
    # pandas takes surplus cells for an index, and a quote may join lines
    if len(table) != len(rows) or not isinstance(table.index, pd.RangeIndex):
        raise error(f"{path}: rows do not have the header's {len(table.columns)} columns; check separators")
    table.index = pd.Index([i + 1 for i in rows], name="line")
    return table, separator


def _to_numbers(path: Path, words, separator: str, error):
    """Return a column of text as floats, NaN where it is empty; the decimal comma goes with the semicolon."""
    import pandas as pd

    words = words.fillna("").str.strip()
    plain = words.str.replace(",", ".") if separator == ";" else words
    values = pd.to_numeric(plain.where(plain != "", "nan"), errors="coerce")
    wrong = values.isna() & ~plain.str.lower().isin(["", "nan"])
    if wrong.any():
        line = wrong.idxmax()
        raise error(f"{path}, line {line}: {words.name} {words[line]!r} is not a number; correct it")
    return values.astype(float)
