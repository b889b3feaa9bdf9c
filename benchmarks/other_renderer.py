"""A renderer other than the virtual lab's: soft specks of many sizes, in uneven light, behind a lens that distorts.

The analysis draws balls of one diameter, matt and lit from the camera, nearer ones before farther ones. Here specks are
blobs that add up until the sensor is saturated, as in a gel that glows; each has a size and a brightness of its own.
"""

from __future__ import annotations

from unittest.mock import patch

import numpy as np

from gelforge.config import Camera, VirtualImaging
from gelforge.recording.optics.camera import project, px_per_mm

SIZES = 0.3  # standard deviation of the logarithm of a speck's size
DIMMEST = 0.5  # of the brightest speck
# A radial error of the lens that the session does not state, at the image's corner: what a calibration leaves.
DISTORTION = 0.004
CORNERS, TILT = 0.25, 0.2  # light lost in the corners, and gained and lost at the sides
REACH = 3  # standard deviations of a blob that are painted


def picture(camera: Camera, imaging: VirtualImaging, centres: np.ndarray, diameter_mm: float) -> np.ndarray:
    """Return the noise-free image (H, W) in grey levels of specks at centres (P, 3) [mm], always in the same order."""
    rng = np.random.default_rng(len(centres))
    size = np.exp(SIZES * rng.standard_normal(len(centres)))
    bright = rng.uniform(DIMMEST, 1.0, len(centres))
    pixels, _ = project(camera, centres)
    shape = np.array([camera.width_px, camera.height_px])
    middle = (shape - 1) / 2
    away = pixels - middle
    pixels = middle + away * (1 + DISTORTION * np.sum(away**2, axis=1, keepdims=True) / np.sum(middle**2))
    sigma = np.hypot(px_per_mm(camera, centres) * diameter_mm / 4 * size, imaging.blur_px)
    glow = _glow(pixels, sigma, bright, tuple(shape))
    v, u = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape[::-1]), indexing="ij")
    light = (1 - CORNERS * (u**2 + v**2) / 2) * (1 + TILT * v)
    contrast = imaging.particle_grey - imaging.background_grey
    return ((imaging.background_grey + contrast * (1 - np.exp(-glow))) * light).astype(np.float32)


def _glow(pixels: np.ndarray, sigma: np.ndarray, bright: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the sum (H, W) of Gaussian blobs of a height at pixels (P, 2), by which the sensor is exposed."""
    glow, reach = np.zeros(shape[::-1]), int(np.ceil(REACH * sigma.max()))
    first = np.round(pixels).astype(int)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            u, v = (first + [i, j]).T
            inside = (u >= 0) & (u < shape[0]) & (v >= 0) & (v < shape[1])
            square = (u - pixels[:, 0]) ** 2 + (v - pixels[:, 1]) ** 2
            height = bright * np.exp(-square / (2 * sigma**2))
            np.add.at(glow, (v[inside], u[inside]), 2 * height[inside])
    return glow


def instead_of_the_virtual_labs():
    """Return a context in which sessions are drawn by this renderer."""
    return patch("gelforge.virtual_lab.session.picture", picture)
