"""Principal stretches of a plane deformation gradient, and the robust fit of the map that it is the gradient of."""

from __future__ import annotations

import numpy as np


def principal_stretches_2d(F: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return lam1, lam2 (..., 2) of F (..., 2, 2) = R U; lam1 is the one whose eigenvector of U is next to direction."""
    lam2, vectors = np.linalg.eigh(np.swapaxes(F, -1, -2) @ F)  # C = U^2
    along = np.abs(np.einsum("...ik,i->...k", vectors, np.asarray(direction, float)))
    lam = np.sqrt(lam2)
    return np.where((along[..., 1] >= along[..., 0])[..., None], lam[..., ::-1], lam)


def leading_direction(F: np.ndarray) -> np.ndarray:
    """Return the unit vector (2,) of the first frame along which |ln lam| is largest."""
    lam2, vectors = np.linalg.eigh(F.T @ F)
    return vectors[:, int(np.argmax(np.abs(np.log(lam2))))]


def robust_fit(A: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return coefficients (t, 2), their variances (t, 2) and weights (n,) of A c = x by Tukey's biweight.

    A (n, t), x (n, 2). Scale by the median absolute deviation, 4.685 of it as limit (95 % efficiency, Huber 1981).
    """
    weight = np.ones(len(A))
    for _ in range(8):
        root = np.sqrt(weight)[:, None]
        c, *_ = np.linalg.lstsq(root * A, root * x, rcond=None)
        r = np.linalg.norm(x - A @ c, axis=1)
        scale = max(np.median(r) / 1.177, 1e-3)  # median of a Rayleigh distribution: 1.177 sigma
        weight = np.clip(1 - (r / (4.685 * scale)) ** 2, 0, None) ** 2
    freedom = max(weight.sum() - A.shape[1], 1.0)
    variance = (weight[:, None] * (x - A @ c) ** 2).sum(0) / freedom
    inverse = np.linalg.pinv((weight[:, None] * A).T @ A)
    return c, np.diag(inverse)[:, None] * variance, weight
