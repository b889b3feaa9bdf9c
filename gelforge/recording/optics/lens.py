"""What a lens does to rays: OpenCV's two distortions and their inverses, on normalised coordinates x = X / Z, y = Y / Z.

Pinhole (Brown 1966, as OpenCV orders it), r^2 = x^2 + y^2:

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

Fisheye (Kannala and Brandt 2006, doi:10.1109/TPAMI.2006.153), theta = atan r:

    (x', y') = (x, y) theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) / r

A polynomial may turn back at some radius, beyond which far points would appear inside the image again. There it is
continued in proportion to the radius, so that such points stay outside.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gelforge.config import Distortion

# Of a normalised coordinate: 1e-10 px at a focal length of 1000 px. There and back is exact to rounding
# (tests/recording/test_camera.py).
CLOSE = 1e-13


class CameraError(ValueError):
    """A point that the camera cannot see: what was found, what to do."""


def distort(lens: Distortion, xy: np.ndarray) -> np.ndarray:
    """Return where rays xy (..., 2) appear (..., 2), both normalised."""
    return _pinhole(lens, xy)[0] if lens.model == "pinhole" else _fisheye(lens, xy)


def undistort(lens: Distortion, seen: np.ndarray) -> np.ndarray:
    """Return the rays (..., 2) that appear at seen (..., 2), to rounding.

    Raises CameraError where the lens shows no ray or its polynomial has turned back.
    """
    return _pinhole_inverse(lens, seen) if lens.model == "pinhole" else _fisheye_inverse(lens, seen)


def turning_point(lens: Distortion) -> float:
    """Return the radius (pinhole) or the angle [rad] (fisheye) at which the radial polynomial turns back; inf for none."""
    return _turning_point(lens.model, tuple(lens.coefficients))


@lru_cache(maxsize=32)
def _turning_point(model: str, coefficients: tuple[float, ...]) -> float:
    radial = _radial(model, coefficients)
    slope = [(2 * n + 1) * k for n, k in enumerate((1.0, *radial))]  # of r^(2 n), in s = r^2
    roots = np.roots(slope[::-1])
    real = roots[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else np.inf


def _radial(model: str, coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Return the coefficients of r^2, r^4, ... or theta^2, theta^4, ..."""
    if model == "fisheye":
        return coefficients
    return (coefficients[0], coefficients[1], *coefficients[4:])


def _factor(lens: Distortion, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return 1 + k1 r^2 + ... (...) and its derivative to r^2, constant from the turning point on."""
    turn = turning_point(lens)
    s = np.minimum(radius, turn) ** 2
    polynomial = (1.0, *_radial(lens.model, tuple(lens.coefficients)))
    slope = [n * k for n, k in enumerate(polynomial)][1:]
    factor, by_s = np.polyval(polynomial[::-1], s), np.polyval(slope[::-1], s)
    return factor, np.where(radius < turn, by_s, 0.0)


def _pinhole(lens: Distortion, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where rays appear (..., 2) and the derivatives (..., 2, 2) to x and y."""
    x, y = xy[..., 0], xy[..., 1]
    p1, p2 = lens.coefficients[2:4]
    s = x * x + y * y
    factor, by_s = _factor(lens, np.sqrt(s))
    u = x * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    v = y * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    u_x = factor + 2 * x * x * by_s + 2 * p1 * y + 6 * p2 * x
    v_y = factor + 2 * y * y * by_s + 6 * p1 * y + 2 * p2 * x
    cross = 2 * x * y * by_s + 2 * p1 * x + 2 * p2 * y
    return np.stack([u, v], -1), np.stack([np.stack([u_x, cross], -1), np.stack([cross, v_y], -1)], -2)


def _pinhole_inverse(lens: Distortion, seen: np.ndarray) -> np.ndarray:
    xy = seen.copy()
    with np.errstate(all="ignore"):  # what runs away is refused below
        for _ in range(50):  # 5 suffice for a lens in use
            at, J = _pinhole(lens, xy)
            miss = seen - at
            det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] ** 2
            xy = xy + np.stack(
                [
                    J[..., 1, 1] * miss[..., 0] - J[..., 0, 1] * miss[..., 1],
                    J[..., 0, 0] * miss[..., 1] - J[..., 0, 1] * miss[..., 0],
                ],
                -1,
            ) / np.where(det == 0, np.nan, det)[..., None]  # fmt: skip
            if np.all(np.abs(miss) < CLOSE):
                break
        off = np.abs(_pinhole(lens, xy)[0] - seen).max(axis=-1, initial=0.0)
        radius = np.linalg.norm(xy, axis=-1)
    _refuse(~(off < 1e-9) | (radius > turning_point(lens)), seen, lens)
    return xy


def _fisheye(lens: Distortion, xy: np.ndarray) -> np.ndarray:
    r = np.linalg.norm(xy, axis=-1)
    theta = np.arctan(r)
    small = r < 1e-12
    return xy * (np.where(small, 1.0, theta * _factor(lens, theta)[0]) / np.where(small, 1.0, r))[..., None]


def _fisheye_inverse(lens: Distortion, seen: np.ndarray) -> np.ndarray:
    radius = np.linalg.norm(seen, axis=-1)
    theta = radius.copy()
    with np.errstate(all="ignore"):
        for _ in range(50):  # 5 suffice for a lens in use
            factor, by_s = _factor(lens, theta)
            miss = radius - theta * factor
            theta = theta + miss / (factor + 2 * theta**2 * by_s)
            if np.all(np.abs(miss) < CLOSE):
                break
        off = np.abs(theta * _factor(lens, theta)[0] - radius)
    limit = min(turning_point(lens), np.pi / 2 - 1e-6)
    _refuse(~(off < 1e-9) | (theta < 0) | (theta > limit), seen, lens)
    small = radius < 1e-12
    return seen * (np.where(small, 1.0, np.tan(theta)) / np.where(small, 1.0, radius))[..., None]


def _refuse(wrong: np.ndarray, seen: np.ndarray, lens: Distortion) -> None:
    if np.any(wrong):
        x, y = seen[wrong].reshape(-1, 2)[0]
        turn = turning_point(lens)
        limit = "" if np.isinf(turn) else f", its polynomial turns back at {turn:.3g}"
        raise CameraError(
            f"the lens (model {lens.model}, coefficients {list(lens.coefficients)}) shows no ray at {np.hypot(x, y):.3g} "
            f"focal lengths from the principal point{limit}; calibrate with corners near the image's border"
        )
