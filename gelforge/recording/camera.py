"""Where a point of the sensor appears in the image: a pinhole or a flat scale, looking up from below the gel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from gelforge.config import Camera


class CameraError(ValueError):
    """A point that the camera cannot see: what was found, what to do."""


def image_axes(camera: Camera) -> np.ndarray:
    """Return the directions (3, 3) of u, v and the view in the sensor frame, one per row.

    Looking up with the sensor's y upwards in the image, x runs to the left; a mirrored image runs with x.
    """
    upright = np.diag([1.0 if camera.mirrored else -1.0, -1.0, 1.0])
    # extrinsic turns about the sensor's fixed x, y, z axes, in this order
    turned = Rotation.from_euler("xyz", camera.rotation_deg, degrees=True).as_matrix()
    return upright @ turned.T


def project(camera: Camera, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels (..., 2), as (u right, v down), of points (..., 3) [mm] and their distances (...) [mm].

    u = centre_u + f X / Z, v = centre_v + f Y / Z with X, Y, Z along `image_axes` from the pinhole; the distance is Z.
    A flat scale has u = centre_u + X / mm_per_px. Raises CameraError for points behind a pinhole.
    """
    local = (np.asarray(points, dtype=float) - camera.position_mm) @ image_axes(camera).T
    distance = local[..., 2]
    if camera.mm_per_px is not None:
        return np.asarray(camera.centre_px) + local[..., :2] / camera.mm_per_px, distance
    if distance.size and distance.min() <= 0:
        raise CameraError(
            f"a point lies {-distance.min():.3g} mm behind the camera at {camera.position_mm} mm; "
            "z is 0 at the top surface and negative below: lower camera.position_mm"
        )
    return np.asarray(camera.centre_px) + camera.focal_px * local[..., :2] / distance[..., None], distance


def unproject(camera: Camera, pixels: ArrayLike, z_mm: float) -> np.ndarray:
    """Return the points (..., 3) [mm] of the plane z = z_mm that appear at pixels (..., 2)."""
    axes = image_axes(camera)
    offset = np.asarray(pixels, dtype=float) - camera.centre_px
    if camera.mm_per_px is not None:
        start = np.asarray(camera.position_mm) + (offset * camera.mm_per_px) @ axes[:2]
        ray = np.broadcast_to(axes[2], start.shape)
    else:
        start = np.broadcast_to(np.asarray(camera.position_mm), (*offset.shape[:-1], 3))
        ray = (offset / camera.focal_px) @ axes[:2] + axes[2]
    return start + ((z_mm - start[..., 2]) / ray[..., 2])[..., None] * ray
