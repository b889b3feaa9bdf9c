"""Image files of a dataset's rows, found by its manifest and checked against it."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from gelforge.dataset.schema import DatasetError
from gelforge.files import file_sha256

KEPT = ("PNG", "JPEG")  # others are written anew as PNG, without loss


class RowImages:
    """The images of a dataset's rows by session and file name.

    raw_files: of the manifest, whose paths are as seen from the folder in which the study ran; data: the study's data folder
    where it lies elsewhere.
    """

    def __init__(self, raw_files: list[dict], data: str | Path | None = None):
        self._files: dict[tuple[str, str], tuple[Path, str]] = {}
        for raw in raw_files:
            path = Path(raw["file"])
            if path.parent.name == "images":
                session = path.parent.parent.name
                here = Path(data) / "recordings" / session / "images" / path.name if data else path
                self._files[session, path.name] = here, raw["sha256"]

    def encoded(self, session: str, name: str) -> bytes:
        """Return an image as a PNG or JPEG file's bytes: those of the file itself where it is one.

        Raises DatasetError for an image that is missing or has changed since the dataset was made.
        """
        if (session, name) not in self._files:
            raise DatasetError(
                f"the manifest names no image {name} of session {session}; build the dataset again"
            )
        path, expected = self._files[session, name]
        if not path.is_file():
            raise DatasetError(
                f"{path}: the image is missing; run where the study was run, or name its configuration with --study"
            )
        if file_sha256(path) != expected:
            raise DatasetError(
                f"{path}: the image has changed since the dataset was made; build the dataset again"
            )
        content = path.read_bytes()
        with Image.open(io.BytesIO(content)) as image:
            if image.format in KEPT:
                return content
            again = io.BytesIO()
            image.save(again, "PNG")
            return again.getvalue()

    def shape(self, session: str, name: str) -> tuple[int, int, int]:
        """Return height, width and channels of an image."""
        return pixels(self.encoded(session, name)).shape


def pixels(encoded: bytes) -> np.ndarray:
    """Return the pixels of an encoded image.

    Parameters
    ----------
    encoded : bytes
        Content of a file such as PNG.

    Returns
    -------
    numpy.ndarray
        (H, W, C), C 1 for grey.
    """
    with Image.open(io.BytesIO(encoded)) as image:
        values = np.array(image)
    return values[:, :, None] if values.ndim == 2 else values
