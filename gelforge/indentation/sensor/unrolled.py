"""Where a point of a sensor's surface lies in the rectangle of its bins, and back.

Bins are equal rectangles of width_x_mm x width_y_mm. Seen from above (`bins.over: plan`) the rectangle is the one around
the sensor: a bin on the flank of a dome then holds more surface than one at its top, and those in the corners hold none.
Unrolled (`bins.over: surface`) a dome's surface fills the rectangle with equal areas: every bin holds the same.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gelforge.config import Sensor

# Of the table over which a dome's area is summed: 1e-6 of the rectangle, by its curvature
# (tests/indentation/test_unrolled.py).
DIRECTIONS = 2049


def unrolled(sensor: Sensor, points: np.ndarray) -> np.ndarray:
    """Return the places (..., 2) [mm] in the rectangle of the bins of points (..., 3) [mm] of the undeformed surface.

    Of a dome: the half-ellipsoid's parameters, rho = sin(phi) and theta, to a disc by equal areas, r^2 = share of the area
    along the ray that is nearer the top, and the disc to the square by equal areas (Shirley & Chiu 1997,
    doi 10.1080/10867651.1997.10487479). The mirror planes of the dome are those of the square.
    """
    if not is_unrolled(sensor):
        return points[..., :2]
    a, b, c = _axes(sensor)
    x, y = points[..., 0] / a - 1, points[..., 1] / b - 1
    # by direction: well conditioned at the rim
    phi = np.arctan2(np.hypot(x, y), np.clip(1 + points[..., 2] / c, 0, None))
    theta = np.arctan2(y, x)
    k = _steepness(theta, (a, b, c))
    r = np.sqrt(np.clip(_area_of_ray(np.cos(phi), k) / _area_of_ray(0.0, k), 0, 1))
    turned, share = _directions((a, b, c))
    return (_to_square(r, np.interp(theta, turned, share)) + 1) * [a, b]


def bin_points(sensor: Sensor) -> np.ndarray:
    """Return the bins' centres on the undeformed surface.

    Outside a dome's ellipse, where bins seen from above carry no force, z is that of its rim.

    Parameters
    ----------
    sensor : Sensor
        Its shape and bins.

    Returns
    -------
    numpy.ndarray
        (B, 3) [mm] in the sensor frame, bin k = nx iy + ix; z is 0 on a surface from files.
    """
    bins, widths = sensor.bins, np.array([sensor.width_x_mm, sensor.width_y_mm])
    iy, ix = np.divmod(np.arange(bins.nx * bins.ny), bins.nx)
    return rolled(sensor, np.column_stack([ix + 0.5, iy + 0.5]) * widths / [bins.nx, bins.ny])


def rolled(sensor: Sensor, places: np.ndarray) -> np.ndarray:
    """Return the points of the undeformed surface at places in the rectangle of the bins.

    Parameters
    ----------
    sensor : Sensor
        Its shape and bins.
    places : numpy.ndarray
        (..., 2) [mm].

    Returns
    -------
    numpy.ndarray
        (..., 3) [mm] in the sensor frame; z is 0 unless the sensor is a dome.
    """
    if sensor.shape.kind != "dome":
        return np.concatenate([places, np.zeros((*places.shape[:-1], 1))], axis=-1)
    a, b, c = _axes(sensor)
    from_middle = places / [a, b] - 1
    if not is_unrolled(sensor):
        away = np.clip(1 - (from_middle**2).sum(axis=-1), 0, None)
        return np.concatenate([places, c * (np.sqrt(away) - 1)[..., None]], axis=-1)
    r, turn = _from_square(from_middle)
    turned, share = _directions((a, b, c))
    theta = np.interp(turn, share, turned)
    k = _steepness(theta, (a, b, c))
    wanted, low, high = r**2 * _area_of_ray(0.0, k), np.zeros_like(r), np.full_like(r, np.pi / 2)
    # until the angle is known to pi / 2^46 = 4.5e-14
    for _ in range(45):
        middle = (low + high) / 2
        beyond = _area_of_ray(np.cos(middle), k) > wanted
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    phi = (low + high) / 2
    x, y = np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta)
    return np.stack([a * (1 + x), b * (1 + y), c * (np.cos(phi) - 1)], axis=-1)


def place_in_bins(sensor: Sensor, x_mm: float, y_mm: float) -> tuple[float, float]:
    """Return where in the rectangle of the bins a point of the surface lies.

    Parameters
    ----------
    sensor : Sensor
        Its shape and bins.
    x_mm, y_mm : float
        Position in the sensor frame, seen from above.

    Returns
    -------
    (float, float)
        [mm] from the corner of the rectangle.
    """
    if not is_unrolled(sensor):
        return x_mm, y_mm
    a, b, c = _axes(sensor)
    height = c * (np.sqrt(max(1 - (x_mm / a - 1) ** 2 - (y_mm / b - 1) ** 2, 0.0)) - 1)
    u, v = unrolled(sensor, np.array([x_mm, y_mm, height]))
    return float(u), float(v)


def is_unrolled(sensor: Sensor) -> bool:
    """Return whether the bins are another grid than the one seen from above.

    Parameters
    ----------
    sensor : Sensor
        Its shape and bins.

    Returns
    -------
    bool
        True for a dome whose bins lie over its surface.
    """
    return sensor.bins.over == "surface" and sensor.shape.kind == "dome"


def _axes(sensor: Sensor) -> tuple[float, float, float]:
    return sensor.width_x_mm / 2, sensor.width_y_mm / 2, sensor.height_mm


def _steepness(theta: np.ndarray, axes: tuple[float, float, float]) -> np.ndarray:
    """Return k of the area a b sin(phi) sqrt(cos(phi)^2 + k sin(phi)^2) dphi dtheta of a half-ellipsoid."""
    a, b, c = axes
    return c**2 * (np.cos(theta) ** 2 / a**2 + np.sin(theta) ** 2 / b**2)


def _area_of_ray(w: np.ndarray | float, k: np.ndarray) -> np.ndarray:
    """Return the area along a ray from the top to where cos(phi) = w, over a b dtheta.

    The integral of sqrt(k + (1 - k) v^2) over v from w to 1; for k near 1, a sphere, by the first terms of its series.
    """

    def up_to(v):
        m = np.abs(1 - k)
        root = np.sqrt(np.where(m < 1e-4, 1.0, m))
        z = v * root / np.sqrt(k)
        bent = np.where(k < 1, np.arcsinh(z), np.arcsin(np.clip(z, -1, 1)))
        exact = v / 2 * np.sqrt(np.clip(k + (1 - k) * v**2, 0, None)) + k / (2 * root) * bent
        series = v * np.sqrt(k) * (1 + (1 - k) * v**2 / (6 * k))
        return np.where(m < 1e-4, series, exact)

    return up_to(np.ones_like(k)) - up_to(w)


@lru_cache(maxsize=4)
def _directions(axes: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return directions theta from -pi to pi, and the angles, over the same range, that share the area equally."""
    theta = np.linspace(-np.pi, np.pi, DIRECTIONS)
    area = _area_of_ray(0.0, _steepness(theta, axes))
    summed = np.concatenate([[0.0], np.cumsum((area[1:] + area[:-1]) / 2)])
    return theta, np.pi * (2 * summed / summed[-1] - 1)


def _to_square(r: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return places (..., 2) in the square from -1 to 1 of a disc's polar coordinates, by equal areas."""
    side = np.rint(angle / (np.pi / 2))  # of the square: right 0, up 1, left 2 or -2, down -1
    off = (angle - side * np.pi / 2) * 4 / np.pi * r
    turn = side.astype(int) % 4
    x = np.choose(turn, [r, -off, -r, off])
    y = np.choose(turn, [off, r, -off, -r])
    return np.stack([x, y], axis=-1)


def _from_square(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the radius and the angle in the disc of places (..., 2) in the square from -1 to 1."""
    x, y = places[..., 0], places[..., 1]
    upright = np.abs(y) > np.abs(x)
    r = np.where(upright, np.abs(y), np.abs(x))
    along = np.divide(np.where(upright, x, y), r, out=np.zeros_like(r), where=r > 0) * np.pi / 4
    in_half = np.where(x >= 0, along, np.pi - along)
    above = np.where(y >= 0, np.pi / 2 - along, along - np.pi / 2)
    angle = np.where(upright, above, in_half)
    return r, np.where(angle > np.pi, angle - 2 * np.pi, angle)
