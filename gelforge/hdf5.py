"""HDF5 files that are whole or absent and hold their checksum: how every stage writes and opens them."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from gelforge.files import UNSEALED, USER_BLOCK, FileError, atomic, check_seal, errno_of, why_not_read


@contextmanager
def writing(path: str | Path, **options) -> Iterator[h5py.File]:
    """Yield an HDF5 file that appears under its name only when it is whole.

    The same content written in the same order gives the same bytes.

    Parameters
    ----------
    path : str or Path
        The file; missing folders above it are made.
    **options
        As of h5py.File.

    Yields
    ------
    h5py.File
        Open for writing until the block ends.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    with atomic(path, sealed=True) as temporary:
        with _Patient(temporary, "w+b") as below:
            try:
                with h5py.File(below, "w", userblock_size=USER_BLOCK, **options) as file:
                    yield file
            finally:
                if below.failure:
                    raise below.failure
            below.seek(0)
            below.write(b"gelforge " + UNSEALED + b"\n")
            if below.failure:
                raise below.failure


class _Patient(io.FileIO):
    """A file that keeps the first failure to write for later: HDF5 cannot close a file on a full disk, and may crash."""

    failure: OSError | None = None

    def write(self, content) -> int:
        left = memoryview(content).cast("B")
        size = len(left)
        try:
            while left and not self.failure:
                left = left[super().write(left) :]
        except OSError as failure:
            self.failure = failure
        return size

    def truncate(self, size=None) -> int:
        try:
            return super().truncate(size)
        except OSError as failure:
            self.failure = self.failure or failure
            return size

    def readinto(self, buffer) -> int:
        read = super().readinto(buffer)
        memoryview(buffer).cast("B")[read:] = bytes(len(buffer) - read)  # what could not be written
        return len(buffer)


# HDF5 calls these itself: an exception that has nothing to do with them, such as that of a signal, must not arise there
CALLED_BY_HDF5 = {method.__code__ for method in (_Patient.write, _Patient.truncate, _Patient.readinto)}


def opened(
    path: str | Path, expected: str | None, remedy: str, kind: type[ValueError] = FileError
) -> h5py.File:
    """Return an HDF5 file opened for reading, after checking that it is whole and of the expected format.

    Parameters
    ----------
    path : str or Path
        A file that `writing` made.
    expected : str or None
        What its attribute `format` must be; None for any.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.

    Returns
    -------
    h5py.File
        To be closed by the caller.

    Raises
    ------
    kind
        For a file that is missing, damaged, edited, of another format or that cannot be opened.
    """
    check_seal(path, remedy, kind)
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        if not errno_of(error):
            raise kind(f"{path}: no HDF5 file; {remedy}") from None
        raise kind(f"{path}: complete, but cannot be opened: {why_not_read(error)}") from None
    stated = file.attrs.get("format")
    if expected is not None and stated != expected:
        file.close()
        raise kind(f"{path}: format {stated!r}, expected {expected!r}; {remedy}")
    return file
