"""The virtual camera: particles drawn as shaded balls, far ones first, or flat dots; then blur, light and noise."""

from __future__ import annotations

import cv2
import numba
import numpy as np

from gelforge.config import Camera, VirtualImaging, given
from gelforge.recording.optics.camera import project, px_per_mm

# Share of light that reaches a ball's rim; the lamps stand around the lens, so its middle is brightest. Flow of
# such balls is found to 0.05 px (tests/virtual_lab/test_imaging.py).
AMBIENT = 0.45
# Share of brightness lost from the nearest to the farthest particle.
FADE = 0.35


# the reader's: OpenCV's grey of red, green and blue (ITU-R BT.601)
GREY_OF_RGB = np.array([0.299, 0.587, 0.114])


def picture(
    camera: Camera, imaging: VirtualImaging, centres: np.ndarray, diameter_mm: float, flat: bool = False
) -> np.ndarray:
    """Return what the camera shows, noise-free as `draw`: (H, W) in grey, or (H, W, 3) in blue, green, red."""
    if imaging.particle_rgb is None or imaging.background_rgb is None:  # both or neither
        return draw(camera, imaging, centres, diameter_mm, flat)
    colours = list(zip(imaging.background_rgb, imaging.particle_rgb))[::-1]
    return np.dstack(
        [draw(camera, _with_levels(imaging, *levels), centres, diameter_mm, flat) for levels in colours]
    )


def as_read(imaging: VirtualImaging) -> VirtualImaging:
    """Return the settings of the grey images into which the reader turns those of a camera in colour; its own if grey.

    A picture is linear in the levels of ground and particles, so its grey is that of their grey levels. Noise is that of
    each channel, independent, in the weighted sum. Holds where no channel is saturated.

    Parameters
    ----------
    imaging : VirtualImaging
        Of a camera in grey or colour.

    Returns
    -------
    VirtualImaging
        Without colours, noise in grey levels.
    """
    if imaging.particle_rgb is None:
        return imaging
    grey = _with_levels(
        imaging, *(float(GREY_OF_RGB @ rgb) for rgb in (imaging.background_rgb, imaging.particle_rgb))
    )
    noise = imaging.noise_grey * float(np.linalg.norm(GREY_OF_RGB))
    return grey.model_copy(update={"noise_grey": noise})


def _with_levels(imaging: VirtualImaging, background: float, particle: float) -> VirtualImaging:
    levels = {"background_grey": background, "particle_grey": particle}
    return imaging.model_copy(update=levels | {"background_rgb": None, "particle_rgb": None})


def draw(
    camera: Camera, imaging: VirtualImaging, centres: np.ndarray, diameter_mm: float, flat: bool = False
) -> np.ndarray:
    """Return the noise-free image of balls.

    A ball appears as a disc of radius f d / (2 Z), or as lens and port enlarge it there. Its border is smoothed over one
    pixel (coverage by distance), and it is shaded as a matt ball lit from the camera. Nearer discs cover farther ones.

    Parameters
    ----------
    camera : Camera
        With its pose in the sensor frame.
    imaging : VirtualImaging
        Grey levels, blur, light and focus.
    centres : numpy.ndarray
        (P, 3) [mm] in the sensor frame.
    diameter_mm : float
        Of the balls.
    flat : bool
        Dots of one grey level, however far.

    Returns
    -------
    numpy.ndarray
        (H, W) float32 in grey levels.
    """
    pixels, distance, radius = discs(camera, centres, diameter_mm)
    far_first = np.argsort(-distance, kind="stable")
    fade, ambient = (0.0, 1.0) if flat else (FADE, AMBIENT)
    nearness = (distance.max() - distance) / max(np.ptp(distance), 1e-9)
    contrast = imaging.particle_grey - imaging.background_grey
    brightness = imaging.background_grey + contrast * (1 - fade + fade * nearness)
    image: np.ndarray = np.full(
        (camera.height_px, camera.width_px), imaging.background_grey, dtype=np.float32
    )
    ordered = pixels[far_first], radius[far_first], brightness[far_first]
    if imaging.defocus_px_per_mm > 0:
        image = _out_of_focus(image, ordered, centres[far_first, 2], imaging, ambient)
    else:
        _paint(image, *ordered, ambient)
        if imaging.blur_px > 0:
            image = cv2.GaussianBlur(image, (0, 0), imaging.blur_px)
    if imaging.vignetting or imaging.uneven_light:
        image *= light(image.shape, imaging)
    return image


def discs(
    camera: Camera, centres: np.ndarray, diameter_mm: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return middle (P, 2) [px], distance (P,) [mm] and radius (P,) [px] of the discs that balls at centres (P, 3) show."""
    pixels, distance = project(camera, centres)
    if camera.distortion is None and camera.port is None and camera.focal_y_px is None:
        return pixels, distance, given(camera.focal_px, "camera.focal_px") * diameter_mm / (2 * distance)
    return pixels, distance, px_per_mm(camera, centres) * diameter_mm / 2


def focused(imaging: VirtualImaging, particles: np.ndarray) -> VirtualImaging:
    """Return the settings with the lens set to the mean height of the undeformed particles, unless it is given.

    Parameters
    ----------
    imaging : VirtualImaging
        Stays as it is.
    particles : numpy.ndarray
        (P, 3) [mm] in the sensor frame.

    Returns
    -------
    VirtualImaging
        With `focus_z_mm`, where defocus counts.
    """
    if imaging.focus_z_mm is not None or not imaging.defocus_px_per_mm:
        return imaging
    return imaging.model_copy(update={"focus_z_mm": float(particles[:, 2].mean())})


def light(shape: tuple[int, int], imaging: VirtualImaging) -> np.ndarray:
    """Return the light (H, W) float32 over that in the image's middle: lost to the corners, tilted from left to right."""
    v, u = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    lost = 1 - imaging.vignetting * (u**2 + v**2) / 2
    return (lost * (1 + imaging.uneven_light * u / 2)).astype(np.float32)


def _out_of_focus(
    image: np.ndarray, ordered, z: np.ndarray, imaging: VirtualImaging, ambient: float
) -> np.ndarray:
    """Return the image with discs laid over it slab by slab in the order given, each blurred by its height from the focus.

    ordered: pixels (P, 2), radius (P,), brightness (P,); z (P,) [mm]: their heights. A slab is laid over what is behind it
    by its blurred cover, so that it does not darken its surroundings.
    """
    focus = imaging.focus_z_mm if imaging.focus_z_mm is not None else float(z.mean())
    slabs = 8  # of equal height, in which particles are blurred equally
    slab = np.minimum(((z - z.min()) / max(np.ptp(z), 1e-9) * slabs).astype(int), slabs - 1)
    for number in range(slabs - 1, -1, -1):  # the highest is the farthest
        some = slab == number
        if not some.any():
            continue
        off = imaging.defocus_px_per_mm * (float(z[some].mean()) - focus)
        blur = max(float(np.hypot(imaging.blur_px, off)), 1e-3)
        colour, cover = np.zeros_like(image), np.zeros_like(image)
        pixels, radius, brightness = (part[some] for part in ordered)
        _paint(colour, pixels, radius, brightness, ambient)
        _paint(cover, pixels, radius, np.ones_like(brightness), 1.0)
        image = image * (1 - cv2.GaussianBlur(cover, (0, 0), blur)) + cv2.GaussianBlur(colour, (0, 0), blur)
    return image


@numba.njit(cache=True, nogil=True)
def _paint(image, pixels, radius, brightness, ambient):
    """Paint discs on an image in the given order; ambient: share of their middles' light that their rims have."""
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
                    shade = brightness[p] * (ambient + (1 - ambient) * cosine)
                    image[row, column] += cover * (shade - image[row, column])


def expose(
    image: np.ndarray, imaging: VirtualImaging, rng: np.random.Generator, exposure: float = 1.0
) -> np.ndarray:
    """Return an 8-bit image of a noise-free one, with new sensor noise.

    Parameters
    ----------
    image : numpy.ndarray
        (H, W) or (H, W, 3) in grey levels.
    imaging : VirtualImaging
        Its noise, in grey levels.
    rng : numpy.random.Generator
        Draws the noise.
    exposure : float
        Over the usual one.

    Returns
    -------
    numpy.ndarray
        uint8, of the image's shape.
    """
    bright = image if exposure == 1.0 else image * np.float32(exposure)
    noisy = bright + imaging.noise_grey * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
