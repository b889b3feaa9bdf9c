"""Ways in which a product is damaged or exchanged; each returns in words what it did, "" where it does not apply."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from benchmarks.fault_kinds.finished_study import replaced
from gelforge.files import seal

Damage = Callable[[Path, np.random.Generator], str]


def flipped_bit(path: Path, rng: np.random.Generator) -> str:
    content = bytearray(path.read_bytes())
    place, bit = int(rng.integers(len(content))), int(rng.integers(8))
    content[place] ^= 1 << bit
    replaced(path, bytes(content))
    return f"bit {bit} of byte {place} flipped"


def random_bytes(path: Path, rng: np.random.Generator) -> str:
    content = bytearray(path.read_bytes())
    place = int(rng.integers(len(content)))
    content[place : place + 64] = rng.bytes(min(64, len(content) - place))
    replaced(path, bytes(content))
    return f"64 bytes from {place} on are random"


def lost_page(path: Path, rng: np.random.Generator) -> str:
    content = bytearray(path.read_bytes())
    page = 4096 * int(rng.integers(len(content) // 4096 + 1))
    content[page : page + 4096] = bytes(len(content[page : page + 4096]))
    replaced(path, bytes(content))
    return f"page from {page} on is zero"


def cut(path: Path, rng: np.random.Generator) -> str:
    content = path.read_bytes()
    length = int(rng.integers(len(content)))
    replaced(path, content[:length])
    return f"cut to {length} of {len(content)} bytes"


def emptied(path: Path, rng: np.random.Generator) -> str:
    replaced(path, b"")
    return "empty"


def appended(path: Path, rng: np.random.Generator) -> str:
    replaced(path, path.read_bytes() + rng.bytes(100))
    return "100 bytes behind its end"


def without_checksum(path: Path, rng: np.random.Generator) -> str:
    content = path.read_bytes()
    stripped = re.sub(rb"sha256:[0-9a-f]{64}", b"0" * 71, content)
    replaced(path, stripped)
    return "without checksum"


def exchanged(path: Path, rng: np.random.Generator) -> str:
    """Another whole product of the same kind, of the same study."""
    names = {"law.json": "../*/law.json"}.get(path.name, f"*{path.suffix}")
    others = [other for other in sorted(path.parent.glob(names)) if other.resolve() != path.resolve()]
    others = [other for other in others if other.read_bytes() != path.read_bytes()]
    if not others:
        return ""
    other = others[int(rng.integers(len(others)))]
    replaced(path, other.read_bytes())
    return f"{other.name} of {other.parent.name} in its place"


# --------------------------------------------------------------------------------------------------- HDF5
def _changed(path: Path, change: Callable[[h5py.File], str], sealed: bool = False) -> str:
    if path.suffix != ".h5":
        return ""
    replaced(path, path.read_bytes())
    with h5py.File(path, "r+") as file:
        what = change(file)
    if sealed:
        seal(path)
    return what


def _drawn(
    file: h5py.File, rng: np.random.Generator, of: Callable[[h5py.Dataset], bool] | None = None
) -> str:
    """Return the name of a dataset, in whatever group; "" where there is none."""
    names: list[str] = []
    file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    names = sorted(name for name in names if of is None or of(file[name]))
    return names[int(rng.integers(len(names)))] if names else ""


def missing_dataset(path: Path, rng: np.random.Generator) -> str:
    def change(file):
        if not (name := _drawn(file, rng)):
            return ""
        del file[name]
        return f"without {name}"

    return _changed(path, change)


def reshaped_dataset(path: Path, rng: np.random.Generator) -> str:
    def change(file):
        if not (name := _drawn(file, rng)):
            return ""
        data = file[name]
        values, dtype, attributes = np.asarray(data[()]), data.dtype, dict(data.attrs)
        del file[name]
        halved = values.ndim == 1 or (values.ndim and rng.integers(2))  # a row cannot be flattened
        changed = values[: len(values) // 2] if halved else values.ravel()
        file.create_dataset(name, data=changed, dtype=dtype).attrs.update(attributes)
        return f"{name} of shape {changed.shape} instead of {values.shape}"

    return _changed(path, change)


def other_values(path: Path, rng: np.random.Generator) -> str:
    def change(file):
        if not (name := _drawn(file, rng, lambda data: data.dtype.kind == "f" and data.size)):
            return ""
        file[name][...] = file[name][()] * 1.01
        return f"{name} is 1 % larger"

    return _changed(path, change)


def other_study_hdf5(path: Path, rng: np.random.Generator) -> str:
    """Another study's file: whole, of equal shape, with other values and digests."""

    def change(file):
        for name in ("inputs_digest", "digest", "settings_digest", "model_sha256"):
            if name in file.attrs:
                file.attrs[name] = "0123" * 16
        for name in ("total_force_N", "bin_force_N", "feature", "force_distribution_N", "predicted_N"):
            if name in file:
                file[name][...] = file[name][()] * 1.01
        return "another study's file, whole"

    return _changed(path, change, sealed=True)


# --------------------------------------------------------------------------------------------------- text
def digit(path: Path, rng: np.random.Generator) -> str:
    if path.suffix not in (".json", ".csv"):
        return ""
    text = path.read_text()
    places = [m.start() for m in re.finditer(r"(?<=[0-9.])[0-9](?=[0-9,\n])", text)]
    place = places[int(rng.integers(len(places)))]
    replaced(path, (text[:place] + str((int(text[place]) + 1) % 10) + text[place + 1 :]).encode())
    return f"digit {place} is another"


def row(path: Path, rng: np.random.Generator) -> str:
    if path.suffix != ".csv":
        return ""
    lines = path.read_text().splitlines(keepends=True)
    number = int(rng.integers(1, len(lines)))
    what = ["lost", "twice", "moved to the end"][int(rng.integers(3))]
    taken = lines.pop(number)
    lines = {"lost": lines, "twice": [*lines[:number], taken, taken, *lines[number:]]}.get(
        what, [*lines, taken]
    )
    replaced(path, "".join(lines).encode())
    return f"row {number} {what}"


def other_study_text(path: Path, rng: np.random.Generator) -> str:
    """Another study's table or law: whole, with other values and digests."""
    text = path.read_text() if path.suffix in (".json", ".csv") else ""
    if path.name == "law.json":
        content = json.loads(text)
        content["study"], content["mu_kPa"] = "other", [1.1 * value for value in content.get("mu_kPa", [])]
        text = json.dumps({"checksum": content.pop("checksum"), **content}, indent=2)
    elif "inputs:" in text:
        text = re.sub(r"inputs:[0-9a-f]{64}", "inputs:" + "0123" * 16, text)
    else:
        return ""
    replaced(path, text.encode())
    seal(path)
    return "another study's file, whole"


def other_study_model(path: Path, rng: np.random.Generator) -> str:
    if path.suffix != ".pt":
        return ""
    import torch

    from gelforge.learning.models.model_file import save_tensors

    content = torch.load(path, weights_only=True)
    content["settings"]["shards_digest"] = "0123" * 16
    path.unlink()
    save_tensors(path, content)
    return "another study's model, whole"


ANY = (flipped_bit, random_bytes, lost_page, cut, emptied, appended, without_checksum)
KINDS: dict[str, tuple[Damage, ...]] = {
    "bit flip": (flipped_bit,),
    "other bytes, lost page": (random_bytes, lost_page, appended),
    "cut short, empty": (cut, cut, emptied),
    "no checksum": (without_checksum,),
    "missing or reshaped dataset": (missing_dataset, reshaped_dataset),
    "equal shape, other values": (other_values, digit, row),
    "another file of the study": (exchanged,),
    "another study's file": (other_study_hdf5, other_study_text, other_study_model),
}
EXCHANGED = ("another file of the study", "another study's file")
