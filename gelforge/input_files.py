"""Files that a user names: read only where they are regular files, so that a pipe or a device is not waited for."""

from __future__ import annotations

import os
import stat
from pathlib import Path


class NotAFile(ValueError):
    """A path that is no regular file that can be read: path, what it is, what to do."""


def regular_file(path: str | Path) -> Path:
    """Return the path of a file that is there and regular.

    Raises NotAFile for what is missing, folders, pipes and devices: these would be waited for, or never end.
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
    """Return the content of a regular file. Raises NotAFile."""
    try:
        return regular_file(path).read_bytes()
    except OSError as error:
        raise NotAFile(f"{path}: cannot be read ({error.strerror}); check its rights") from None
