"""TaF as MCAP: an episode per file, an image and a wrench per frame on one clock."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from gelforge.importing.message_images import message_images
from gelforge.importing.messages import field, messages
from gelforge.importing.public.arrays import files_of
from gelforge.importing.public.labelled import Layout, Options, Reading
from gelforge.importing.refusals import ImportingError

IMAGES, WRENCH = "/tactile-camera", "/force-torque"
FIELDS = [  # of a wrench, as the messages of the one or the other schema name them
    ("fx", "fy", "fz", "tx", "ty", "tz"),
    ("force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z"),
    ("wrench.force.x", "wrench.force.y", "wrench.force.z", "wrench.torque.x", "wrench.torque.y", "wrench.torque.z"),
]  # fmt: skip
# An image and a wrench farther apart than half a frame of 30 per second, 1/60 s, are not of one moment. Files with
# other pairs are refused (tests/importing/test_other_sources.py).
LEAST_S = 0.02


def read(path: Path, options: Options) -> Iterator[Reading]:
    """Yield a reading per image, with the wrench that was recorded nearest to it; a group is one file."""
    for file in files_of(path, (".mcap",), "episodes (.mcap)"):
        wrenches = [(stamp, _wrench(file, message)) for stamp, message in messages(file, WRENCH, "taf")]
        if not wrenches:
            raise ImportingError(f"{file}: no message of {WRENCH}; fetch the file again")
        stamps, values = np.array([s for s, _ in wrenches]), np.array([w for _, w in wrenches])
        for _, stamp, image in message_images(file, IMAGES, "taf"):
            k = int(np.abs(stamps - stamp).argmin())
            if abs(stamps[k] - stamp) > LEAST_S:
                raise ImportingError(
                    f"{file}: the wrench nearest to the image at {stamp - stamps[0]:.3f} s is {abs(stamps[k] - stamp):.3f} s"
                    f" off, the limit is {LEAST_S} s; images or wrenches are missing, leave this file out"
                )
            rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if image.ndim == 3 else image
            wrench = values[k]
            yield Reading(rgb, wrench[:3], file.stem, None, stamp - stamps[0], torque_Nmm=1e3 * wrench[3:])


def _wrench(file: Path, message) -> np.ndarray:
    for names in FIELDS:
        try:
            return np.array([float(field(message, name)) for name in names])
        except (LookupError, TypeError):
            continue
    raise ImportingError(
        f"{file}: a message of {WRENCH} has none of {', '.join(names[2] for names in FIELDS)}; its layout is another one,"
        " see docs/public-sets.md"
    )


LAYOUT = Layout(
    name="taf",
    what="GelSight Mini and a custom sensor, pressed and probed by objects of 408 sequences, 30 frames per second",
    force="measured: ATI six-axis sensor",
    reference="none is marked",
    lacks="there are no positions of a stage or robot, so that place, depth and contact point are not known",
    licence="MIT",
    read=read,
)
