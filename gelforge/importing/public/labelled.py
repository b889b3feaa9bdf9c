"""A public set as readings, and the folder that is written of it: images, readings.csv and set.yaml."""

from __future__ import annotations

import csv
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from gelforge.config import write_yaml
from gelforge.importing.refusals import ImportingError
from gelforge.progress import Progress

COLUMNS = ["image", "group", "reference", "time_s", "x_mm", "y_mm", "z_mm", "fx_N", "fy_N", "fz_N", "tx_Nmm", "ty_Nmm",
           "tz_Nmm"]  # fmt: skip
UNKNOWN = (float("nan"),) * 3
ENCODED = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg"}  # files of images by their first bytes

Image = np.ndarray | Path | bytes  # (H, W) or (H, W, 3) RGB uint8, a file, or the bytes of one


@dataclass(frozen=True)
class Reading:
    """A tactile image with the force on it, in the axes of its set."""

    image: Image
    force_N: np.ndarray  # (3,)
    group: str = "all"  # readings of one indentation or one recording: never on two sides of a split
    reference: Image | None = None  # without contact
    time_s: float = float("nan")  # within the group
    position_mm: np.ndarray | tuple = UNKNOWN  # of the indenter
    torque_Nmm: np.ndarray | tuple = UNKNOWN


@dataclass(frozen=True)
class Options:
    """What a command line says of a set; columns: of a table, by what they hold."""

    columns: dict[str, str] = field(default_factory=dict)
    unit: str = "N"


@dataclass(frozen=True)
class Layout:
    """How a public set is laid out, what its forces are, and what it lacks for a session."""

    name: str
    what: str
    force: str
    reference: str
    lacks: str
    licence: str
    read: Callable[[Path, Options], Iterator[Reading]]


@dataclass(frozen=True)
class Written:
    """What a folder holds: counts, and the largest absolute force [N] by axis."""

    images: int
    groups: int
    references: int
    largest_N: np.ndarray


def write_labelled(layout: Layout, source: Path, folder: Path, options: Options, every: int = 1) -> Written:
    """Write every n-th reading of a set into an empty folder.

    Parameters
    ----------
    layout : Layout
        Reads the set.
    source : Path
        Folder or file of the set.
    folder : Path
        Receives set.yaml, readings.csv, images/ and references/.
    options : Options
        What the command line says of the set.
    every : int
        n; 1 for all readings.

    Returns
    -------
    Written
        Counts, and the largest absolute force [N] by axis.

    Raises
    ------
    ImportingError
        For a set that is missing or empty, and for readings that cannot be meant.
    """
    if not source.exists():
        raise ImportingError(f"{source}: no such file or folder; name that of the set")
    (folder / "images").mkdir()
    references: dict[str, str] = {}
    groups, count, largest = set(), 0, np.zeros(3)
    with Progress("images", None) as progress, open(folder / "readings.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for number, reading in enumerate(islice(layout.read(source, options), 0, None, every)):
            at = f"{source}: reading {number * every + 1} ({reading.group})"
            force = np.asarray(reading.force_N, float)
            if force.shape != (3,) or not np.isfinite(force).all():
                raise ImportingError(
                    f"{at}: its force is {reading.force_N}, three numbers are needed; leave it out"
                )
            group = re.sub(r"[^A-Za-z0-9_.-]+", "_", reading.group)
            name = _write_image(folder / "images" / f"{group}_{number:06d}", reading.image, at)
            if reading.reference is not None and group not in references:
                (folder / "references").mkdir(exist_ok=True)
                references[group] = _write_image(folder / "references" / group, reading.reference, at)
            others = (*reading.position_mm, *force, *reading.torque_Nmm)
            words = [name, group, references.get(group, ""), *map(_number, (reading.time_s, *others))]
            table.writerow(words)
            groups.add(group)
            largest = np.maximum(largest, np.abs(force))
            count += 1
            progress.advance()
    if not count:
        raise ImportingError(f"{source}: no reading of layout {layout.name}; name the folder that holds them")
    write_yaml(folder / "set.yaml", _about(layout, every))
    return Written(count, len(groups), len(references), largest)


def _about(layout: Layout, every: int) -> dict:
    return {
        "layout": layout.name,
        "what": layout.what,
        "force": layout.force,
        "reference": layout.reference,
        "no_session": layout.lacks,
        "licence": layout.licence,
        "every": every,
        "axes": "those of the set; gelforge's are x and y in the plane, z out of the gel",
    }


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.9g}"


def _write_image(path: Path, image: Image, at: str) -> str:
    """Write an image as it is, an array as PNG; return its name."""
    if isinstance(image, Path):
        if not image.is_file():
            raise ImportingError(f"{at}: its image {image} is missing; fetch the images of the set too")
        shutil.copyfile(image, path.with_name(path.name + image.suffix.lower()))
        return path.name + image.suffix.lower()
    if isinstance(image, bytes):
        kinds = [kind for first, kind in ENCODED.items() if image.startswith(first)]
        if not kinds:
            raise ImportingError(f"{at}: its image is neither PNG nor JPEG; fetch the file again")
        path.with_name(path.name + kinds[0]).write_bytes(image)
        return path.name + kinds[0]
    good = image.dtype == np.uint8 and image.size and (image.ndim == 2 or image.shape[2:] == (3,))
    if not good:
        raise ImportingError(
            f"{at}: its image is an array {image.shape} of {image.dtype}, (H, W) or (H, W, 3) of uint8 is needed; fetch the"
            " file again"
        )
    name = path.name + ".png"
    if not cv2.imwrite(str(path.with_name(name)), image if image.ndim == 2 else image[..., ::-1]):
        raise ImportingError(f"{path}: not written; make room and run again")
    return name
