"""The discretisation error bar of a verdict's nominal forces: wider than that of a label, and the same share at all depths.

Sideways forces err by their wall and skin, which a mesh of twice the sizes does not show: the default mesh is 3 to 4 % off
(docs/accuracy.md), and FElupe's sideways forces differ by up to 12 %, 7 % root mean square from 0.8 mm on
(python -m validation.checks.between_codes --bases concealed --sizes 0.3 0.6).
"""

from __future__ import annotations

import numpy as np

PART = 0.3  # of the difference to the coarser mesh, root mean square over depths
CROSS = 0.04  # of the vertical difference, on horizontal forces: near a wall they lean on it
SIDEWAYS = 0.05  # of a sideways force itself: 1 / sqrt(2) of the two codes' difference
LEAST = 1e-3  # of the largest force: below it the indenter is about to leave


def base_bars(total: np.ndarray, coarse: np.ndarray, sideways: float = SIDEWAYS) -> np.ndarray:
    """Return the error bars (D, 3) [N] of forces (D, 3) of a loading by those on a coarser mesh; sideways: a share of them.

    Where the indenter has all but left the gel there is nothing to be a share of: the difference itself stands beside it.
    """
    size = np.linalg.norm(total, axis=1, keepdims=True)
    difference = total - coarse
    carries = (size > LEAST * size.max()).ravel()
    x, y, z = ((difference[carries] / size[carries]) ** 2).sum(axis=0) / max(carries.sum(), 1)
    horizontal = np.sqrt(PART**2 * (x + y) / 2 + CROSS**2 * z)
    sigma = np.array([horizontal, horizontal, PART * np.sqrt(z)]) * size
    sigma = np.hypot(sigma, sideways * np.abs(total) * [1.0, 1.0, 0.0])
    return np.where(carries[:, None], sigma, np.maximum(sigma, PART * np.abs(difference)))
