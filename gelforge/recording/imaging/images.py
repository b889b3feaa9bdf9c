"""Checks of a session's image files from their headers, without decoding them."""

from __future__ import annotations

import os
from pathlib import Path

import pandas as pd
from PIL import Image, UnidentifiedImageError

from gelforge.config import Session
from gelforge.input_files import NotAFile, regular_file
from gelforge.recording.tables.checks import RecordingError

# the tag Orientation (TIFF 6.0, 1992), as in EXIF; a phone or camera sets it by how it is held
ORIENTATION = 0x0112
PNG_END = b"IEND\xaeB`\x82"  # the last chunk's name and checksum; a truncated PNG lacks it
JPEG_END, JPEG_TAIL = b"\xff\xd9", 4096  # the marker EOI (ITU-T T.81, 1992); cameras pad what follows


def image_path(folder: str | Path, name: str) -> Path:
    """Return the path of a session's image.

    Parameters
    ----------
    folder : str or Path
        The session's folder.
    name : str
        As the column `image` of indentations.csv names it.

    Returns
    -------
    Path
        <folder>/images/<name>, whether it exists or not.
    """
    return Path(folder) / "images" / name


def reference_path(folder: str | Path) -> Path:
    """Return the path of a session's zero-force frame.

    Parameters
    ----------
    folder : str or Path
        The session's folder.

    Returns
    -------
    Path
        <folder>/reference.png, whether it exists or not.
    """
    return Path(folder) / "reference.png"


def check_images(folder: Path, images: pd.Series, session: Session) -> None:
    """Raise RecordingError unless the reference frame and all named images exist, are whole and have one size.

    images holds file names in folder/images, "" where a reading has none; its index is the line of indentations.csv. A
    recording without images needs no reference frame.
    """
    named = images[images != ""]
    if named.empty:
        return
    table = folder / "indentations.csv"
    reference = folder / "reference.png"
    if not reference.is_file():
        raise RecordingError(
            f"{reference}: the reference frame is missing; save the image at zero force there"
        )
    if named.duplicated().any():
        line = named.index[named.duplicated()][0]
        raise RecordingError(
            f"{table}, row {line}: image {named[line]} is named twice; every reading has its own image"
        )
    size = image_size(reference)
    if session.camera and size != (session.camera.width_px, session.camera.height_px):
        raise RecordingError(
            f"{reference}: {size[0]} x {size[1]} px, but session.yaml has a camera of "
            f"{session.camera.width_px} x "
            f"{session.camera.height_px} px; correct camera.width_px and height_px"
        )
    present = set(os.listdir(folder / "images")) if (folder / "images").is_dir() else set()
    for line, name in named.items():
        if name not in present:
            raise RecordingError(
                f"{table}, row {line}: image {name} is not in {folder / 'images'}; copy it there"
            )
        pixels = image_size(folder / "images" / name)
        if pixels != size:
            raise RecordingError(
                f"{folder / 'images' / name}: {pixels[0]} x {pixels[1]} px, but the reference frame has "
                f"{size[0]} x {size[1]} "
                "px; record both with the same camera settings"
            )


def image_size(path: Path) -> tuple[int, int]:
    """Return width and height [px] from an image's header. Raises RecordingError if it is no image or was cut short."""
    try:
        regular_file(path)
    except NotAFile as error:
        raise RecordingError(str(error)) from None
    try:
        with open(path, "rb") as file:
            with Image.open(file) as image:
                size, kind = image.size, image.format
                _refuse_turned(path, image)
            if kind == "PNG":
                file.seek(-len(PNG_END), os.SEEK_END)
                if file.read() != PNG_END:
                    raise RecordingError(f"{path}: the PNG was cut short; copy it again")
            if kind == "JPEG":
                file.seek(-min(JPEG_TAIL, os.fstat(file.fileno()).st_size), os.SEEK_END)
                if JPEG_END not in file.read():  # a decoder fills the missing part with grey and says nothing
                    raise RecordingError(f"{path}: the JPEG was cut short; copy it again")
    except (UnidentifiedImageError, OSError) as error:
        raise RecordingError(f"{path}: not a readable image ({error}); copy it again") from None
    return size


def refuse_turned(path: Path) -> None:
    """Refuse an image whose EXIF orientation says that it is to be shown turned or mirrored.

    Parameters
    ----------
    path : Path
        The image; one that cannot be decoded passes here.

    Raises
    ------
    RecordingError
        Names the image and the orientation.
    """
    try:
        with Image.open(path) as image:
            _refuse_turned(path, image)
    except (UnidentifiedImageError, OSError):  # refused where it is decoded
        return


def _refuse_turned(path: Path, image: Image.Image) -> None:
    if image.format == "PNG" and "exif" not in image.info:
        return  # to look for it the whole file would be decoded
    turned = image.getexif().get(ORIENTATION, 1)
    if turned not in (0, 1):  # 0: not known
        raise RecordingError(
            f"{path}: EXIF orientation {turned}, so that programs show its pixels turned or mirrored, 1 is needed; save all"
            " frames upright without it (exiftool -Orientation#=1 keeps the pixels as they are)"
        )
