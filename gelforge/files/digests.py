"""Digests of files, of contents and of the source that made a file."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from gelforge.input_files import regular_file


def file_sha256(path: str | Path) -> str:
    """Return the SHA-256 of a file's bytes.

    Parameters
    ----------
    path : str or Path
        A regular file.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    NotAFile
        For what is missing, a folder, a pipe or a device.
    """
    with open(regular_file(path), "rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def digest(content) -> str:
    """Return the SHA-256 of a content, independent of the order of keys.

    Parameters
    ----------
    content : object
        Anything that JSON can hold; no NaN and no infinity.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    ValueError
        For NaN or infinity.

    Examples
    --------
    >>> digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def source_digest(*parts: str) -> str:
    """Return the SHA-256 over files of this package: folders or files, e.g. ("mechanics", "learning/basis/data.py").

    Of a folder every file counts, templates, styles and data too, except what Python compiles and hidden files. Raises
    ValueError for a part that does not exist: a rule that names a file which has moved would not see its changes.
    """
    package = Path(__file__).parents[1]
    lines = []
    for part in parts:
        if not (package / part).exists():
            raise ValueError(f"{part} is no file or folder of gelforge; name it where it is now")
        files = sorted((package / part).rglob("*")) if (package / part).is_dir() else [package / part]
        for path in files:
            hidden = any(name.startswith((".", "__pycache__")) for name in path.relative_to(package).parts)
            if hidden or not path.is_file():
                continue
            lines.append(f"{path.relative_to(package).as_posix()} {file_sha256(path)}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
