"""Where an indentation was, in the image: the centre from which its flow expands."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

# Centres of drawn presses: `python benchmarks/cameras.py`:
# of the profiles over the radius; how far they reach, as a share of the image's smaller side
KNOTS, REACH = 7, 0.5
# The largest flow of a block that says where it is. Seven times what the best flow errs by, 0.043 px
# (tests/recording/test_flow.py).
LEAST_PX = 0.3


def centre_of_expansion(flow: np.ndarray, vanishing_px: np.ndarray | None) -> np.ndarray | None:
    """Return the pixel (2,) around which a flow (H, W, 2) [px] of one indentation is symmetric; None for hardly any flow.

    An indentation moves the gel aside and down by the distance r from its axis. Aside is seen along the pixel's offset from
    the centre c, down along that from the vanishing point e of the sensor's z axis (None: parallel rays, down is not seen):

        flow(p) = A(r) (p - c) + H(r) (p - e),   r = |p - c|

    A and H are piecewise linear and eliminated; c is found by least squares. The centroid of the squared flow, from which
    it starts, is drawn away from e by the part that goes down.
    """
    points, mean = _blocks(flow)
    squares = (mean**2).sum(axis=1)
    if squares.max() < LEAST_PX**2:
        return None
    reach = REACH * min(flow.shape[:2])
    near = squares > 0.25 * squares.max()  # far from the indentation noise has no direction, and much area
    start = squares[near] @ points[near] / squares[near].sum()

    def left(c: np.ndarray) -> np.ndarray:
        design = _design(points, c, vanishing_px, reach)
        solution = np.linalg.lstsq(design, mean.ravel(), rcond=1e-8)[0]
        return design @ solution - mean.ravel()

    return least_squares(left, start, diff_step=1e-4, x_scale=reach, max_nfev=30).x


def _blocks(flow: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the middles (B, 2) [px] and the mean flow (B, 2) of square blocks; a rest at the border is left out."""
    side = max(1, max(flow.shape[:2]) // 40)
    rows, columns = flow.shape[0] // side, flow.shape[1] // side
    trimmed = flow[: rows * side, : columns * side].reshape(rows, side, columns, side, 2)
    u, v = np.meshgrid(np.arange(columns), np.arange(rows))
    middles = (np.stack([u, v], -1).reshape(-1, 2) + 0.5) * side - 0.5
    return middles, trimmed.mean(axis=(1, 3)).reshape(-1, 2).astype(float)


def _design(points: np.ndarray, c: np.ndarray, e: np.ndarray | None, reach: float) -> np.ndarray:
    """Return the columns (2 B, KNOTS or 2 KNOTS) that A and H multiply; both are 0 from the reach on."""
    r = np.linalg.norm(points - c, axis=1)
    knots = np.linspace(0, reach, KNOTS + 1)[:-1]
    hats = np.maximum(0.0, 1 - np.abs(r[:, None] - knots) * KNOTS / reach)  # (B, KNOTS)
    parts = [points - c] if e is None else [points - c, points - e]
    return np.concatenate([(hats[:, None] * part[:, :, None]).reshape(-1, KNOTS) for part in parts], axis=1)
