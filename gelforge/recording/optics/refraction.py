"""Rays through a flat port: air, perhaps a pane, then the gel, all with faces across the sensor's z.

Snell's law keeps n sin(angle) along a ray. With the slope t = tan(angle) in air, that in a medium of index n is
t / sqrt(n^2 + (n^2 - 1) t^2), and a ray goes sideways by the sum of thickness times slope.
"""

from __future__ import annotations

import numpy as np

from gelforge.config import Port


def sideways(port: Port, slope: np.ndarray, from_z_mm: float, to_z_mm: np.ndarray) -> np.ndarray:
    """Return how far sideways (...) [mm] a ray of this slope in air goes between two heights [mm]."""
    return sum(h * _slope_in(n, slope) for h, n in _path(port, from_z_mm, to_z_mm))


def air_slope(port: Port, away_mm: np.ndarray, from_z_mm: float, to_z_mm: np.ndarray) -> np.ndarray:
    """Return the slope in air (...) of the ray from from_z_mm to points away_mm (...) aside at to_z_mm (...).

    Newton's method from t = 0: the way sideways is concave in t for n >= 1, so that every step stays below the root.
    """
    path = _path(port, from_z_mm, to_z_mm)
    t = np.zeros_like(away_mm)
    # Newton's method rises from below to the root, in 6 steps at usual slopes
    for _ in range(60):
        miss = away_mm - sum(h * _slope_in(n, t) for h, n in path)
        step = miss / sum(h * n**2 / (n**2 + (n**2 - 1) * t**2) ** 1.5 for h, n in path)
        t = t + step
        if np.all(np.abs(step) <= 1e-15 * (1 + np.abs(t))):
            break
    return t


def _slope_in(n: float, t: np.ndarray) -> np.ndarray:
    return t / np.sqrt(n**2 + (n**2 - 1) * t**2)


def _path(port: Port, from_z_mm: float, to_z_mm: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Return the thickness (...) [mm] and the index of each medium from the camera up to the points."""
    pane = port.z_mm + port.pane_mm
    return [
        (np.minimum(to_z_mm, port.z_mm) - from_z_mm, 1.0),
        (np.clip(to_z_mm, port.z_mm, pane) - port.z_mm, port.pane_index),
        (np.maximum(to_z_mm - pane, 0.0), port.index),
    ]
