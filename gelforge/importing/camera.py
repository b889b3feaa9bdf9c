"""Frames of a video or a folder: when each was taken, how far it differs from the first, and the chosen ones as files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gelforge.config import given
from gelforge.config.foreign.importing import CameraSource
from gelforge.csv_table import read_csv
from gelforge.importing.message_images import message_images
from gelforge.importing.messages import is_bag
from gelforge.importing.refusals import ImportingError, refuse_pickle
from gelforge.importing.streams import refuse_gaps, refuse_other_unit
from gelforge.importing.time_stamps import stamps, units_of
from gelforge.progress import Progress
from gelforge.recording.imaging.flow import grey
from gelforge.recording.imaging.frames import SUFFIXES, decoded, images_in
from gelforge.recording.imaging.images import refuse_turned
from gelforge.units import UNITS, known_unit

# Of decoded frames: a longer film is decoded a second time for the chosen ones (no result depends on it). Both ways
# write equal frames (tests/importing/test_other_sources.py).
KEPT_BYTES = 1_000_000_000


@dataclass(frozen=True)
class Film:
    """Frames with their times since the first [s] and mean absolute difference to it in grey levels."""

    path: Path
    topic: str | None  # of a bag
    names: list[str]
    start_s: float
    time_s: np.ndarray  # (n,)
    change: np.ndarray  # (n,)
    kept: list[np.ndarray] | None  # the frames themselves, where they take less than KEPT_BYTES


def read_film(folder: Path, source: CameraSource) -> Film:
    """Return the times and changes of all frames, and the frames of a film that is not too long."""
    path = folder / given(source.video or source.frames, "camera.video or camera.frames")
    names, container, change, size, first = [], [], [], None, None
    kept: list[np.ndarray] | None = None if path.is_dir() and not is_bag(path) else []
    with Progress("frames", None) as progress:
        for name, stamp, image in _frames(path, source.topic):
            if size is None:
                size = image.shape[1::-1]
            elif image.shape[1::-1] != size:
                raise ImportingError(
                    f"{path}: frame {name} has {image.shape[1]} x {image.shape[0]} px, the first one {size[0]} x {size[1]};"
                    " take away what belongs to another recording"
                )
            small = _small(image)
            first = small if first is None else first
            change.append(float(np.abs(small - first).mean()))
            names.append(name)
            container.append(stamp)
            kept = _with(kept, image)
            progress.advance()
    if len(names) < 20:
        raise ImportingError(f"{path}: {len(names)} frames, at least 20 are needed; name the whole recording")
    time = _times(folder, path, source, names, np.array(container))
    refuse_gaps(path, time, "camera")
    return Film(path, source.topic, names, float(time[0]), time - time[0], np.array(change), kept)


def _with(kept: list[np.ndarray] | None, image: np.ndarray) -> list[np.ndarray] | None:
    """Return the kept frames and this one, None where they would take too much memory."""
    if kept is None or (len(kept) + 1) * image.nbytes > KEPT_BYTES:
        return None
    kept.append(image)
    return kept


def _chosen(film: Film, numbers: set[int]) -> Iterator[tuple[int, np.ndarray]]:
    """Yield these frames, by number from 0 in their order."""
    if film.kept is not None:
        yield from ((number, film.kept[number]) for number in sorted(numbers))
    elif film.path.is_dir() and film.topic is None:
        yield from ((number, _read(film.path / film.names[number])) for number in sorted(numbers))
    else:
        for number, (_, _, image) in enumerate(_frames(film.path, film.topic)):
            if number in numbers:
                yield number, image
            if number >= max(numbers):
                return


def write_frames(film: Film, wanted: dict[int, list[Path]]) -> None:
    """Write frames, by number from 0, as PNG to one or several paths each."""
    for number, image in _chosen(film, set(wanted)):
        for path in wanted[number]:
            if not cv2.imwrite(str(path), image):
                raise ImportingError(f"{path}: not written; make room and run again")


def _read(file: Path) -> np.ndarray:
    refuse_turned(file)
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ImportingError(f"{file}: cannot be decoded as an image; copy it again or take it away")
    return image


def grey_image(file: Path) -> np.ndarray:
    """Return a written frame in grey, for the page.

    Parameters
    ----------
    file : Path
        The image.

    Returns
    -------
    numpy.ndarray
        (H, W).

    Raises
    ------
    ImportingError
        For a file that cannot be decoded.
    """
    return grey(_read(file))


def _frames(path: Path, topic: str | None) -> Iterator[tuple[str, float, np.ndarray]]:
    """Return name, time in the container [s] and image of every frame."""
    refuse_pickle(path, "export the frames as images or as a video")
    if is_bag(path):
        yield from message_images(path, topic, "camera")
        return
    if topic:
        raise ImportingError(f"{path}: no bag or MCAP file, camera.topic does not apply; leave it out")
    if path.is_dir():
        files = images_in(path)
        if not files:
            raise ImportingError(
                f"{path}: no images ({', '.join(sorted(SUFFIXES))}) in this folder; correct camera.frames"
            )
        for file in files:
            yield file.name, float("nan"), _read(file)
        return
    if not path.is_file():
        raise ImportingError(f"{path}: no such video or folder; correct camera.video or camera.frames")
    count = 0
    for count, (stamp, image) in enumerate(decoded(cv2.VideoCapture(str(path))), start=1):
        yield f"{path.name}#{count - 1}", stamp, image
    if not count:
        raise ImportingError(f"{path}: no frame can be decoded; is it a video? Convert it to MP4 or AVI")


def _small(image: np.ndarray) -> np.ndarray:
    small, width = grey(image), 80  # px, to which frames are reduced before they are compared
    if small.shape[1] > width:
        height = max(1, round(width * small.shape[0] / small.shape[1]))
        small = cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA)
    return small.astype(np.float32)


def _times(
    folder: Path, path: Path, source: CameraSource, names: list[str], container: np.ndarray
) -> np.ndarray:
    """Return the times (n,) [s] of frames as the camera's clock shows them."""
    if source.rate_hz:
        return np.arange(len(names)) / source.rate_hz
    if source.container:
        if not (np.diff(container) > 0).all():
            raise ImportingError(
                f"{path}: the video's own stamps do not grow (frame {int((np.diff(container) <= 0).argmax()) + 1}); give"
                " camera.rate_hz, or camera.times with a CSV of stamps"
            )
        return container
    if source.from_name:
        return _times_in_names(path, source, names)
    table_path = folder / given(source.times, "camera.times")
    refuse_pickle(table_path)
    stamp = given(source.time, "camera.time")
    declared = {} if stamp.is_date else units_of(stamp)
    for column, unit in declared.items():
        refuse_other_unit(table_path, column, unit, "camera.time")
    key = {"texts" if stamp.is_date else "numbers": stamp.columns}
    table = read_csv(table_path, **key, form=source.table.csv_form(declared))
    if len(table) != len(names):
        raise ImportingError(
            f"{table_path}: {len(table)} stamps for {len(names)} frames of {path}: frames were dropped when the video was"
            " written, or the stamps are another recording's; give one stamp per frame that is there"
        )
    return stamps(table_path, table, source.time, None, source.even, "camera")


def _times_in_names(path: Path, source: CameraSource, names: list[str]) -> np.ndarray:
    times = np.empty(len(names))
    pattern, factor = given(source.from_name, "camera.from_name"), UNITS[known_unit(source.name_unit)][1]
    for i, name in enumerate(names):
        match = re.search(pattern, name)
        try:
            times[i] = float(match.group(1) if match else "") * factor
        except (ValueError, TypeError):
            raise ImportingError(
                f"{path / name}: camera.from_name {source.from_name!r} finds no number in this name; correct the pattern"
            ) from None
    if not (np.diff(times) > 0).all():
        k = int((np.diff(times) <= 0).argmax())
        raise ImportingError(
            f"{path}: the stamp of {names[k + 1]} is not after that of {names[k]}; name frames so that their order is"
            " that of their stamps"
        )
    return times
