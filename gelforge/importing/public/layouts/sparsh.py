"""Sparsh's force sets (DIGIT, GelSight Mini): a folder per batch with chunks of images and one file of forces.

Published as pickles; read after they were converted to .npz, where a nested name is a path: `trajectories/3/forces`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from gelforge.importing.public.arrays import SCRIPT, files_of, load_arrays
from gelforge.importing.public.labelled import Layout, Options, Reading
from gelforge.importing.refusals import ImportingError

FORCES = "dataset_slip_forces"


def read(path: Path, options: Options) -> Iterator[Reading]:
    """Yield the readings of every trajectory of every batch; a group is one trajectory, the first rest its reference."""
    files = [p for p in files_of(path, (".npz", ".pkl"), f"{FORCES}.npz") if p.stem == FORCES]
    if not files:
        raise ImportingError(f"{path}: no {FORCES}.npz in it; name the folder of a batch, or of several")
    converted = [p for p in files if p.suffix == ".npz"]
    if not converted:
        raise ImportingError(f"{files[0]}: a pickle can run code when it is loaded and is not read; {SCRIPT}")
    for file in converted:
        yield from _batch(file, "_".join(file.parent.parts[-2:]))


def _batch(file: Path, name: str) -> Iterator[Reading]:
    labels = load_arrays(file)
    names = sorted({key.split("/")[1] for key in labels if key.startswith("trajectories/")}, key=_order)
    if not names or "in_contact" not in labels:
        raise ImportingError(
            f"{file}: no in_contact or trajectories/<number>/forces in it; convert the pickle again"
        )
    images = _Images(file.parent)
    rest = np.flatnonzero(labels["in_contact"] == 0)
    reference = images[int(rest[0])] if len(rest) else None
    for number in names:
        try:
            index, force, pose = (
                labels[f"trajectories/{number}/{key}"] for key in ("indexes", "forces", "poses")
            )
        except KeyError as error:
            raise ImportingError(f"{file}: {error} is missing; convert the pickle again") from None
        # some trajectories name more images than they have forces
        count = min(len(index), len(force), len(pose))
        for k in range(count):
            yield Reading(
                images[int(index[k])], force[k], f"{name}_{number}", reference, position_mm=pose[k][:3]
            )


class _Images:
    """The images of a batch by their number through all chunks; one chunk is held at a time."""

    def __init__(self, folder: Path):
        self.files = sorted(p for p in folder.glob("dataset_*_[0-9]*.npz"))
        if not self.files:
            raise ImportingError(
                f"{folder}: no dataset_<sensor>_<number>.npz in the folder of {FORCES}.npz; fetch and convert the images too"
            )
        self.starts = [0]  # of the chunks whose length is known
        self.chunk = -1
        self.held: Mapping[str, np.ndarray] = {}

    def __getitem__(self, number: int) -> bytes | np.ndarray:
        chunk = max(k for k, start in enumerate(self.starts) if start <= number)
        while True:
            if chunk == len(self.files):
                raise ImportingError(
                    f"{self.files[-1]}: no image {number}, the chunks hold {self.starts[-1]}; fetch the missing ones"
                )
            if chunk != self.chunk:
                self.chunk, self.held = chunk, load_arrays(self.files[chunk])
            if chunk + 1 == len(self.starts):
                self.starts.append(self.starts[-1] + len(self.held))
            if number < self.starts[chunk + 1]:
                image = self.held.get(str(number - self.starts[chunk]))
                if image is None:
                    raise ImportingError(
                        f"{self.files[chunk]}: its images are not named 0 to {len(self.held) - 1}; convert the pickle again"
                    )
                return image.tobytes() if image.ndim == 1 else image
            chunk += 1


def _order(name: str) -> tuple[int, str]:
    return (int(name), "") if name.isdecimal() else (0, name)


LAYOUT = Layout(
    name="sparsh",
    what="DIGIT or GelSight Mini, pressed by a sphere, a flat and a sharp probe and slid by a robot",
    force="measured: three axes of an ATI Nano17",
    reference="the batch's first image without contact",
    lacks="trajectories begin in contact and have no time stamps, so that contact point and depth are not known",
    licence="CC BY-NC 4.0",
    read=read,
)
