"""What a format is, and how an export is written: a folder that is whole or absent."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType

from gelforge.dataset.exports.source import Source
from gelforge.dataset.manifest import SUMS
from gelforge.dataset.schema import DatasetError
from gelforge.files import FileError, file_sha256, no_room, remove_orphans, temporary_beside, write_text

MB = 1e6  # bytes (SI prefix, IEC 80000-13:2008)


@dataclass(frozen=True)
class Options:
    """What the person who exports decides."""

    fps: float = 10.0  # frames per second of formats that need times; shards hold none
    licence: str | None = None  # identifier, e.g. cc-by-4.0; None: none is granted
    published: str | None = None  # ISO date


@dataclass(frozen=True)
class Export:
    """One format: `write(source, folder, options)` fills an empty folder."""

    name: str
    words: str  # what is written, and what reads it
    write: Callable[[Source, Path, Options], None]


def export_dataset(
    form: Export, source: Source, out: str | Path, options: Options, limit_mb: float | None = None
) -> int:
    """Write a dataset into a new folder, with SHA256SUMS.

    The folder appears under its name when all is written, synced and summed; a run that was broken off leaves nothing
    there.

    Parameters
    ----------
    form : Export
        The format.
    source : Source
        As `open_source` returns it.
    out : str or Path
        The new folder.
    options : Options
        Of the format.
    limit_mb : float, optional
        Largest size [MB].

    Returns
    -------
    int
        Size in bytes.

    Raises
    ------
    DatasetError
        Where the folder exists, or is larger than limit_mb.
    """
    with whole_folder(out) as folder:
        form.write(source, folder, options)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        sums = "".join(f"{file_sha256(path)}  {path.relative_to(folder).as_posix()}\n" for path in files)
        write_text(folder / SUMS, sums)
        size = sum(path.stat().st_size for path in (*files, folder / SUMS))
        if limit_mb and size > limit_mb * MB:
            raise DatasetError(
                f"{out}: the sample takes {size / MB:.1f} MB, --sample-mb is {limit_mb:g}; "
                "not written, ask for a smaller --sample-mb"
            )
    return size


@contextmanager
def whole_folder(target: str | Path) -> Iterator[Path]:
    """Yield an empty folder next to the target that takes its name, synced, when the block ends without an error."""
    target = Path(target)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise DatasetError(f"{target}: exists already; name another folder, or remove it first")
    folder = temporary_beside(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_orphans(target.parent)
        folder.mkdir()
        yield folder
        for path in (*folder.rglob("*"), folder):
            _sync(path)
        os.replace(folder, target)
        _sync(target.parent)
    except OSError as error:
        if reason := no_room(error):
            raise FileError(f"{target}: not written, {reason}; make room and run again") from None
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def library(module: str, package: str = "", install: str = "'gelforge[export]'") -> ModuleType:
    """Return a library that a format needs and gelforge itself does not. Raises DatasetError with how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise DatasetError(
            f"{package or module} is needed and not installed ({error}); pip install {install}"
        ) from None
