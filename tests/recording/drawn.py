"""Images of printed dots and of speckle, drawn here and moved by known fields, for tests of the flow."""

import cv2
import numpy as np

SIZE = (160, 208)  # H, W [px]
MIDDLE = (104, 80)  # u, v


def dots(spacing=30, radius=3.0, size=SIZE):
    """Return printed dots on a smooth, unevenly lit ground: places (N, 2), radii, grey levels, ground (H, W)."""
    v, u = np.mgrid[spacing : size[0] - spacing // 2 : spacing, spacing : size[1] - spacing // 2 : spacing]
    at = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    ground = np.tile(150 + 20 * np.sin(np.arange(size[1]) / 45), (size[0], 1))
    return at, np.full(len(at), radius), np.full(len(at), 40.0), ground


def speckle(seed=5, size=SIZE):
    """Return bright particles at random on a dark ground, as `dots` does."""
    rng = np.random.default_rng(seed)
    count = int(0.0225 * (size[0] + 80) * (size[1] + 80))
    at = np.column_stack([rng.uniform(-40, size[1] + 40, count), rng.uniform(-40, size[0] + 40, count)])
    return at, rng.uniform(1.0, 2.2, count), rng.uniform(140, 240, count), np.full(size, 60.0)


def still(points):
    return np.zeros_like(points)


def outward(peak_px, middle=MIDDLE, width_px=45):
    """Return a field: points (N, 2) -> displacement (N, 2), outwards, largest at width_px from the middle."""

    def field(points):
        away = np.asarray(points, float) - middle
        r = np.linalg.norm(away, axis=-1, keepdims=True)
        return away / width_px * peak_px * np.exp(0.5 - 0.5 * (r / width_px) ** 2)

    return field


def along(peak_px, middle=MIDDLE, width_px=60):
    """Return a field of displacements to the right, largest at the middle."""

    def field(points):
        r = np.linalg.norm(np.asarray(points, float) - middle, axis=-1, keepdims=True)
        return np.array([peak_px, 0.0]) * np.exp(-0.5 * (r / width_px) ** 2)

    return field


def photograph(pattern, field=still, seed=0, noise=2.0, gain=1.0):
    """Return the image (H, W) uint8 of a pattern moved by a field, with new noise; gain: a number or an image."""
    points, radii, greys, ground = pattern
    image = ground.astype(np.float32).copy()
    at, sizes = (np.rint(16 * a).astype(int).tolist() for a in (points + field(points), np.asarray(radii)))
    for middle, radius, grey in zip(at, sizes, map(float, greys)):
        cv2.circle(image, middle, radius, grey, -1, cv2.LINE_8, 4)
    image = cv2.GaussianBlur(image, (0, 0), 0.8) * gain
    return np.clip(
        np.rint(image + noise * np.random.default_rng(seed).standard_normal(image.shape)), 0, 255
    ).astype(np.uint8)


def everywhere(field, size):
    """Return a field at every pixel (H, W, 2)."""
    v, u = np.mgrid[: size[0], : size[1]]
    return field(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(*size, 2)
