"""Files that are whole or absent, that show when they were changed, and digests of what made them.

A product that a later stage reads holds the SHA-256 of its own bytes as `sha256:` and 64 digits, which count as zeros in
the sum: in the user block of HDF5, in the comment of a zip archive (model.pt, npz), as the first key of JSON, as the name
of a last, empty column of a CSV table; of a verdict's tables verdict.json holds it. Other programs read such files as
before; who changes one seals it anew (`seal`).
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import shutil
import socket
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.input_files import CONTAINERS, regular_file, what_it_is

if TYPE_CHECKING:
    import pandas as pd

SEAL_COLUMN = re.compile(r"sha256:[0-9a-f]{64}|inputs:[0-9a-f]*")
DIGITS = b"0" * 64  # in place of a digest until it is known
SEAL = re.compile(rb"sha256:([0-9a-f]{64})")
UNSEALED = b"sha256:" + DIGITS
USER_BLOCK = 512  # bytes before the content of an HDF5 file, the least that the format allows
HEAD = 4096  # bytes at the beginning of a file among which its checksum is looked for
TAIL = len(UNSEALED)  # bytes at the end of a zip archive
CHUNK = 1 << 16  # bytes that are read at once (no result depends on it)
# A temporary file of another machine that nobody has written to for a day, 86400 s, has lost its owner.
STALE_S = (
    86400.0  # a temporary file of another machine that nobody has written to for a day has lost its owner
)
NO_ROOM = {
    errno.ENOSPC: "no space is left on the device",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file is larger than the limit on file sizes allows (ulimit -f)",
    errno.EROFS: "the file system is read-only",
}
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


# ------------------------------------------------------------------------------------------ whole or absent
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


def errno_of(error: BaseException) -> int:
    """Return the system's number of an error, which HDF5 hides in its text; 0 where there is none."""
    hidden = re.search(r"errno = (\d+)", str(error))
    return getattr(error, "errno", None) or (int(hidden[1]) if hidden else 0)


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
        found = re.search(r"\.([^.]+)-(\d+)-(\d+)\.tmp(\.[^.]*)?$", path.name)
        if not found or _lives(path, found[1], int(found[2]), int(found[3])):
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
            return os.path.getmtime(path) > time.time() - STALE_S
        except OSError:
            return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return _started(process) == started


# ---------------------------------------------------------------------------------------------- the seal
def seal(path: str | Path) -> None:
    """Write the SHA-256 of a file into the place that it keeps for it; a zip archive without comment gets one.

    Raises ValueError for a file that keeps no such place.
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
        head = SEAL.search(file.read(HEAD))
        if head:
            return head.start(1)
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - TAIL))
        return size - 64 if SEAL.fullmatch(file.read()) else None


def _sum(path: Path, place: int) -> str:
    """Return the SHA-256 of a file in which the digits at a place count as zeros."""
    total = hashlib.sha256()
    with open(path, "rb") as file:
        left = place
        while left and (chunk := file.read(min(CHUNK, left))):
            total.update(chunk)
            left -= len(chunk)
        file.read(len(DIGITS))
        total.update(DIGITS)
        while chunk := file.read(CHUNK):
            total.update(chunk)
    return total.hexdigest()


# ------------------------------------------------------------------------------------------------- text
def write_text(target: str | Path, text: str) -> None:
    """Write a UTF-8 text file, whole or not at all.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    text : str
        Its content; line ends stay as they are.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    with atomic(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(target: str | Path, content) -> None:
    """Write JSON with sorted keys, whole or not at all: the same content gives the same bytes.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    content : object
        Anything that JSON can hold; no NaN and no infinity.

    Raises
    ------
    ValueError
        For NaN or infinity.
    FileError
        For a full disk; what was there before stays.
    """
    write_text(target, json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n")


def write_product_json(target: str | Path, content: dict) -> None:
    """Write a JSON object that a later stage reads, its checksum as the first key `checksum`.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    content : dict
        Anything that JSON can hold; no NaN and no infinity.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False)
    with atomic(target, sealed=True) as temporary:
        first = '{\n  "checksum": "' + UNSEALED.decode() + '"' + ("," if content else "")
        temporary.write_text(first + text.removeprefix("{") + "\n", encoding="utf-8")


def read_product_json(path: str | Path, remedy: str, kind: type[ValueError] = FileError) -> dict:
    """Return the JSON object that `write_product_json` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.

    Returns
    -------
    dict
        Without the checksum.

    Raises
    ------
    kind
        For a file that is missing, damaged or edited, and for other content than an object.
    """
    check_seal(path, remedy, kind)
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:  # sealed so by hand
        raise kind(f"{path}: not valid JSON ({error}); {remedy}") from None
    if not isinstance(content, dict):
        raise kind(f"{path}: holds {type(content).__name__}, expected an object; {remedy}")
    content.pop("checksum", None)
    return content


def write_product_table(
    target: str | Path, table: pd.DataFrame, float_format: str | None = None, inputs: str = ""
) -> None:
    """Write a CSV table that a later stage reads, its checksum as the name of a last, empty column.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    table : pandas.DataFrame
        Its index is not written.
    float_format : str, optional
        As of pandas.DataFrame.to_csv, such as "%.6g".
    inputs : str
        Digest of what the table was made from; it becomes the name of another empty column.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    with atomic(target, sealed=True) as temporary:
        names = [f"inputs:{inputs}"] * bool(inputs) + [UNSEALED.decode()]
        sealed = without_seal(table).assign(**dict.fromkeys(names, ""))
        sealed.to_csv(temporary, index=False, float_format=float_format, lineterminator="\n")


def read_product_table(
    path: str | Path, remedy: str, kind: type[ValueError] = FileError, **options
) -> pd.DataFrame:
    """Return a table that `write_product_table` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.
    **options
        As of pandas.read_csv.

    Returns
    -------
    pandas.DataFrame
        Without the columns of the checksum.

    Raises
    ------
    kind
        For a file that is missing, damaged or edited.
    """
    check_seal(path, remedy, kind)
    import pandas as pd  # a third of a second, which who reads no table does without

    return without_seal(pd.read_csv(path, **options))


def without_seal(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table without the columns that are its checksum and the digest of its inputs."""
    return table.drop(columns=[name for name in table.columns if SEAL_COLUMN.fullmatch(str(name))])


def check_table_inputs(
    path: str | Path, expected: str, remedy: str, kind: type[ValueError] = FileError
) -> None:
    """Refuse a table that was made from other inputs than the expected ones.

    Parameters
    ----------
    path : str or Path
        A table that `write_product_table` wrote with `inputs`.
    expected : str
        The digest of the inputs.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.

    Raises
    ------
    kind
        For a table that is damaged or of another digest.
    """
    check_seal(path, remedy, kind)
    with open(path, encoding="utf-8") as file:
        found = re.search(r"inputs:([0-9a-f]+)", file.readline())
    if found is None or found[1] != expected:
        stated = found[1][:12] if found else "none"
        raise kind(
            f"{path}: made from other inputs than those of this study (digest {stated}, expected {expected[:12]}); {remedy}"
        )


def write_table(folder: str | Path, name: str, table: pd.DataFrame) -> None:
    """Write a table as <name>.csv, with its checksum, and as <name>.md.

    Parameters
    ----------
    folder : str or Path
        Made where it is missing.
    name : str
        Name of both files.
    table : pandas.DataFrame
        Its index is not written; the Markdown has four significant digits.
    """
    write_product_table(Path(folder) / f"{name}.csv", table)
    write_text(Path(folder) / f"{name}.md", table.to_markdown(index=False, floatfmt=".4g") + "\n")


# ---------------------------------------------------------------------------------------------- digests
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
    package = Path(__file__).parent
    lines = []
    for part in parts:
        if not (package / part).exists():
            raise ValueError(f"{part} is no file or folder of gelforge; name it where it is now")
        found = sorted((package / part).rglob("*")) if (package / part).is_dir() else [package / part]
        for path in found:
            hidden = any(name.startswith((".", "__pycache__")) for name in path.relative_to(package).parts)
            if hidden or not path.is_file():
                continue
            lines.append(f"{path.relative_to(package).as_posix()} {file_sha256(path)}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
