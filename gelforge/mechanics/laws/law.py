r"""Isotropic hyperelastic laws in principal stretches, and their isochoric forms in three dimensions.

A law gives four functions of the principal stretches; everything else follows from them in one place. With
F_bar = J^(-1/3) F,

.. math::
    W_{iso}(F) = W(\bar\lambda_1, \bar\lambda_2, \bar\lambda_3), \qquad \bar\lambda_i = J^{-1/3} \lambda_i .

These plain NumPy forms are the twins of the compiled point routines (`points`), which are tested against them. The laws are
in `models`, one file each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

DEVIATOR = np.eye(3) - 1 / 3  # takes the mean off a triple of principal values
# Beyond this share of a limiting extension stress and slope of the compiled routines stay what they are there: finite
# numbers for an iterate that is never accepted. A state so close to the limit has 10^4 times the modulus at rest
# (tests/mechanics/test_kernels.py).
NEAREST_LIMIT = 1 - 1e-4


@dataclass(frozen=True)
class PrincipalLaw(ABC):
    """A strain energy W(lam_1, lam_2, lam_3) [MPa = mJ/mm^3], symmetric in the stretches, for lam_1 lam_2
    lam_3 = 1.

    With e_i = ln lam_i the derivatives are those of the logarithmic strain, where the Kirchhoff stress is
    conjugate.
    """

    name: ClassVar[str]  # in files and configurations
    # The routine of one point: a plain function of numbers, which Numba compiles into the element loops (`points`).
    # point(constants, lam) returns W, beta (3,), gamma (6,) and the extension over its limit at the isochoric stretches lam
    # (3,). It may branch by the constants but not by lam, which are those of several elements (`lanes`). That of a law
    # of the invariants is in InvariantLaw.
    point: ClassVar[Callable[..., Any]]

    @property
    @abstractmethod
    def point_constants(self) -> tuple[float, ...]:
        """Return the constants in the order in which the point routine takes them."""

    @property
    @abstractmethod
    def shear_modulus(self) -> float:
        """Return the shear modulus of the undeformed state [MPa]."""

    def description(self) -> dict:
        """Return name and constants (moduli in MPa) under plain keys, as files state them."""
        return {"law": self.name} | asdict(self)

    def file_keys(self) -> dict:
        """Return keys of law.json for readers who want the constants by themselves."""
        return {}

    @classmethod
    def parameters_of_file(cls, content: dict) -> dict[str, float]:
        """Return the parameters in the content of a law.json by name, in its units."""
        return {p["name"]: p["value"] for p in content["parameters"]}

    def with_exponents(self, factor: float) -> PrincipalLaw:
        """Return the law that stiffens faster by a factor > 0, with the same shear modulus; 1 gives the law itself."""
        if not factor > 0:
            raise ValueError(f"exponent factor {factor:g}; > 0 is needed")
        return self if factor == 1 else self.stiffening_faster(factor)

    def stiffening_faster(self, factor: float) -> PrincipalLaw:
        """Return what with_exponents does to this law. Raises ValueError for a law without such a constant."""
        raise ValueError(f"{type(self).__name__} has no exponent to change; use Ogden, Yeoh or Gent")

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

    def admissible(self, lam: np.ndarray) -> np.ndarray:
        """Return whether the law has a stress (...) at the stretches lam (..., 3); a chain may have a limit."""
        return np.ones(np.shape(lam)[:-1], dtype=bool)

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
        same = self.principal_slope(lam_bar) / (2 * li * lj * sinhc(np.log(li / lj)))
        cross = ((li**2 + lj**2) * same - tau[..., :, None] - tau[..., None, :]) / (2 * li * lj)

        A = np.zeros(lam.shape[:-1] + (3, 3, 3, 3))  # in the principal frames
        for i in range(3):
            for j in range(3):
                A[..., i, i, j, j] = normal[..., i, j]
        for i, j in ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)):
            A[..., i, j, i, j] = same[..., i, j]
            A[..., i, j, j, i] = cross[..., i, j]
        return np.einsum("...ia,...bj,...kc,...dl,...abcd->...ijkl", U, Vt, U, Vt, A, optimize=True)


class InvariantLaw(PrincipalLaw):
    r"""A law W(I_1, I_2) of the isochoric invariants I_1 = sum lam_i^2 and I_2 = sum lam_i^-2.

    A law gives W and its derivatives; with f_i = dI_1/d ln lam_i = 2 lam_i^2 and
    g_i = dI_2/d ln lam_i = -2 lam_i^-2 (Holzapfel 2000, sec. 6.2)

    .. math:: \beta_i = W_1 f_i + W_2 g_i .

    Its point(constants, x, y), x = I_1 - 3 and y = I_2 - 3, returns W, W_1, W_2, W_11, W_12, W_22 and the extension over its
    limit.
    """

    @abstractmethod
    def invariant_energy(self, I1: np.ndarray, I2: np.ndarray) -> np.ndarray:
        """Return W (...) at the invariants I1, I2 (...)."""

    @abstractmethod
    def invariant_first(self, I1: np.ndarray, I2: np.ndarray) -> tuple:
        """Return W_1 = dW/dI1 and W_2 = dW/dI2, each (...) or a number."""

    def invariant_second(self, I1: np.ndarray, I2: np.ndarray) -> tuple:
        """Return W_11, W_12 and W_22, each (...) or a number; 0 for a law that is linear in the invariants."""
        return 0.0, 0.0, 0.0

    @property
    def shear_modulus(self) -> float:
        return 2 * float(sum(self.invariant_first(np.array(3.0), np.array(3.0))))

    def principal_energy(self, lam):
        return self.invariant_energy(*_invariants(lam))

    def principal_stress(self, lam):
        W1, W2 = (_for_triples(w) for w in self.invariant_first(*_invariants(lam)))
        return 2 * W1 * lam**2 - 2 * W2 * lam**-2.0

    def principal_tangent(self, lam):
        I1, I2 = _invariants(lam)
        W1, W2 = (_for_triples(w) for w in self.invariant_first(I1, I2))
        W11, W12, W22 = (_for_triples(w)[..., None] for w in self.invariant_second(I1, I2))
        f, g = 2 * lam**2, -2 * lam**-2.0
        fi, fj, gi, gj = f[..., :, None], f[..., None, :], g[..., :, None], g[..., None, :]
        diagonal = (2 * W1 * f - 2 * W2 * g)[..., None] * np.eye(3)
        return diagonal + W11 * fi * fj + W12 * (fi * gj + gi * fj) + W22 * gi * gj

    def principal_slope(self, lam):
        W1, W2 = (_for_triples(w)[..., None] for w in self.invariant_first(*_invariants(lam)))
        li, lj = lam[..., :, None], lam[..., None, :]
        # li^2 - lj^2 = 2 li lj sinh d and lj^-2 - li^-2 = 2 sinh(d) / (li lj) with d = ln(li / lj)
        return 4 * (W1 * li * lj + W2 / (li * lj)) * sinhc(np.log(li / lj))


def check_constants(law: str, positive=None, not_negative=None, free=None) -> None:
    """Refuse constants without a meaning, naming the first one."""
    for limits, holds, text in (
        (positive, lambda v: v > 0, "> 0"),
        (not_negative, lambda v: v >= 0, ">= 0"),
        (free, lambda v: True, "finite"),
    ):
        for name, value in (limits or {}).items():
            if not (np.isfinite(value) and holds(value)):
                raise ValueError(f"{law}: {name} is {value:g}; {text} is needed")


def _invariants(lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return I_1 and I_2 (...) of stretches lam (..., 3) whose product is 1."""
    return (lam**2).sum(axis=-1), (lam**-2.0).sum(axis=-1)


def _for_triples(w) -> np.ndarray:
    """Return a derivative of W, (...) or a number, so that it multiplies triples (..., 3)."""
    return np.asarray(w, dtype=float)[..., None]


def _principal(F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return U, lam (..., 3) and V^T of F = U diag(lam) V^T; refuse an inverted point."""
    F = np.asarray(F, dtype=float)
    J = np.linalg.det(F)
    if not (J > 0).all():
        raise ValueError(
            f"det F = {np.min(J):.4g} at the worst of {J.size} points; a constitutive model needs det F > 0, halve the step"
        )
    return np.linalg.svd(F)


def _isochoric(lam: np.ndarray) -> np.ndarray:
    """Return J^(-1/3) lam."""
    return lam / np.cbrt(lam.prod(axis=-1, keepdims=True))


def sinhc(x: np.ndarray) -> np.ndarray:
    """Return sinh(x) / x, 1 at 0."""
    safe = np.where(x == 0, 1.0, x)
    return np.where(x == 0, 1.0, np.sinh(safe) / safe)
