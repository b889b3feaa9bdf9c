"""Frames one after the other: from a folder of images, a video file or a camera."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gelforge.input_files import what_it_is
from gelforge.recording.imaging.flow import ImageError, grey, read_grey

SUFFIXES = {".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg"}


@dataclass(frozen=True)
class Frame:
    """One grey image (H, W) uint8 with its name and time [s]."""

    name: str
    time_s: float  # since the first frame; NaN for a folder of images, which knows no times
    image: np.ndarray


def images_in(folder: Path) -> list[Path]:
    """Return the images of a folder by the numbers in their names: frame_2 before frame_10, 1.25 before 1.5.

    Digits after a point that count on, as in cam1.2 and cam1.10, are a number of their own. They do where they have several
    widths, and a longer one ends in zero, all rise by equal steps, or they fill half of their range.

    Parameters
    ----------
    folder : Path
        Must exist.

    Returns
    -------
    list of Path
        PNG, TIFF, BMP and JPEG, in order.
    """
    paths = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    names = {path: re.split(r"(\d+(?:\.\d+)?)", path.stem) for path in paths}
    fractions: dict[int, set[str]] = {}
    for parts in names.values():
        for slot in range(1, len(parts), 2):
            fractions.setdefault(slot, set()).add(parts[slot].partition(".")[2])
    counted = {slot for slot, texts in fractions.items() if _counts(texts - {""})}

    def key(path: Path) -> tuple[list[tuple[int, int, int, str]], str]:
        keys = []
        for slot, text in enumerate(names[path]):
            integer, _, fraction = text.partition(".")
            if slot % 2:
                keys.append((0, int(integer), int(fraction or 0) if slot in counted else 0, fraction))
            else:
                keys.append((1, 0, 0, text))
        return keys, path.suffix

    return sorted(paths, key=key)


def _counts(fractions: set[str]) -> bool:
    """Return whether digits after a point are numbers that count on, not decimal fractions."""
    widths, numbers = {len(text) for text in fractions}, sorted(map(int, fractions))
    even = len(numbers) > 2 and len({after - before for before, after in zip(numbers, numbers[1:])}) == 1
    last_zero = any(len(text) > min(widths) and text.endswith("0") for text in fractions)
    padded = any(len(text) > 1 and text.startswith("0") for text in fractions)
    dense = bool(numbers) and not padded and 2 * len(numbers) > numbers[-1] - numbers[0] + 1
    return len(widths) > 1 and (even or last_zero or dense)


def frames(source: str | Path | int) -> Iterator[Frame]:
    """Return the frames of a source, one after another.

    Parameters
    ----------
    source : str, Path or int
        A folder of images (by the numbers in their names), a video file, or a camera by its number.

    Yields
    ------
    Frame
        Image (H, W) uint8 in grey levels, name, and time [s] since the first frame; NaN for a folder.

    Raises
    ------
    ImageError
        For a source that is missing, empty or cannot be decoded, before the first frame is asked for.
    """
    if isinstance(source, int) or str(source).isdecimal():
        number = int(str(source))
        return _camera_frames(_opened(number, f"camera {number}"), number)
    path = Path(source)
    if path.is_dir():
        if (path / "session.yaml").is_file() and (path / "images").is_dir():
            raise ImageError(
                f"{path}: is the folder of a session; give {path / 'images'}, with --reference {path / 'reference.png'}"
            )
        names = images_in(path)
        if not names:
            raise ImageError(
                f"{path}: no images ({', '.join(sorted(SUFFIXES))}) in this folder; give another"
            )
        return (Frame(p.name, float("nan"), read_grey(p)) for p in names)
    if not path.is_file():
        raise ImageError(
            f"{path}: no such folder or video; give a folder of images, a video or a camera's number"
        )
    what = what_it_is(path)
    if what and not what.startswith(("a video", "an image")):
        raise ImageError(f"{path}: is {what}; give a folder of images, a video or a camera's number")
    return _video_frames(_opened(str(path), str(path)), path)


def _opened(source: str | int, label: str) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(source)
    if not capture.isOpened():
        raise ImageError(f"{label}: cannot be opened; check that it exists and that OpenCV reads this kind")
    return capture


def _video_frames(capture: cv2.VideoCapture, path: Path) -> Iterator[Frame]:
    count = 0
    for count, (stamp, image) in enumerate(decoded(capture), start=1):
        yield Frame(f"{path.name}#{count - 1}", stamp, grey(image))
    if not count:
        raise ImageError(f"{path}: the video has no frame that can be decoded; convert it (MJPG, H.264)")


def decoded(capture: cv2.VideoCapture) -> Iterator[tuple[float, np.ndarray]]:
    """Yield time in the container [s] and image of every frame of a video that is open, and close it."""
    try:
        while True:
            ok, image = capture.read()
            if not ok:
                return
            yield capture.get(cv2.CAP_PROP_POS_MSEC) / 1000, image
    finally:
        capture.release()


def _camera_frames(capture: cv2.VideoCapture, number: int) -> Iterator[Frame]:
    try:
        start, index = time.monotonic(), 0
        while True:
            ok, image = capture.read()
            if not ok:
                raise ImageError(f"camera {number}: no frame after {index}; is it still connected?")
            yield Frame(f"camera{number}#{index}", time.monotonic() - start, grey(image))
            index += 1
    finally:
        capture.release()
