"""The discretisation error bar of a verdict's nominal forces: wider than that of a label, and the same share at all depths.

The sets on which verdicts were judged had these bars (docs/validation.md).
"""

from __future__ import annotations

import numpy as np

PART = 0.3  # of the difference to the coarser mesh, root mean square over depths
CROSS = 0.04  # of the vertical difference, on horizontal forces: near a wall they lean on it
LEAST = 1e-3  # of the largest force: below it the indenter is about to leave


def base_bars(total: np.ndarray, coarse: np.ndarray) -> np.ndarray:
    """Return the error bars (D, 3) [N] of forces (D, 3) of a loading by those on a coarser mesh.

    Where the indenter has all but left the gel there is nothing to be a share of: the difference itself stands beside it.
    """
    size = np.linalg.norm(total, axis=1, keepdims=True)
    difference = total - coarse
    carries = (size > LEAST * size.max()).ravel()
    x, y, z = ((difference[carries] / size[carries]) ** 2).sum(axis=0) / max(carries.sum(), 1)
    horizontal = np.sqrt(PART**2 * (x + y) / 2 + CROSS**2 * z)
    sigma = np.array([horizontal, horizontal, PART * np.sqrt(z)]) * size
    return np.where(carries[:, None], sigma, np.maximum(sigma, PART * np.abs(difference)))
