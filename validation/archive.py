"""The verdicts of a set in one file of the repository: a set is made again anywhere, its verdicts take hours.

judged/SET.tar.xz    set/sealed.json, set/judged.json, and of every judged case what the judge's seal covers;
                     kept/*.npz, what the judge has solved: with it no base is solved again; not of a finished set
"""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

from . import sealing
from .sealing import JUDGED, REGISTER, SEALED

ARCHIVES = Path(__file__).parent / "judged"
KEPT = "kept"
# Keys of an effect in verdicts and truths of former formats, and those of today
KEYS = {"amounts": "parameters", "shape": "hyperparameters"}


def with_current_keys(document: dict) -> dict:
    """Return a verdict or a truth whose effects have the keys of today's format."""
    effects = [{KEYS.get(key, key): value for key, value in effect.items()} for effect in document["effects"]]
    return {**document, "effects": effects}


def pack(folder: Path, archive: Path, finished: bool = False) -> int:
    """Write the judged cases of a set to an archive, the same bytes for the same verdicts; return how many they are.

    finished: nothing of it is going to be judged any more, so that solutions are left out.
    """
    judged = sealing.read(folder / REGISTER)
    names = [SEALED, REGISTER, *(f"verdicts/{case}/{name}" for case in sorted(judged) for name in JUDGED)]
    archive.parent.mkdir(parents=True, exist_ok=True)
    with tarfile.open(archive, "w:xz", preset=9) as packed:
        for name in names:
            if (folder / name).is_file():  # a case whose command failed has no verdict
                packed.add(folder / name, f"set/{name}", filter=_plain)
        for path in [] if finished else sorted((folder.parent / KEPT).glob("*.npz")):
            packed.add(path, f"{KEPT}/{path.name}", filter=_plain)
    return len(judged)


def unpack(archive: Path, folder: Path) -> int:
    """Put the verdicts of an archive into a set that was generated again; return how many are there.

    Raises SealBroken where it is another set: truths or recordings that are not those that were judged.
    """
    with tarfile.open(archive) as packed:
        published = json.load(packed.extractfile(f"set/{SEALED}"))
        if published != sealing.read(folder / SEALED):
            raise sealing.SealBroken(
                f"{folder / SEALED}: not the set that {archive.name} has verdicts of; generate it by --commit"
                f" {published['commit']} (seed {published['seed']}) at that commit"
            )
        for entry in packed.getmembers():
            kind, _, entry.name = entry.name.partition("/")
            packed.extract(entry, folder if kind == "set" else folder.parent / KEPT, filter="data")
    return len(sealing.read(folder / REGISTER))


def _plain(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    """Return an entry without owner and time, so that equal files make an equal archive."""
    entry.mtime = entry.uid = entry.gid = 0
    entry.uname = entry.gname = ""
    entry.mode = 0o644
    return entry
