r"""Isotropic hyperelastic laws in principal stretches, and their isochoric forms in three dimensions.

A law gives four functions of the principal stretches; everything else follows from them in one place. With
F_bar = J^(-1/3) F,

.. math::
    W_{iso}(F) = W(\bar\lambda_1, \bar\lambda_2, \bar\lambda_3), \qquad \bar\lambda_i = J^{-1/3} \lambda_i .

These plain NumPy forms are the twins of the compiled point routines (`point_laws`), which are tested against them: a new
law is a class here, naming one of those routines and its constants.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from typing import ClassVar

import numpy as np

# Families of laws that share a compiled routine, and its constants.
OGDEN = 0  # mu_1, alpha_1, mu_2, alpha_2, ... with mu = 0 for absent terms
POLYNOMIAL = 1  # C10, C01, C20, C30: neo-Hooke, Mooney-Rivlin, Yeoh
GENT = 2  # mu, Jm
DEVIATOR = np.eye(3) - 1 / 3  # takes the mean off a triple of principal values


class PrincipalLaw(ABC):
    """A strain energy W(lam_1, lam_2, lam_3) [MPa = mJ/mm^3], symmetric in the stretches, for lam_1 lam_2
    lam_3 = 1.

    With e_i = ln lam_i the derivatives are those of the logarithmic strain, where the Kirchhoff stress is
    conjugate.
    """

    name: ClassVar[str]  # in files
    point_law: ClassVar[int]  # the compiled routine that knows this law

    @property
    @abstractmethod
    def point_constants(self) -> tuple[float, ...]:
        """Return the constants in the order in which the compiled routine takes them."""

    @property
    @abstractmethod
    def shear_modulus(self) -> float:
        """Return the shear modulus of the undeformed state [MPa]."""

    def description(self) -> dict:
        """Return name and constants (moduli in MPa) under plain keys, as files state them."""
        return {"law": self.name} | asdict(self)

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

    name = "ogden"
    point_law = OGDEN

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
    def point_constants(self):
        return tuple(value for term in zip(self.mu, self.alpha) for value in term)

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


class InvariantLaw(PrincipalLaw):
    r"""A law W(I_1, I_2) of the isochoric invariants I_1 = sum lam_i^2 and I_2 = sum lam_i^-2.

    A law gives W and its derivatives; with f_i = dI_1/d ln lam_i = 2 lam_i^2 and
    g_i = dI_2/d ln lam_i = -2 lam_i^-2 (Holzapfel 2000, sec. 6.2)

    .. math:: \beta_i = W_1 f_i + W_2 g_i .
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
        return 4 * (W1 * li * lj + W2 / (li * lj)) * _sinhc(np.log(li / lj))


@dataclass(frozen=True)
class NeoHooke(InvariantLaw):
    r"""The neo-Hookean law W = mu/2 (I_1 - 3) (Treloar 1943); mu > 0 is the shear modulus [MPa]."""

    mu: float

    name = "neo_hooke"
    point_law = POLYNOMIAL

    def __post_init__(self):
        _check_constants("Neo-Hooke", positive={"mu": self.mu})

    @property
    def point_constants(self):
        return self.mu / 2, 0.0, 0.0, 0.0

    def invariant_energy(self, I1, I2):
        return self.mu / 2 * (I1 - 3)

    def invariant_first(self, I1, I2):
        return self.mu / 2, 0.0


@dataclass(frozen=True)
class MooneyRivlin(InvariantLaw):
    r"""The Mooney-Rivlin law W = C_10 (I_1 - 3) + C_01 (I_2 - 3) (Mooney 1940, doi 10.1063/1.1712836).

    C_10 > 0 and C_01 >= 0 [MPa] make it stable at every deformation; the shear modulus is 2 (C_10 + C_01).
    """

    C10: float
    C01: float

    name = "mooney_rivlin"
    point_law = POLYNOMIAL

    def __post_init__(self):
        _check_constants("Mooney-Rivlin", positive={"C10": self.C10}, not_negative={"C01": self.C01})

    @property
    def point_constants(self):
        return self.C10, self.C01, 0.0, 0.0

    def invariant_energy(self, I1, I2):
        return self.C10 * (I1 - 3) + self.C01 * (I2 - 3)

    def invariant_first(self, I1, I2):
        return self.C10, self.C01


@dataclass(frozen=True)
class Yeoh(InvariantLaw):
    r"""Yeoh's law W = sum_k C_k0 (I_1 - 3)^k, k = 1..3 (Yeoh 1993, doi 10.5254/1.3538343, eq. 4).

    The shear modulus is 2 C_10 > 0 [MPa]. C_20 is often negative (the stress-stretch curve is S-shaped), C_30 < 0 softens
    at large stretch; whether the model stays stable is a question of the range used (stability.check_stable).
    """

    C10: float
    C20: float
    C30: float

    name = "yeoh"
    point_law = POLYNOMIAL

    def __post_init__(self):
        _check_constants("Yeoh", positive={"C10": self.C10}, free={"C20": self.C20, "C30": self.C30})

    @property
    def point_constants(self):
        return self.C10, 0.0, self.C20, self.C30

    def invariant_energy(self, I1, I2):
        x = I1 - 3
        return x * (self.C10 + x * (self.C20 + x * self.C30))

    def invariant_first(self, I1, I2):
        x = I1 - 3
        return self.C10 + x * (2 * self.C20 + x * 3 * self.C30), 0.0

    def invariant_second(self, I1, I2):
        return 2 * self.C20 + 6 * self.C30 * (I1 - 3), 0.0, 0.0


@dataclass(frozen=True)
class Gent(InvariantLaw):
    r"""Gent's law of limiting chain extension (Gent 1996, doi 10.5254/1.3538357, eq. 2).

    .. math:: W = -\frac{\mu J_m}{2} \ln\left(1 - \frac{I_1 - 3}{J_m}\right), \qquad I_1 - 3 < J_m.

    mu > 0 is the shear modulus [MPa], J_m > 0 the limit of I_1 - 3. Beyond it no stress exists: ValueError.
    """

    mu: float
    Jm: float

    name = "gent"
    point_law = GENT

    def __post_init__(self):
        _check_constants("Gent", positive={"mu": self.mu, "Jm": self.Jm})

    @property
    def point_constants(self):
        return self.mu, self.Jm

    def admissible(self, lam):
        lam = np.asarray(lam, dtype=float)
        return (lam**2).sum(axis=-1) - 3 < self.Jm

    def invariant_energy(self, I1, I2):
        return -self.mu * self.Jm / 2 * np.log1p(-self._extension(I1))

    def invariant_first(self, I1, I2):
        return self.mu / (2 * (1 - self._extension(I1))), 0.0

    def invariant_second(self, I1, I2):
        return self.mu / (2 * self.Jm * (1 - self._extension(I1)) ** 2), 0.0, 0.0

    def _extension(self, I1):
        x = (I1 - 3) / self.Jm
        if not (x < 1).all():
            raise ValueError(
                f"Gent: I_1 - 3 = {np.max(I1) - 3:.4g}, the chains' limit is Jm = {self.Jm:.4g};"
                " take a smaller stretch or step"
            )
        return x


def _check_constants(law: str, positive=None, not_negative=None, free=None) -> None:
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
