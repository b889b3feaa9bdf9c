"""Solved sites that outlive the job that solved them.

Workflow managers delete the output of a job that failed, was cancelled or ran out of time, and of a group of jobs all
outputs if one member fails. A solved site is therefore written as `.solved/<cell>.<digest of its inputs>.h5` next to its
target and linked to it: while both exist they are one file and take the disk once. The next job for the same site takes it
up where the inputs are equal and its checksum is right. There is one entry per site; the workflow removes those that are
no longer needed, and those of forced jobs before they start.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable
from glob import escape
from pathlib import Path

from gelforge.files import atomic
from gelforge.indentation.cells.cell_file import Cell, CellError, read_cell, timings_path, write_cell

FOLDER = ".solved"
# Of the digest, in the name: 64 bits, of which two of 200 000 sites agree by chance once in 1e9 plans (von Mises 1939).
DIGITS = 16


def solved_once(out: Path, inputs: str, solve: Callable[[], Cell], fresh: bool = False) -> tuple[Cell, str]:
    """Return a site that is solved unless an earlier job has solved it from the same inputs.

    Parameters
    ----------
    out : Path
        The site's file, which is written.
    inputs : str
        Digest of everything that decides the site.
    solve : callable
        Returns the solved Cell.
    fresh : bool
        Solve in any case.

    Returns
    -------
    Cell
        What is in the file.
    str
        In words, whether it was solved or cached.
    """
    entry = out.parent / FOLDER / f"{out.stem}.{inputs[:DIGITS]}.h5"
    cell, words = (None, "solved anew, as asked") if fresh else _kept(entry)
    if cell is None:
        cell = solve()
        write_cell(entry, cell)
    _remove(older for older in entries(out) if older != entry)
    _link(entry, out)
    if timings_path(entry).is_file():
        _link(timings_path(entry), timings_path(out))
    return cell, words


def _kept(entry: Path) -> tuple[Cell | None, str]:
    """Return the kept site, none where there is none or it is damaged, and what is done in words."""
    if not entry.is_file():
        return None, "solved"
    try:
        return read_cell(entry), f"not solved again: taken up from {entry}, which has the same inputs"
    except CellError as error:
        return None, f"solved, as what was kept is damaged ({error})"


def _link(entry: Path, out: Path) -> None:
    """Make out the same file as entry, with the present time: it is newer than the inputs it was made from."""
    with atomic(out) as temporary:
        try:
            os.link(entry, temporary)
        except OSError:  # a file system without hard links
            shutil.copyfile(entry, temporary)
        os.utime(temporary)


def entries(out: Path) -> list[Path]:
    """Return the kept solutions of a site's file."""
    return sorted((out.parent / FOLDER).glob(f"{escape(out.stem)}.{'[0-9a-f]' * DIGITS}.h5"))


def forget(outs: Iterable[Path]) -> int:
    """Remove the kept solutions of these sites' files and return how many there were."""
    cached = [entry for out in outs for entry in entries(out)]
    _remove(cached)
    return len(cached)


def _remove(cached: Iterable[Path]) -> None:
    for entry in cached:
        entry.unlink(missing_ok=True)
        timings_path(entry).unlink(missing_ok=True)


def tidy(outs: Iterable[Path]) -> None:
    """Remove kept solutions in the folders of these files but for those of files that are not there yet."""
    outs = list(outs)
    missing = {(out.parent, out.stem) for out in outs if not out.exists()}
    for folder in {out.parent for out in outs}:
        for entry in (folder / FOLDER).glob("*"):
            if (folder, entry.name.split(".")[0]) not in missing:
                entry.unlink(missing_ok=True)
        if (folder / FOLDER).is_dir() and not any((folder / FOLDER).iterdir()):
            (folder / FOLDER).rmdir()
