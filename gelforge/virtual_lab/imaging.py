"""The virtual camera: particles drawn as shaded balls, far ones first, then the optics' blur and the sensor's noise."""

from __future__ import annotations

import cv2
import numba
import numpy as np

from gelforge.config import Camera, VirtualImaging
from gelforge.recording.camera import project

AMBIENT = 0.45  # share of light that reaches a ball's rim; the lamps stand around the lens, so its middle is brightest
FADE = 0.35  # share of brightness lost from the nearest to the farthest particle


def draw(camera: Camera, imaging: VirtualImaging, centres: np.ndarray, diameter_mm: float) -> np.ndarray:
    """Return the noise-free image (H, W) float32 in grey levels of balls at centres (P, 3) [mm] in the sensor frame.

    A ball appears as a disc of radius f d / (2 Z) whose border is smoothed over one pixel (coverage by distance), shaded
    as a matt ball lit from the camera; nearer discs cover farther ones.
    """
    pixels, distance = project(camera, centres)
    far_first = np.argsort(-distance, kind="stable")
    radius = camera.focal_px * diameter_mm / (2 * distance)
    nearness = (distance.max() - distance) / max(np.ptp(distance), 1e-9)
    contrast = imaging.particle_grey - imaging.background_grey
    brightness = imaging.background_grey + contrast * (1 - FADE + FADE * nearness)
    image = np.full((camera.height_px, camera.width_px), imaging.background_grey, dtype=np.float32)
    _paint(image, pixels[far_first], radius[far_first], brightness[far_first])
    if imaging.blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), imaging.blur_px)
    return image


@numba.njit(cache=True, nogil=True)
def _paint(image, pixels, radius, brightness):
    """Paint discs on an image in the given order."""
    height, width = image.shape
    for p in range(len(radius)):
        u, v, r = pixels[p, 0], pixels[p, 1], radius[p]
        top, bottom = max(0, int(np.ceil(v - r - 0.5))), min(height - 1, int(np.floor(v + r + 0.5)))
        left, right = max(0, int(np.ceil(u - r - 0.5))), min(width - 1, int(np.floor(u + r + 0.5)))
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                square = (row - v) ** 2 + (column - u) ** 2
                cover = min(1.0, r + 0.5 - np.sqrt(square))
                if cover > 0:
                    cosine = np.sqrt(max(0.0, 1 - square / (r * r)))
                    shade = brightness[p] * (AMBIENT + (1 - AMBIENT) * cosine)
                    image[row, column] += cover * (shade - image[row, column])


def expose(image: np.ndarray, imaging: VirtualImaging, rng: np.random.Generator) -> np.ndarray:
    """Return an 8-bit image (H, W) of a noise-free one, with new sensor noise."""
    noisy = image + imaging.noise_grey * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
