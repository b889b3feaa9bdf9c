"""Ogden's law for FElupe's nearly incompressible solid: isochoric, by principal stretches, written for this proof alone.

With moduli that may differ from point to point, and a stiffening term of Yeoh's kind that has no modulus at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAR = 1e-6  # stretches that differ by less are taken as equal in difference quotients


@dataclass(frozen=True)
class Ogden:
    """W = c sum_k mu_k/alpha_k (sum_a l_a^alpha_k - 3) + c_n (I1 - 3)^n of the isochoric stretches; FElupe's interface.

    The convention is that of Sferrazza et al. 2019, eq. 1; the shear modulus at rest is sum(mu alpha) / 2 [MPa].
    """

    mu: tuple[float, ...]
    alpha: tuple[float, ...]
    factor: np.ndarray | float = 1.0  # c (q, cells)
    stiffening: float = 0.0  # c_n [MPa]
    power: int = 2  # n; a term of Yeoh's series

    def gradient(self, x):
        """Return P = dW/dF (3, 3, q, cells) [MPa], as FElupe asks for it."""
        left, lam, right = _stretches(x[0])
        tau = self._principal(lam)[0]
        P = np.einsum("...ia,...a,...aj->...ij", left, tau / lam, right, optimize=True)
        return [np.moveaxis(P, (-2, -1), (0, 1)), x[-1]]

    def hessian(self, x):
        """Return dP/dF (3, 3, 3, 3, q, cells) [MPa]."""
        left, lam, right = _stretches(x[0])
        tau, H = self._principal(lam)
        A = _principal_tangent(lam, tau, H)  # (..., 9, 9) in the dyads n_a N_b
        Q = np.einsum("...ia,...bj->...ijab", left, right).reshape(*lam.shape[:-1], 9, 9)
        full = Q @ A @ np.swapaxes(Q, -1, -2)
        full = full.reshape(*lam.shape[:-1], 3, 3, 3, 3)
        return [np.ascontiguousarray(np.moveaxis(full, (-4, -3, -2, -1), (0, 1, 2, 3)))]

    def energy(self, F):
        """Return W (q, cells) [MPa] at F (3, 3, q, cells)."""
        lam = _stretches(F)[1]
        bar = lam / np.prod(lam, axis=-1, keepdims=True) ** (1 / 3)
        W = sum(m / a * ((bar**a).sum(-1) - 3) for m, a in zip(self.mu, self.alpha))
        return self.factor * W + self.stiffening * ((bar**2).sum(-1) - 3) ** self.power

    def _principal(self, lam):
        """Return principal Kirchhoff stresses (..., 3) and their slopes H (..., 3, 3) by the stretches' logarithms."""
        bar = lam / np.prod(lam, axis=-1, keepdims=True) ** (1 / 3)
        powers = [bar**a for a in self.alpha]
        c = np.asarray(self.factor)[..., None]
        f = c * sum(m * p for m, p in zip(self.mu, powers))
        g = c * sum(m * a * p for m, a, p in zip(self.mu, self.alpha, powers))
        H = g[..., None] * np.eye(3)
        if self.stiffening:
            b = bar**2
            excess = b.sum(-1, keepdims=True) - 3
            n = self.power
            f = f + 2 * n * self.stiffening * excess ** (n - 1) * b
            both = (n - 1) * b[..., :, None] * b[..., None, :] + (excess * b)[..., None] * np.eye(3)
            H = H + 4 * n * self.stiffening * excess[..., None] ** (n - 2) * both
        deviator = np.eye(3) - 1 / 3
        return f - f.mean(-1, keepdims=True), deviator @ H @ deviator


def _stretches(F):
    """Return n (..., 3, 3) with columns n_a, stretches (..., 3) and N (..., 3, 3) with rows N_a of F = sum l_a n_a N_a."""
    F = np.moveaxis(F, (0, 1), (-2, -1))
    square, right = np.linalg.eigh(np.swapaxes(F, -1, -2) @ F)
    lam = np.sqrt(
        np.maximum(square, 0.0)
    )  # an iterate that has turned an element inside out is refused by Newton's check
    left = (F @ right) / lam[..., None, :]
    return left, lam, np.swapaxes(right, -1, -2)


def _principal_tangent(lam, tau, H):
    """Return dP/dF (..., 9, 9) in the principal dyads, index 3 a + b."""
    P = tau / lam
    normal = (H - tau[..., None] * np.eye(3)) / (lam[..., :, None] * lam[..., None, :])
    A = np.zeros((*lam.shape[:-1], 9, 9))
    for a in range(3):
        for b in range(3):
            A[..., 4 * a, 4 * b] = normal[..., a, b]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        apart = lam[..., a] - lam[..., b]
        equal = np.abs(apart) < NEAR
        difference = np.where(
            equal,
            (normal[..., a, a] + normal[..., b, b]) / 2 - normal[..., a, b],
            (P[..., a] - P[..., b]) / np.where(equal, 1.0, apart),
        )
        mean = (P[..., a] + P[..., b]) / (lam[..., a] + lam[..., b])
        ab, ba = 3 * a + b, 3 * b + a
        A[..., ab, ab] = A[..., ba, ba] = (difference + mean) / 2
        A[..., ab, ba] = A[..., ba, ab] = (difference - mean) / 2
    return A
