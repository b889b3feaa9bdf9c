"""Some of many points, spread out."""

from __future__ import annotations

import numpy as np


def spread_out(points: np.ndarray, most: int, first: int = 0) -> np.ndarray:
    """Return the numbers, in order, of at most so many points (S, 2): the first, then always the farthest from them."""
    chosen = [first]
    away = np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < min(most, len(points)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.sort(chosen)
