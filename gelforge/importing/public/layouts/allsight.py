"""AllSight: images in folders, and a JSON file per recording with the wrench, the poses and the time of each."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gelforge.importing.public.labelled import Layout, Options, Reading
from gelforge.importing.refusals import ImportingError

BEST_FIRST = ("_transformed_annotated", "_transformed", "")  # of one recording the first that is there


def read(path: Path, options: Options) -> Iterator[Reading]:
    """Yield a reading per image; a group is an indentation. Folders as in `<gel>/<leds>/data/<indenter>/data_<date>/`."""
    folders = sorted({p.parent for p in path.rglob("data_*.json")}) if path.is_dir() else [path.parent]
    if not folders:
        raise ImportingError(
            f"{path}: no data_<date>.json in this folder; name that of the set, or of one gel"
        )
    for folder in folders:
        files = [folder / f"{folder.name}{ending}.json" for ending in BEST_FIRST]
        files = [file for file in files if file.is_file()] if path.is_dir() else [path]
        if not files:
            raise ImportingError(f"{folder}: no {folder.name}.json in it; fetch the folder again")
        yield from _recording(files[0])


def _recording(file: Path) -> Iterator[Reading]:
    try:
        rows = json.loads(file.read_bytes())
    except ValueError as error:
        raise ImportingError(f"{file}: no JSON ({error}); fetch the file again") from None
    if not isinstance(rows, dict) or not rows:
        raise ImportingError(
            f"{file}: no images in it, an object of one entry per image is needed; fetch the file again"
        )
    for name, row in rows.items():
        try:
            wrench = np.array(row["ft"], float)
            position = 1e3 * np.array(row["pose_ee"][0], float)
            image, reference, time = row["frame"], row["ref_frame"], float(row["time"])
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ImportingError(
                f"{file}, {name}: ft, pose_ee, frame, ref_frame or time is missing or no number ({error}); name a file of"
                " labels"
            ) from None
        if wrench.shape != (6,):
            raise ImportingError(
                f"{file}, {name}: ft has {wrench.size} numbers, 6 are needed; fetch the file again"
            )
        group = f"{file.parent.parent.name}_{file.parent.name.removeprefix('data_')}_{Path(reference).stem}"
        yield Reading(
            _here(file, image), wrench[:3], group, _here(file, reference), time, position, 1e3 * wrench[3:]
        )


def _here(file: Path, named: str) -> Path:
    """Return an image on this machine: the file names it where its authors had it."""
    images = file.parents[3] / "images"  # <leds>/data/<indenter>/data_<date>/<file>
    return images.joinpath(*Path(named.replace("\\", "/")).parts[-3:])


LAYOUT = Layout(
    name="allsight",
    what="domes of AllSight pressed by spheres and other indenters on a robot; gel and LEDs by folder",
    force="measured: the load cell's wrench",
    reference="one image without contact per indentation",
    lacks="indentations run along the normals of a dome at poses of a robot and images are picked from each indentation at"
    " times of its own, so that there is no log from before contact on from which depth could be found",
    licence="none is stated",
    read=read,
)
