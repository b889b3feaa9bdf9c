"""Nodal forces to bins of the undeformed surface, and what that does to their moment."""

from __future__ import annotations

import numpy as np

ZERO_N = 1e-9  # smaller forces are stored as exact zeros: the sparse RMSE counts entries that are not zero


def hat_shares(lines: np.ndarray, width: float, n: int) -> np.ndarray:
    """Return the share (n, len(lines)) of each line's hat function that lies in each of n equal bins of [0, width].

    The integral of the hat over the bin divided by its whole integral; columns sum to 1.
    """
    edges = np.linspace(0, width, n + 1)
    points = np.unique(np.concatenate([lines, edges]))
    mid = (points[1:] + points[:-1]) / 2
    inside = (mid > lines[0]) & (mid < lines[-1])
    mid, size = mid[inside], np.diff(points)[inside]
    # Hats are linear on every piece between neighbouring points: the value at the middle integrates them exactly.
    hats = np.stack([np.interp(mid, lines, unit) for unit in np.eye(len(lines))])  # (lines, pieces)
    owner = np.clip((mid / width * n).astype(int), 0, n - 1)
    shares = np.zeros((n, len(lines)))
    np.add.at(shares, owner, (hats * size).T)
    return shares / shares.sum(axis=0)


def node_shares(lines: np.ndarray, width: float, n: int) -> np.ndarray:
    """Return shares (n, len(lines)) of the paper's rule: all to the node's bin, a node on an edge to both equally."""
    position = lines / width * n
    shares = np.zeros((n, len(lines)))
    nearest = np.rint(position)
    on_edge = np.abs(position - nearest) < 1e-9
    for line, (p, edge) in enumerate(zip(position, on_edge)):
        right = round(p) if edge else int(np.floor(p))
        bins = [k for k in ({right - 1, right} if edge else {right}) if 0 <= k < n]
        shares[bins, line] = 1 / len(bins)
    return shares


def bin_forces(forces: np.ndarray, shares_x: np.ndarray, shares_y: np.ndarray) -> np.ndarray:
    """Return bin forces (..., ny*nx, 3), k = nx iy + ix, of surface forces (..., S, 3) with x fastest."""
    ny_lines, nx_lines = shares_y.shape[1], shares_x.shape[1]
    grid = forces.reshape(*forces.shape[:-2], ny_lines, nx_lines, 3)
    binned = np.einsum("bj,...jik->...bik", shares_y, grid)
    binned = np.einsum("ai,...bik->...bak", shares_x, binned)
    # The number of bins is given: reshape cannot infer it where no depth converged.
    return binned.reshape(*forces.shape[:-2], len(shares_y) * len(shares_x), 3)


def bin_centres(width_x: float, width_y: float, nx: int, ny: int) -> np.ndarray:
    """Return the centres (ny*nx, 2) [mm] of the bins, k = nx iy + ix."""
    y, x = np.meshgrid(
        (np.arange(ny) + 0.5) * width_y / ny, (np.arange(nx) + 0.5) * width_x / nx, indexing="ij"
    )
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def without_dust(forces: np.ndarray) -> np.ndarray:
    """Return the forces with components below ZERO_N replaced by exact zeros."""
    return np.where(np.abs(forces) < ZERO_N, 0.0, forces)
