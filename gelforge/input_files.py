"""Files that a user names: read only where they are regular files, so that a pipe or a device is not waited for."""

from __future__ import annotations

import os
import stat
from pathlib import Path

# by the first bytes of a file, from an offset on
BEGINNINGS = (
    (0, b"\x89PNG", "an image (PNG)"),
    (0, b"\xff\xd8\xff", "an image (JPEG)"),
    (0, b"II*\0", "an image (TIFF)"),
    (0, b"MM\0*", "an image (TIFF)"),
    (4, b"ftyp", "a video (MP4)"),
    (8, b"AVI ", "a video (AVI)"),
    (0, b"\x1a\x45\xdf\xa3", "a video (Matroska)"),
    (0, b"%PDF", "a PDF document"),
    (0, b"\x93NUMPY", "a NumPy array"),
    (0, b"\x89HDF", "an HDF5 file"),
    (0, b"PK\3\4", "an archive (ZIP, or PyTorch's)"),
)
CONTAINERS = {"an HDF5 file", "an archive (ZIP, or PyTorch's)"}  # of what gelforge writes itself
TEXTS = {".yaml": "a YAML file", ".yml": "a YAML file", ".py": "a Python file", ".md": "a text"}  # by suffix


class NotAFile(ValueError):
    """A path that is no regular file that can be read: path, what it is, what to do."""


def regular_file(path: str | Path) -> Path:
    """Return the path of a file that is there and regular.

    Parameters
    ----------
    path : str or Path
        Any path.

    Returns
    -------
    Path
        The same path.

    Raises
    ------
    NotAFile
        For what is missing, folders, pipes and devices: these would be waited for, or never end.
    """
    path = Path(path)
    try:
        kind = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise NotAFile(f"{path}: no such file; name one that exists") from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        said = getattr(error, "strerror", None) or error
        raise NotAFile(f"{str(path)[:200]!r}: cannot be read ({said}); name a file that can") from None
    if not stat.S_ISREG(kind):
        what = "a folder" if stat.S_ISDIR(kind) else "a pipe or a device"
        raise NotAFile(f"{path}: {what}, no file; name a regular file")
    return path


def read_bytes(path: str | Path) -> bytes:
    """Return the content of a regular file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    bytes
        All of it.

    Raises
    ------
    NotAFile
        For what is no regular file or cannot be read.
    """
    try:
        return regular_file(path).read_bytes()
    except OSError as error:
        raise NotAFile(f"{path}: cannot be read ({error.strerror}); check its permissions") from None


def another_kind(path: str | Path, needed: str) -> str:
    """Return the words of a message where a path plainly leads to something else than is needed.

    Parameters
    ----------
    path : str or Path
        Any path.
    needed : str
        Such as "a YAML file".

    Returns
    -------
    str
        Such as ": is a video (MP4), a YAML file is needed"; "" where the path may be right.
    """
    what = what_it_is(path)
    return f": is {what}, {needed} is needed" if what and what != needed else ""


def what_it_is(path: str | Path) -> str:
    """Return in words what a path leads to, where that is plain.

    Parameters
    ----------
    path : str or Path
        Any path.

    Returns
    -------
    str
        Such as "a folder", "a video (MP4)" or "a YAML file", by the file's first bytes or its suffix; else "".
    """
    path = Path(path)
    if path.is_dir():
        return "a folder"
    try:
        with open(regular_file(path), "rb") as file:
            head = file.read(16)
    except (NotAFile, OSError):
        return ""
    known = (words for at, begins, words in BEGINNINGS if head[at:].startswith(begins))
    return next(known, TEXTS.get(path.suffix.lower(), ""))
