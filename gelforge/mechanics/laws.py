r"""Isotropic hyperelastic laws in principal stretches, and their isochoric forms in three dimensions.

A law gives four functions of the principal stretches; everything else follows from them in one place. With
F_bar = J^(-1/3) F,

.. math::
    W_{iso}(F) = W(\bar\lambda_1, \bar\lambda_2, \bar\lambda_3), \qquad \bar\lambda_i = J^{-1/3} \lambda_i .

These plain NumPy forms are the twin of the compiled finite-element kernel, which is tested against them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

DEVIATOR = np.eye(3) - 1 / 3  # takes the mean off a triple of principal values


class PrincipalLaw(ABC):
    """A strain energy W(lam_1, lam_2, lam_3) [MPa = mJ/mm^3], symmetric in the stretches, for lam_1 lam_2
    lam_3 = 1.

    With e_i = ln lam_i the derivatives are those of the logarithmic strain, where the Kirchhoff stress is
    conjugate.
    """

    @property
    @abstractmethod
    def shear_modulus(self) -> float:
        """Return the shear modulus of the undeformed state [MPa]."""

    @abstractmethod
    def principal_energy(self, lam: np.ndarray) -> np.ndarray:
        """Return W (...) at the stretches lam (..., 3)."""

    @abstractmethod
    def principal_stress(self, lam: np.ndarray) -> np.ndarray:
        """Return the Kirchhoff terms beta_i = lam_i dW/dlam_i (..., 3); a pressure is still free."""

    @abstractmethod
    def principal_tangent(self, lam: np.ndarray) -> np.ndarray:
        """Return d beta_i / d ln lam_j (..., 3, 3)."""

    @abstractmethod
    def principal_slope(self, lam: np.ndarray) -> np.ndarray:
        """Return (beta_i - beta_j) / (ln lam_i - ln lam_j) (..., 3, 3) off the diagonal, its limit for equal
        stretches.

        The diagonal is not used.
        """

    @property
    def youngs_modulus(self) -> float:
        """Return Young's modulus E = 2 (1 + nu) mu of the undeformed state with nu = 1/2 [MPa]."""
        return 3 * self.shear_modulus

    def energy(self, F: np.ndarray) -> np.ndarray:
        """Return the isochoric strain energy density W_iso (...) [MPa] at F (..., 3, 3)."""
        _, lam, _ = _principal(F)
        return self.principal_energy(_isochoric(lam))

    def kirchhoff_stress(self, F: np.ndarray) -> np.ndarray:
        """Return the deviatoric Kirchhoff stress tau = P F^T (..., 3, 3) [MPa]."""
        U, lam, _ = _principal(F)
        tau = self.principal_stress(_isochoric(lam)) @ DEVIATOR  # (..., 3)
        return np.einsum("...ia,...a,...ja->...ij", U, tau, U)

    def nominal_stress(self, F: np.ndarray) -> np.ndarray:
        """Return the first Piola-Kirchhoff stress P = dW_iso/dF (..., 3, 3) [MPa]."""
        U, lam, Vt = _principal(F)
        tau = self.principal_stress(_isochoric(lam)) @ DEVIATOR
        return np.einsum("...ia,...a,...aj->...ij", U, tau / lam, Vt)

    def tangent(self, F: np.ndarray) -> np.ndarray:
        r"""Return A_ijkl = dP_ij/dF_kl = d2W_iso/dF2 (..., 3, 3, 3, 3) [MPa].

        In the principal frames of F, with p_i = tau_i / lam_i (Ogden 1997, sec. 6.1.4; Bonet & Wood 2008,
        sec. 6.6),

        .. math:: A_{iijj} = \partial p_i / \partial\lambda_j, \quad
            A_{ijij} = \frac{\tau_i - \tau_j}{\lambda_i^2 - \lambda_j^2}, \quad
            A_{ijji} = \frac{(\lambda_i^2 + \lambda_j^2) A_{ijij} - \tau_i - \tau_j}{2 \lambda_i \lambda_j}.

        Only A_ijij can lose digits for close stretches; it is the product of two quotients that do not.
        """
        U, lam, Vt = _principal(F)
        lam_bar = _isochoric(lam)
        tau = self.principal_stress(lam_bar) @ DEVIATOR
        tau_e = DEVIATOR @ self.principal_tangent(lam_bar) @ DEVIATOR  # d tau_i / d ln lam_j
        li, lj = lam[..., :, None], lam[..., None, :]
        normal = (tau_e - tau[..., :, None] * np.eye(3)) / (li * lj)
        # (ln li - ln lj) / (li^2 - lj^2) = 1 / (2 li lj sinhc(ln li - ln lj))
        same = self.principal_slope(lam_bar) / (2 * li * lj * _sinhc(np.log(li / lj)))
        cross = ((li**2 + lj**2) * same - tau[..., :, None] - tau[..., None, :]) / (2 * li * lj)

        A = np.zeros(lam.shape[:-1] + (3, 3, 3, 3))  # in the principal frames
        for i in range(3):
            for j in range(3):
                A[..., i, i, j, j] = normal[..., i, j]
        for i, j in ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)):
            A[..., i, j, i, j] = same[..., i, j]
            A[..., i, j, j, i] = cross[..., i, j]
        return np.einsum("...ia,...bj,...kc,...dl,...abcd->...ijkl", U, Vt, U, Vt, A, optimize=True)


@dataclass(frozen=True)
class Ogden(PrincipalLaw):
    r"""Ogden's law in the convention of Sferrazza et al. 2019 (doi 10.1109/ACCESS.2019.2956882), eq. 1.

    .. math::
        W = \sum_k \frac{\mu_k}{\alpha_k}
            (\lambda_1^{\alpha_k} + \lambda_2^{\alpha_k} + \lambda_3^{\alpha_k} - 3)

    The ground-state shear modulus is sum(mu * alpha) / 2 [MPa]; mu_k alpha_k > 0 for every k. (The other
    convention, 2 mu_k / alpha_k^2, has the shear modulus sum(mu): convert with mu_k -> 2 mu_k / alpha_k.)
    """

    mu: tuple[float, ...]  # MPa
    alpha: tuple[float, ...]

    def __post_init__(self):
        object.__setattr__(self, "mu", tuple(float(m) for m in self.mu))
        object.__setattr__(self, "alpha", tuple(float(a) for a in self.alpha))
        if not self.mu or len(self.mu) != len(self.alpha):
            raise ValueError(
                f"Ogden: {len(self.mu)} mu but {len(self.alpha)} alpha; give one alpha per mu, at least one"
            )
        for k, (m, a) in enumerate(zip(self.mu, self.alpha), start=1):
            if not (np.isfinite(m * a) and m * a > 0):
                raise ValueError(
                    f"Ogden: mu_{k} {m} MPa and alpha_{k} {a}; mu_k alpha_k > 0 is needed, give both one sign"
                )

    @property
    def shear_modulus(self) -> float:
        return sum(m * a for m, a in zip(self.mu, self.alpha)) / 2

    def principal_energy(self, lam):
        return sum(m / a * (lam**a - 1).sum(axis=-1) for m, a in zip(self.mu, self.alpha))

    def principal_stress(self, lam):
        return sum(m * lam**a for m, a in zip(self.mu, self.alpha))

    def principal_tangent(self, lam):
        return sum(m * a * lam**a for m, a in zip(self.mu, self.alpha))[..., None] * np.eye(3)

    def principal_slope(self, lam):
        li, lj = lam[..., :, None], lam[..., None, :]
        mean, d = np.sqrt(li * lj), np.log(li / lj)  # li^a - lj^a = 2 mean^a sinh(a d / 2)
        return sum(m * a * mean**a * _sinhc(a * d / 2) for m, a in zip(self.mu, self.alpha))


def _principal(F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return U, lam (..., 3) and V^T of F = U diag(lam) V^T; refuse an inverted point."""
    F = np.asarray(F, dtype=float)
    J = np.linalg.det(F)
    if not (J > 0).all():
        raise ValueError(
            f"det F = {np.min(J):.4g} at the worst of {J.size} points; a law needs det F > 0, halve the step"
        )
    return np.linalg.svd(F)


def _isochoric(lam: np.ndarray) -> np.ndarray:
    """Return J^(-1/3) lam."""
    return lam / np.cbrt(lam.prod(axis=-1, keepdims=True))


def _sinhc(x: np.ndarray) -> np.ndarray:
    """Return sinh(x) / x, 1 at 0."""
    safe = np.where(x == 0, 1.0, x)
    return np.where(x == 0, 1.0, np.sinh(safe) / safe)
