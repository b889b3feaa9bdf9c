"""Radius of curvature at the apex of an inflated membrane from its silhouette in a side view.

The outline is found column by column where the picture crosses the level between background and membrane, then once
more along its normals, to a fraction of a pixel. Near the apex a surface of revolution is a conic,
    (x - x0)^2 + k (y - y0)^2 = 2 r (y - y0),
with the apex at (x0, y0), y down, and its radius of curvature r: k = 1 is a circle, k > 0 an ellipse, 0 a parabola.
r enters the equibiaxial stress p r / (2 h0 lam3) in proportion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import least_squares

# Radii of drawn caps and ellipses are found, through blur and dust too (tests/materials/test_apex_shape.py):
STEEPEST_DEG = 60.0  # of the outline that is fitted: beyond it the cap's own shape differs most from a conic
LOWEST_SHARE = 0.3  # of the apex's height over the clamp: keeps off the clamp's rounded edge
# Height s of the fitted arc: its radius is c^2 / (8 s), so 0.1 px of systematic error is 1.2 % of it. Membranes stretched
# by 0.2 % are refused (tests/materials/test_apex_shape.py).
LEAST_SAGITTA_PX = 8.0
# Columns with an outline, and points near the apex: a needle of 10 columns is refused (tests/materials/test_apex_shape.py).
LEAST_POINTS = 20
# Six times noise of 4 grey levels, under which a blurred membrane is found; an even picture is refused
# (tests/materials/test_apex_shape.py).
LEAST_CONTRAST_GREY = 25.0
# Standard errors by which k must differ from 1 for the conic to replace the circle: 1 in 370 by chance. Circles stay
# circles, ellipses are found (tests/materials/test_apex_shape.py).
SIGNIFICANT = 3.0


class SilhouetteError(ValueError):
    """A side view without a usable outline: what was found, the limit, the remedy."""


@dataclass(frozen=True)
class ApexShape:
    """The apex of a membrane in one side view."""

    radius_mm: float  # of the conic where the outline is significantly no circle, else of the circle
    standard_error_mm: float
    circle_radius_mm: float
    conic_constant: float  # k, 1 for a circle
    apex_px: tuple[float, float]  # x, y
    rms_px: float  # distance of the outline's points from the curve


def apex_shape(picture: np.ndarray, mm_per_px: float) -> ApexShape:
    """Return the radius of curvature and the place of the apex of an inflated membrane.

    Parameters
    ----------
    picture : numpy.ndarray
        (rows, columns) grey levels of a side view, the membrane bulging upwards.
    mm_per_px : float
        Scale of the picture.

    Returns
    -------
    ApexShape
        Radius with its standard error [mm], apex [px] and error of the outline [px].

    Raises
    ------
    SilhouetteError
        Where there is no outline, or it is too flat to have a radius.
    """
    picture = np.asarray(picture, float)
    smooth = gaussian_filter(picture, 1.0)
    outline = _column_outline(smooth)  # (n, 2)
    base = float(outline[:, 1].max())
    apex = float(np.percentile(outline[:, 1], 1))
    for _ in range(2):  # the second time along the normals of the first curve
        near = _near_apex(outline, base, apex)
        curve, *_ = _fit_with_errors(near, _circle_through(near), free_k=False)
        outline = _normal_outline(smooth, near, curve)
    near = _near_apex(outline, base, curve[1])
    circle, circle_errors, circle_rms = _fit_with_errors(near, curve, free_k=False)
    conic, errors, conic_rms = _fit_with_errors(near, curve, free_k=True)
    no_circle = abs(conic[3] - 1) > SIGNIFICANT * errors[3]
    chosen, error, rms = (
        (conic, errors[2], conic_rms) if no_circle else (circle, circle_errors[2], circle_rms)
    )
    return ApexShape(
        chosen[2] * mm_per_px,
        float(error * mm_per_px),
        circle[2] * mm_per_px,
        float(conic[3]),
        (float(chosen[0]), float(chosen[1])),
        rms,
    )


def flat_row_px(picture: np.ndarray) -> float:
    """Return the row y [px] of the membrane before inflation: the apex's height is counted from it."""
    outline = _column_outline(gaussian_filter(np.asarray(picture, float), 1.0))
    middle = np.abs(outline[:, 0] - np.median(outline[:, 0])) < len(outline) / 4
    return float(np.median(outline[middle, 1]))


def _column_outline(smooth: np.ndarray) -> np.ndarray:
    """Return the points (n, 2) x, y at which each column, from the top, first crosses the middle level."""
    background = float(np.median(smooth[: max(3, len(smooth) // 40)]))
    object_level = float(
        np.median(smooth[-max(3, len(smooth) // 40) :, smooth.shape[1] // 3 : -smooth.shape[1] // 3])
    )
    contrast = object_level - background
    if abs(contrast) < LEAST_CONTRAST_GREY:
        raise SilhouetteError(
            f"background and membrane differ by {abs(contrast):.0f} grey levels; {LEAST_CONTRAST_GREY:g} at least are"
            " needed: light the screen behind the membrane; the top of the picture must be background, the middle of"
            " its bottom membrane or clamp"
        )
    share = (smooth - background) / contrast  # 0 outside, 1 inside
    inside = share > 0.5
    columns = np.flatnonzero(inside.any(0) & ~inside[0])
    if len(columns) < LEAST_POINTS:
        raise SilhouetteError(f"{len(columns)} columns show an outline; {LEAST_POINTS} at least are needed")
    row = inside.argmax(0)[columns]
    above, below = share[row - 1, columns], share[row, columns]
    return np.stack([columns, row - 1 + (0.5 - above) / (below - above)], axis=-1)


def _near_apex(outline: np.ndarray, base: float, apex: float) -> np.ndarray:
    """Return the points of the outline high enough over the clamp; SilhouetteError if they are no arc."""
    near = outline[outline[:, 1] < base - LOWEST_SHARE * (base - apex)]
    sagitta = float(np.ptp(near[:, 1])) if len(near) else 0.0
    if len(near) < LEAST_POINTS or sagitta < LEAST_SAGITTA_PX:
        raise SilhouetteError(
            f"the outline near the apex has {len(near)} points and is {sagitta:.1f} px high; {LEAST_POINTS} points and"
            f" {LEAST_SAGITTA_PX:g} px are needed: the membrane is too flat to have a radius"
        )
    return near


def _normal_outline(smooth: np.ndarray, points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Return the points (n, 2) moved along the curve's normals to the middle level of their own profile."""
    gradient = _gradient(curve, points)
    normal = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)  # outwards
    normal = normal[steep := np.abs(normal[:, 1]) > np.cos(np.radians(STEEPEST_DEG))]
    points = points[steep] - _distance(curve, points[steep])[:, None] * normal  # on the curve
    s = np.arange(-8, 8 + 0.25, 0.25)
    at = points[:, None] + s[:, None] * normal[:, None]  # (n, profile, 2)
    profile = map_coordinates(smooth, [at[..., 1], at[..., 0]], order=3, mode="nearest")
    inside, outside = profile[:, s < -4].mean(1), profile[:, s > 4].mean(1)
    share = (profile - inside[:, None]) / (outside - inside)[:, None]
    crossing = (share[:, :-1] < 0.5) & (share[:, 1:] >= 0.5)
    distance = np.where(crossing, np.abs(s[:-1] + 0.125), np.inf)
    k = distance.argmin(1)
    rows = np.arange(len(k))
    step = (0.5 - share[rows, k]) / (share[rows, k + 1] - share[rows, k])
    crosses = np.isfinite(distance.min(1)) & (np.abs(outside - inside) > LEAST_CONTRAST_GREY)
    return (points + (s[k] + 0.25 * step)[:, None] * normal)[crosses]


def _value(curve: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (x - x0)^2 + k (y - y0)^2 - 2 r (y - y0) [px^2]: positive outside."""
    x0, y0, r, k = curve
    x, y = points[:, 0] - x0, points[:, 1] - y0
    return x**2 + k * y**2 - 2 * r * y


def _gradient(curve: np.ndarray, points: np.ndarray) -> np.ndarray:
    x0, y0, r, k = curve
    return 2 * np.stack([points[:, 0] - x0, k * (points[:, 1] - y0) - r], axis=-1)


def _distance(curve: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the signed distance (n,) [px] to first order (Sampson 1982)."""
    return _value(curve, points) / np.linalg.norm(_gradient(curve, points), axis=1)


def _circle_through(points: np.ndarray) -> np.ndarray:
    """Return x0, y0, r, k = 1 of the circle through points (algebraic: Kasa 1976), a start for the fits."""
    x, y = points.T
    (b, c, d), *_ = np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], axis=-1), -(x**2 + y**2), rcond=None)
    r = np.sqrt(max(b**2 / 4 + c**2 / 4 - d, 1e-6))
    return np.array([-b / 2, -c / 2 - r, r, 1.0])


def _fit_with_errors(
    points: np.ndarray, start: np.ndarray, free_k: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return x0, y0, r, k, their standard errors (4,) and the rms distance [px]; robust against dust (soft L1)."""
    number = 4 if free_k else 3

    def distance(free):
        return _distance(np.concatenate([free, start[number:]]), points)

    scale = np.array([1.0, 1.0, start[2], 1.0])[:number]
    fit = least_squares(distance, start[:number], x_scale=scale, loss="soft_l1", f_scale=0.3)
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    # errors of neighbouring columns go together: smoothing and blur reach about three of them
    freedom = max(len(points) / 3.0 - number, 1.0)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * rms**2 * len(points) / freedom
    errors = np.zeros(4)
    errors[:number] = np.sqrt(np.diag(covariance))
    return np.concatenate([fit.x, start[number:]]), errors, rms
