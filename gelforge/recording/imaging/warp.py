"""Images and fields read where a motion leads, and images moved by a motion."""

from __future__ import annotations

import cv2
import numpy as np


def read_along(
    values: np.ndarray,
    flow: np.ndarray,
    interpolation: int = cv2.INTER_LINEAR,
    border: int = cv2.BORDER_REPLICATE,
) -> np.ndarray:
    """Return values (H, W[, 2]) at the places to which each pixel's flow (H, W, 2) [px] leads."""
    v, u = np.mgrid[: flow.shape[0], : flow.shape[1]].astype(np.float32)
    at = u + flow[..., 0], v + flow[..., 1]
    return np.asarray(cv2.remap(values, *at, interpolation, borderMode=border))


def warped(picture: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Return a picture in which what was at a pixel is moved by the field there.

    Parameters
    ----------
    picture : numpy.ndarray
        (H, W).
    field : numpy.ndarray
        (H, W, 2) float32 [px].

    Returns
    -------
    numpy.ndarray
        (H, W) float32.
    """
    back = np.zeros_like(field)  # from where a pixel's content comes: back(q) = -field(q + back(q))
    # the fixed point contracts by the strain in the image, at most 0.3: to 0.3^6 < 1e-3 of the motion
    for _ in range(6):
        back = -read_along(field, back)
    return read_along(picture.astype(np.float32), back, cv2.INTER_CUBIC, cv2.BORDER_REFLECT)


def enlarged(cells: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return a field given for equal cells of an image at each of its pixels, by cubic interpolation.

    Parameters
    ----------
    cells : numpy.ndarray
        (R, C, 2).
    width, height : int
        Of the image [px].

    Returns
    -------
    numpy.ndarray
        (height, width, 2) float32, in the unit of the cells.
    """
    return np.asarray(cv2.resize(cells.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC))
