"""The checksum that a product holds of its own bytes: written, and compared before the product is read."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import zipfile
from functools import cache
from pathlib import Path

from gelforge.files.digests import file_sha256
from gelforge.input_files import CONTAINERS, what_it_is

# In place of a digest until it is known. SHA-256 in hexadecimal has 64 (FIPS 180-4, 2015).
DIGITS = b"0" * 64
SEAL = re.compile(rb"sha256:([0-9a-f]{64})")
UNSEALED = b"sha256:" + DIGITS
# Bytes before the content of an HDF5 file, the least that the format allows. 512, 1024, ... bytes (HDF5 File Format
# Specification 3.0, 2019).
USER_BLOCK = 512
TAIL = len(UNSEALED)  # bytes at the end of a zip archive
# errors of the machine, not of the file
NOT_THE_FILE = {
    errno.EMFILE: "too many files are open; raise the limit (ulimit -n) and run again",
    errno.ENFILE: "too many files are open on this machine; wait or close programs, and run again",
    errno.EACCES: "permission denied; give read permission and run again",
    errno.EPERM: "permission denied; give read permission and run again",
    errno.ESTALE: "the network file system has lost its handle; run again, or mount it again",
    errno.EIO: "the device cannot be read; check disk and network, and run again",
    errno.ENOLCK: "the file system has no locks; set HDF5_USE_FILE_LOCKING=FALSE and run again",
    errno.ENOTCONN: "the network file system is away; mount it again and run again",
    errno.ENOENT: "no such file or folder; name one that exists, or make the folder",
    errno.EISDIR: "it is a folder; name a file",
    errno.ENOTDIR: "a file stands in the place of a folder; name a folder",
}


class FileError(ValueError):
    """A file that cannot be read or written: which, why, what to do."""


def errno_of(error: BaseException) -> int:
    """Return the system's number of an error, which HDF5 hides in its text; 0 where there is none.

    Parameters
    ----------
    error : BaseException
        Of the system or of h5py.

    Returns
    -------
    int
        Such as errno.ENOSPC.
    """
    hidden = re.search(r"errno = (\d+)", str(error))
    return getattr(error, "errno", None) or (int(hidden[1]) if hidden else 0)


def seal(path: str | Path) -> None:
    """Write into a file the SHA-256 of its bytes.

    Parameters
    ----------
    path : str or Path
        A whole file with a place for its sum: HDF5, zip archive, JSON or CSV.

    Raises
    ------
    ValueError
        For a file without such a place.
    """
    path = Path(path)
    place = _seal_place(path)
    if place is None and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path, "a") as archive:
            archive.comment = UNSEALED
        place = _seal_place(path)
    if place is None:
        raise ValueError(f"{path}: keeps no place for its checksum")
    with open(path, "r+b") as file:
        file.seek(place)
        file.write(_sum(path, place).encode())


def check_seal(
    path: str | Path, remedy: str, kind: type[ValueError] = FileError, stated: str | None = None
) -> None:
    """Refuse a file that is missing, damaged, edited or cannot be read.

    A file that was found whole is not read again in this process while its size and time of change stay the same.

    Parameters
    ----------
    path : str or Path
        A product of gelforge.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.
    stated : str, optional
        SHA-256 of the whole file where another file holds it; otherwise the file holds its own.

    Raises
    ------
    kind
        Names file and remedy.
    """
    path = Path(path)
    try:
        known = os.stat(path)
        if not os.path.isfile(path):  # a pipe would be waited for
            raise kind(f"{path}: is {what_it_is(path) or 'no regular file'}; name a file in results/<study>")
        _check_seal(str(path), (known.st_ino, known.st_size, known.st_mtime_ns, known.st_ctime_ns), stated)
    except _OfAnotherKind as found:
        raise kind(f"{path}: {found}") from None
    except _Unsound as found:
        raise kind(f"{path}: {found}; {remedy}") from None
    except FileNotFoundError:
        raise kind(f"{path}: no such file; {remedy}") from None
    except OSError as error:
        raise kind(f"{path}: not read, {why_not_read(error)}") from None


def why_not_read(error: OSError) -> str:
    """Return in words why a file was not read, with what to do; nothing speaks against the file itself.

    Parameters
    ----------
    error : OSError
        What was raised while the file was read.

    Returns
    -------
    str
        Reason and remedy.
    """
    known = NOT_THE_FILE.get(errno_of(error))
    return known or f"{error.strerror or str(error).splitlines()[0]}; the file may well be whole, run again"


class _Unsound(Exception):
    pass


class _OfAnotherKind(_Unsound):
    pass


@cache
def _check_seal(path: str, state: tuple[int, ...], stated: str | None) -> None:
    if stated is not None:
        _compare(file_sha256(path), stated)
        return
    place = _seal_place(Path(path))
    if place is None:
        if (what := what_it_is(path)) and what not in CONTAINERS:
            raise _OfAnotherKind(f"is {what}; name a file that gelforge has written, in results/<study>")
        raise _Unsound("holds no checksum: cut short, replaced, or written by a version before checksums")
    with open(path, "rb") as file:
        file.seek(place)
        stated = file.read(64).decode()
    _compare(_sum(Path(path), place), stated)


def _compare(found: str, stated: str) -> None:
    if found != stated:
        raise _Unsound(
            f"damaged or edited: its bytes have the SHA-256 {found[:12]}..., {stated[:12]}... was written"
        )


def _seal_place(path: Path) -> int | None:
    """Return where in a file the digits of its checksum begin: near its beginning, or at its very end."""
    with open(path, "rb") as file:
        head = SEAL.search(file.read(4096))  # it stands at the beginning of a file
        if head:
            return head.start(1)
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - TAIL))
        return size - 64 if SEAL.fullmatch(file.read()) else None


def _sum(path: Path, place: int) -> str:
    """Return the SHA-256 of a file in which the digits at a place count as zeros."""
    total = hashlib.sha256()
    with open(path, "rb") as file:
        left, at_once = place, 1 << 16  # bytes
        while left and (chunk := file.read(min(at_once, left))):
            total.update(chunk)
            left -= len(chunk)
        file.read(len(DIGITS))
        total.update(DIGITS)
        while chunk := file.read(at_once):
            total.update(chunk)
    return total.hexdigest()
