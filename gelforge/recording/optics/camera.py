"""Where a point of the sensor appears in the image: pinhole or flat scale, lens and port, looking up from below."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from gelforge.config import Camera, given
from gelforge.recording.optics.lens import CameraError, distort, undistort
from gelforge.recording.optics.refraction import air_slope, sideways

__all__ = ["CameraError", "image_axes", "mm_per_px_at", "project", "px_per_mm", "unproject"]


def image_axes(camera: Camera) -> np.ndarray:
    """Return the directions of u, v and the view in the sensor frame.

    Looking up with the sensor's y upwards in the image, x runs to the left; a mirrored image runs with x.

    Parameters
    ----------
    camera : Camera
        `rotation_deg` turns about the sensor's fixed x, y and z, in this order.

    Returns
    -------
    numpy.ndarray
        (3, 3), one unit vector per row.
    """
    upright = np.diag([1.0 if camera.mirrored else -1.0, -1.0, 1.0])
    # extrinsic turns about the sensor's fixed x, y, z axes, in this order
    turned = Rotation.from_euler("xyz", camera.rotation_deg, degrees=True).as_matrix()
    return upright @ turned.T


def project(camera: Camera, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels at which points appear, and their distances.

    u = centre_u + f_u x, v = centre_v + f_v y, where (x, y) = (X, Y) / Z as the lens distorts it. X, Y, Z run along
    `image_axes` from the pinhole, of the ray that the port bends towards it. A flat scale has u = centre_u + X /
    mm_per_px.

    Parameters
    ----------
    camera : Camera
        With its pose in the sensor frame.
    points : array_like
        (..., 3) [mm] in the sensor frame.

    Returns
    -------
    numpy.ndarray
        (..., 2) [px] as u to the right, v down; (0, 0) is the middle of the top left pixel.
    numpy.ndarray
        (...) [mm] distance Z of each point along the view.

    Raises
    ------
    CameraError
        For points behind a pinhole.
    """
    offset = np.asarray(points, dtype=float) - camera.position_mm
    axes = image_axes(camera)
    local = offset @ axes.T
    distance = local[..., 2]
    if camera.mm_per_px is not None:
        return np.asarray(camera.centre_px) + local[..., :2] / camera.mm_per_px, distance
    if distance.size and distance.min() <= 0:
        raise CameraError(
            f"a point lies {-distance.min():.3g} mm behind the camera at {camera.position_mm} mm; "
            "z is 0 at the top surface and negative below: lower camera.position_mm"
        )
    ray = local if camera.port is None else _towards(camera, offset) @ axes.T
    if camera.distortion is None:
        seen = camera.focals_px * ray[..., :2] / ray[..., 2][..., None]
    else:
        seen = camera.focals_px * distort(camera.distortion, ray[..., :2] / ray[..., 2][..., None])
    return np.asarray(camera.centre_px) + seen, distance


def unproject(camera: Camera, pixels: ArrayLike, z_mm: float) -> np.ndarray:
    """Return the points of a horizontal plane that appear at pixels.

    Parameters
    ----------
    camera : Camera
        With its pose in the sensor frame.
    pixels : array_like
        (..., 2) [px] as u to the right, v down.
    z_mm : float
        Height of the plane in the sensor frame; 0 is the top surface, negative is below.

    Returns
    -------
    numpy.ndarray
        (..., 3) [mm] in the sensor frame.

    Raises
    ------
    CameraError
        For a pixel at which the lens shows no ray, or whose ray does not rise to the plane.
    """
    axes = image_axes(camera)
    offset = np.asarray(pixels, dtype=float) - camera.centre_px
    if camera.mm_per_px is not None:
        start = np.asarray(camera.position_mm) + (offset * camera.mm_per_px) @ axes[:2]
        ray = np.broadcast_to(axes[2], start.shape)
    else:
        start = np.broadcast_to(np.asarray(camera.position_mm), (*offset.shape[:-1], 3))
        seen = offset / given(camera.focals_px, "camera.focal_px")
        if camera.distortion is not None:
            seen = undistort(camera.distortion, seen)
        ray = seen @ axes[:2] + axes[2]
    if camera.port is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (z_mm - start[..., 2]) / ray[..., 2]
        if camera.mm_per_px is None and not (np.isfinite(reach) & (reach > 0)).all():
            raise CameraError(
                f"the plane z = {z_mm:g} mm lies behind the camera at {camera.position_mm} mm, or along what it sees "
                f"(rotation_deg {camera.rotation_deg}); z is 0 at the top surface and negative below: correct its pose"
            )
        return start + reach[..., None] * ray
    if ray[..., 2].min(initial=1.0) <= 0:
        raise CameraError(
            f"a pixel looks down or along the port (rotation_deg {camera.rotation_deg}); correct the camera's pose"
        )
    slope = np.linalg.norm(ray[..., :2], axis=-1) / ray[..., 2]
    away = sideways(camera.port, slope, camera.position_mm[2], np.full(slope.shape, float(z_mm)))
    reach = np.where(slope > 0, away / np.where(slope > 0, slope, 1.0), 0.0) / ray[..., 2]
    return np.concatenate(
        [start[..., :2] + reach[..., None] * ray[..., :2], np.full((*slope.shape, 1), float(z_mm))], -1
    )


def _towards(camera: Camera, offset: np.ndarray) -> np.ndarray:
    """Return the directions (..., 3), in the sensor frame, in which the pinhole sees points at offset (..., 3) [mm]."""
    z = camera.position_mm[2]
    away = np.linalg.norm(offset[..., :2], axis=-1)
    slope = air_slope(given(camera.port, "camera.port"), away, z, z + offset[..., 2])
    flat = np.where(away > 0, slope / np.where(away > 0, away, 1.0), 0.0)
    return np.concatenate([offset[..., :2] * flat[..., None], np.ones((*away.shape, 1))], -1)


def px_per_mm(camera: Camera, points: ArrayLike) -> np.ndarray:
    """Return the scale of the image at points, for lengths across the view.

    It is the root of the ratio of areas, by central differences of 0.01 mm along the image's axes.

    Parameters
    ----------
    camera : Camera
        With its pose in the sensor frame.
    points : array_like
        (..., 3) [mm] in the sensor frame.

    Returns
    -------
    numpy.ndarray
        (...) [px/mm].

    Raises
    ------
    CameraError
        For points behind a pinhole.
    """
    points, h = np.asarray(points, dtype=float), 0.01
    along = [
        (project(camera, points + h * axis)[0] - project(camera, points - h * axis)[0]) / (2 * h)
        for axis in image_axes(camera)[:2]
    ]
    return np.sqrt(np.abs(along[0][..., 0] * along[1][..., 1] - along[0][..., 1] * along[1][..., 0]))


def mm_per_px_at(camera: Camera, z_mm: float) -> float:
    """Return the length that a pixel in the image's middle covers on a horizontal plane.

    It is the root of the ratio of areas: one number for u and v.

    Parameters
    ----------
    camera : Camera
        With its pose in the sensor frame.
    z_mm : float
        Height of the plane in the sensor frame.

    Returns
    -------
    float
        [mm].

    Raises
    ------
    CameraError
        Where the middle of the image does not show the plane.
    """
    middle = np.array([(camera.width_px - 1) / 2, (camera.height_px - 1) / 2])
    corners = unproject(camera, middle + [[-1, 0], [1, 0], [0, -1], [0, 1]], z_mm)[:, :2]
    (a, b), (c, d) = (corners[1] - corners[0]) / 2, (corners[3] - corners[2]) / 2
    return float(np.sqrt(abs(a * d - b * c)))
