"""Optical flow between the reference frame and an image, in pixels: u to the right, v down."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from gelforge.input_files import what_it_is
from gelforge.recording.imaging.texture import Texture

NO_GUESS = np.empty(0, np.float32)  # of the flow, that a search could begin at
PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "fine": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "full": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}
# Half (1) instead of quarter resolution, without smoothing afterwards: particles are 3 to 5 px wide. Measured: the error of
# a region's mean falls to a third of `fast`, near that of `medium`, at less than half of its time (limits:
# tests/recording/test_flow.py). On an image reduced to half `full` searches the pixels that `fine` makes of the whole one,
# and leaves the flow there: a quarter to fill in and to average.
FINEST_SCALE = {"fine": 1, "full": 0}


# Below it OpenCV changes the patch size from one call to the next, and an image's flow depends on those before it.
# Smaller images are refused (tests/recording/test_features.py).
SMALLEST_PX = 96


class ImageError(ValueError):
    """An image that cannot be used: which, what was found, what to do."""


def read_grey(path: str | Path, crop_px: list[int] | None = None) -> np.ndarray:
    """Return an image file as grey levels.

    Parameters
    ----------
    path : str or Path
        PNG, TIFF, BMP or JPEG.
    crop_px : list of int, optional
        Left, top, width and height [px] of the part to keep.

    Returns
    -------
    numpy.ndarray
        (H, W) uint8.

    Raises
    ------
    ImageError
        For a file that is missing, cannot be decoded or is no image, and for a crop that reaches beyond it.
    """
    path = Path(path)
    what = what_it_is(path)
    if what and not what.startswith("an image"):
        one = (
            f" (one frame of a video: ffmpeg -i {path.name} -frames:v 1 frame.png)" if "video" in what else ""
        )
        raise ImageError(f"{path}: is {what}, an image is needed; name a PNG, TIFF, BMP or JPEG{one}")
    if not path.is_file():
        raise ImageError(f"{path}: the image is missing; copy it again or correct its name")
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ImageError(f"{path}: cannot be decoded, it may be truncated; copy it again")
    return crop(image, crop_px)


def grey(image: np.ndarray) -> np.ndarray:
    """Return a frame as grey levels.

    Parameters
    ----------
    image : numpy.ndarray
        (H, W), or (H, W, 3) as blue, green, red.

    Returns
    -------
    numpy.ndarray
        (H, W) uint8; the frame itself where it has one channel.
    """
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image


def crop(image: np.ndarray, crop_px: list[int] | None) -> np.ndarray:
    """Return a part of an image.

    Parameters
    ----------
    image : numpy.ndarray
        (H, W) or (H, W, 3).
    crop_px : list of int or None
        Left, top, width and height [px]; None for all of it.

    Returns
    -------
    numpy.ndarray
        (height, width), contiguous.

    Raises
    ------
    ImageError
        For a part that reaches beyond the image.
    """
    if crop_px is None:
        return image
    left, top, width, height = crop_px
    if top + height > image.shape[0] or left + width > image.shape[1]:
        raise ImageError(
            f"crop_px {crop_px} reaches beyond the image of {image.shape[1]} x {image.shape[0]} px; "
            "correct session.yaml"
        )
    return np.ascontiguousarray(image[top : top + height, left : left + width])


def reduced(image: np.ndarray, scale: float) -> np.ndarray:
    """Return an image reduced to a share of its size.

    Pixel i shows the place (i + 0.5) / scale - 0.5 [px] along both axes, whatever the rounding: lengths are those of the
    image times scale. Down to half the size it is read between pixels, as `Remapper` does, in a fifth of the time of means
    over areas. Below that it is such a mean.

    Parameters
    ----------
    image : numpy.ndarray
        (H, W).
    scale : float
        Above 0, at most 1.

    Returns
    -------
    numpy.ndarray
        (scale H, scale W), rounded, of the type of the image; the image itself for 1.
    """
    if scale == 1:
        return image
    how = cv2.INTER_LINEAR if scale >= 0.5 else cv2.INTER_AREA
    return cv2.resize(image, None, fx=scale, fy=scale, interpolation=how)


class Flow:
    """Dense Inverse Search (Kroeger et al. 2016, doi:10.1007/978-3-319-46493-0_29) against one reference frame.

    Not shared between threads: the search keeps buffers.
    """

    def __init__(self, reference: np.ndarray, preset: str):
        if min(reference.shape) < SMALLEST_PX:
            raise ImageError(
                f"image of {reference.shape[1]} x {reference.shape[0]} px is smaller than {SMALLEST_PX} px; "
                "the flow needs a larger image, crop_px or features.image_scale"
            )
        self.reference = reference
        self.search = cv2.DISOpticalFlow.create(PRESETS[preset])
        if preset in FINEST_SCALE:
            self.search.setFinestScale(FINEST_SCALE[preset])
            self.search.setVariationalRefinementIterations(0)
        # the finest patches, in pixels of the image
        self.patch_px = self.search.getPatchSize() << self.search.getFinestScale()
        self.texture = Texture(reference, self.patch_px)

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Return the displacement (H, W, 2) [px] float32 from the reference to an image (H, W) uint8.

        Where the reference shows no texture it is that of the texture around (see `texture`). Raises ImageError for an image
        of another size, and for a reference frame that shows no texture at all.
        """
        if image.shape != self.reference.shape:
            raise ImageError(
                f"image of {image.shape[1]} x {image.shape[0]} px, but the reference frame has "
                f"{self.reference.shape[1]} x {self.reference.shape[0]} px; record both with the same "
                "camera settings"
            )
        if self.texture.nowhere:
            raise ImageError(
                f"the reference frame shows no texture that flow could follow: mean {self.reference.mean():.1f}, standard "
                f"deviation {self.reference.std():.1f} grey levels; record it anew with light and focus as in the images"
            )
        return self.texture.fill(self.search.calc(self.reference, image, NO_GUESS))

    def backward(self, image: np.ndarray) -> np.ndarray:
        """Return the displacement (H, W, 2) [px] float32 from an image (H, W) to the reference, as the search finds it."""
        return self.search.calc(image, self.reference, NO_GUESS)
