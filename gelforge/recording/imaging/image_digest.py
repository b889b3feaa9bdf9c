"""The digest of a session's images: their names, sizes and content.

Content is read again only where size or a time stamp of a file has changed since it was last read here: what is known is
kept in `.snakemake/images` of the folder where Snakemake runs. So a workflow that asks at every start pays for the names
alone (half a second for 13 000 images, 3 s where 40 kB of each are read), and a copy or a `touch`, which change time stamps
only, change no digest.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from gelforge.files import digest, file_sha256, write_text
from gelforge.recording.imaging.images import reference_path

KEPT = Path(".snakemake/images")
# A file this new may change again within a tick of its time stamp, 2 s at most (FAT32 specification, Microsoft 2000): what
# it holds is not kept.
SETTLED_NS = 2_000_000_000
State = list[int]  # of a file: size, times of the last change of content and of anything


def images_digest(folder: str | Path) -> str:
    """Return the digest of the reference frame and all files in `images` of a session's folder; hidden files are none."""
    folder = Path(folder)
    paths = dict(_files(folder))
    kept = _kept_file(folder)
    known = _read(kept)
    states = {name: _state(path) for name, path in paths.items()}
    unknown = [name for name in paths if known.get(name, [None])[0] != states[name]]
    # reading and hashing run in parallel
    with ThreadPoolExecutor(4) as pool:
        digests = dict(zip(unknown, pool.map(file_sha256, (paths[name] for name in unknown))))
    content = {name: digests.get(name) or known[name][1] for name in paths}
    settled = time.time_ns() - SETTLED_NS
    keep = {name: [states[name], content[name]] for name in paths if max(states[name][1:]) < settled}
    if kept and keep != known:
        _write(kept, keep)
    return digest({name: [states[name][0], content[name]] for name in paths})


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield name and path of a session's image files, in the order of names."""
    reference = reference_path(folder)
    if reference.is_file():
        yield reference.name, reference
    if (folder / "images").is_dir():
        for entry in sorted(os.scandir(folder / "images"), key=lambda entry: entry.name):
            if entry.is_file() and not entry.name.startswith("."):
                yield f"images/{entry.name}", Path(entry.path)


def _state(path: Path) -> State:
    status = os.stat(path)
    return [status.st_size, status.st_mtime_ns, status.st_ctime_ns]


def _kept_file(folder: Path) -> Path | None:
    """Return where digests of a folder's images are kept; None outside a folder where Snakemake runs."""
    if not KEPT.parent.is_dir():
        return None
    return KEPT / f"{hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:16]}.json"


def _read(kept: Path | None) -> dict[str, list]:
    """Return state and digest of files by name as they were kept; nothing where that cannot be read."""
    try:
        content = json.loads(kept.read_text(encoding="utf-8")) if kept else {}
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _write(kept: Path, content: dict[str, list]) -> None:
    """Keep digests; a folder that cannot be written to costs time only."""
    try:
        write_text(kept, json.dumps(content))
    except (OSError, ValueError):
        return
