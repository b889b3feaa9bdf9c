"""Files that are whole or absent: written under a temporary name and renamed."""

from __future__ import annotations

import errno
import os
import re
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from gelforge.files.seals import FileError, errno_of, seal

NO_ROOM = {
    errno.ENOSPC: "no space is left on the device",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file is larger than the limit on file sizes allows (ulimit -f)",
    errno.EROFS: "the file system is read-only",
}


@contextmanager
def atomic(target: str | Path, sealed: bool = False) -> Iterator[Path]:
    """Yield a temporary path next to a target, which is renamed to the target on success and removed on failure.

    The temporary name holds machine, process and its start: an orphan that finishes late cannot disturb its successor, and
    what a killed process left is removed here.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    sealed : bool
        Write the checksum into the file (`seal`) before it is renamed.

    Yields
    ------
    Path
        Write here.

    Raises
    ------
    FileError
        For a full disk, and for a target that is a folder.
    """
    target = Path(target)
    if target.is_dir():
        raise FileError(f"{target}: is a folder, and a file is written; name a file")
    temporary = temporary_beside(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_orphans(target.parent)
        yield temporary
        if sealed:
            seal(temporary)
        with open(temporary, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(temporary, target)
    except (OSError, RuntimeError) as error:  # HDF5 raises both
        if reason := no_room(error):
            raise FileError(
                f"{target}: not written, {reason}; what was there before is as it was: make room and run again"
            ) from None
        raise
    finally:
        temporary.unlink(missing_ok=True)


def no_room(error: BaseException) -> str:
    """Return in words why nothing can be written.

    Parameters
    ----------
    error : BaseException
        What was raised while a file was written.

    Returns
    -------
    str
        Such as "no space is left on the device"; "" where the error means something else.
    """
    return NO_ROOM.get(errno_of(error), "")


def temporary_beside(target: Path) -> Path:
    """Return a temporary path next to a target that no other process uses and that `remove_orphans` knows.

    Parameters
    ----------
    target : Path
        The file.

    Returns
    -------
    Path
        In the same folder, with the target's suffix.
    """
    return target.with_name(f".{target.stem}.{_owner()}.tmp{target.suffix}")


def remove_orphans(folder: Path) -> None:
    """Remove temporary files that processes which have ended left in a folder; once per process and folder.

    Parameters
    ----------
    folder : Path
        Must exist.
    """
    _swept(os.getpid(), folder.absolute())


@cache
def _swept(process: int, folder: Path) -> None:
    for path in folder.glob(".*.tmp*"):
        match = re.search(r"\.([^.]+)-(\d+)-(\d+)\.tmp(\.[^.]*)?$", path.name)
        if not match or _lives(path, match[1], int(match[2]), int(match[3])):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _owner() -> str:
    return f"{_machine()}-{os.getpid()}-{_started(os.getpid())}"


def _machine() -> str:
    return re.sub(r"[^A-Za-z0-9_]", "_", socket.gethostname())


def _started(process: int) -> int:
    """Return when a process started, in clock ticks since the machine did; 0 where that is not known."""
    try:
        text = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return 0
    return int(text.rpartition(")")[2].split()[19])  # field 22; the second one, the name, may hold spaces


def _lives(path: Path, machine: str, process: int, started: int) -> bool:
    """Return whether the owner of a temporary file may still write to it."""
    if machine != _machine():
        try:
            # of another machine: after a day without a change it has lost its owner
            return os.path.getmtime(path) > time.time() - 86400
        except OSError:
            return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return _started(process) == started
