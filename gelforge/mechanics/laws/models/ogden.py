"""Ogden's law: powers of the principal stretches."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import exp, log
from typing import Literal, cast

import numpy as np
from pydantic import Field, model_validator

from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.homogeneous import StressPoints
from gelforge.mechanics.laws.law import PrincipalLaw, sinhc
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.parameters import GivenParameters

# to either side of those of rubber, 1.3, 5 and -2 (Ogden 1972)
START_EXPONENTS = (-16.0, -8.0, -4.0, -2.0, 1.0, 2.0, 3.0, 4.0, 8.0, 16.0)
# Six times the largest of rubber, 5 (Ogden 1972): curves that ask for more do not determine it.
LARGEST_EXPONENT = 30.0
# Of a term in the stiffness: up to a stretch of 2 a smaller one is not seen, as 2^30 is 1e9 (exponents: Ogden 1972).
SMALLEST_SHARE = 1e-9
MOST_TERMS = 4  # one more than those that describe Treloar's rubber (Ogden 1972)

# By convention: the energy's factor of the term k, the initial shear modulus, who writes it so.
OGDEN_CONVENTIONS = {
    "ogden": ("mu_k/alpha_k", "sum mu_k alpha_k / 2", "Ogden, ANSYS, LS-DYNA, COMSOL"),
    "ansys": ("mu_k/alpha_k", "sum mu_k alpha_k / 2", "Ogden, ANSYS, LS-DYNA, COMSOL"),
    "abaqus": ("2 mu_k/alpha_k^2", "sum mu_k", "Abaqus, Radioss law 82"),
}


def ogden_point(constants, lam):
    """Return W, beta, gamma [MPa] and no extension; constants mu_1 [MPa], alpha_1, ...; mu = 0: no term."""
    energy, b0, b1, b2, g00, g11, g22, g01, g02, g12 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    log0, log1, log2 = log(lam[0]), log(lam[1]), log(lam[2])  # one logarithm serves all powers
    for k in range(constants.shape[0] // 2):
        m = constants[2 * k]
        if m == 0.0:
            continue
        a = constants[2 * k + 1]
        p0 = exp(a * log0)
        p1 = exp(a * log1)
        p2 = exp(a * log2)
        mean = (p0 + p1 + p2) / 3.0
        energy += m / a * (3.0 * mean - 3.0)
        b0 += m * (p0 - mean)
        b1 += m * (p1 - mean)
        b2 += m * (p2 - mean)
        c = m * a / 3.0
        g00 += c * (p0 + mean)
        g11 += c * (p1 + mean)
        g22 += c * (p2 + mean)
        g01 += c * (mean - p0 - p1)
        g02 += c * (mean - p0 - p2)
        g12 += c * (mean - p1 - p2)
    return energy, (b0, b1, b2), (g00, g11, g22, g01, g02, g12), 0.0


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
    point = staticmethod(ogden_point)

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

    def file_keys(self):
        return {"mu_kPa": [m * 1e3 for m in self.mu], "alpha": list(self.alpha)}

    @classmethod
    def parameters_of_file(cls, content):
        """Files from before there were other laws have these keys alone."""
        terms = enumerate(zip(content["mu_kPa"], content["alpha"]), start=1)
        return {key: v for k, (mu, alpha) in terms for key, v in ((f"mu_{k}_kPa", mu), (f"alpha_{k}", alpha))}

    def stiffening_faster(self, factor):
        """Exponents are multiplied; mu_k alpha_k stay."""
        return Ogden(tuple(m / factor for m in self.mu), tuple(a * factor for a in self.alpha))

    def principal_energy(self, lam):
        return sum(m / a * (lam**a - 1).sum(axis=-1) for m, a in zip(self.mu, self.alpha))

    def principal_stress(self, lam):
        return sum(m * lam**a for m, a in zip(self.mu, self.alpha))

    def principal_tangent(self, lam):
        return sum(m * a * lam**a for m, a in zip(self.mu, self.alpha))[..., None] * np.eye(3)

    def principal_slope(self, lam):
        li, lj = lam[..., :, None], lam[..., None, :]
        mean, d = np.sqrt(li * lj), np.log(li / lj)  # li^a - lj^a = 2 mean^a sinh(a d / 2)
        return sum(m * a * mean**a * sinhc(a * d / 2) for m, a in zip(self.mu, self.alpha))


class OgdenFamily(Family):
    r"""Ogden's law with K terms; theta = (ln g_1, alpha_1, ln g_2, ...), g_k = mu_k alpha_k > 0 by construction.

    .. math:: \beta_1 - \beta_3 = \sum_k g_k (\lambda_1^{\alpha_k} - \lambda_3^{\alpha_k}) / \alpha_k

    passes smoothly through alpha_k = 0, so that no sign has to be chosen beforehand.
    """

    kind = Ogden

    def __init__(self, terms: int):
        self.terms = terms
        self.name = f"ogden{terms}"
        self.title = f"Ogden, K = {terms}"
        self.simpler = f"ogden{terms - 1}" if terms > 1 else None
        self.parameters = tuple(n for k in range(1, terms + 1) for n in (f"mu_{k}_kPa", f"alpha_{k}"))
        self.logarithmic = (True, False) * terms
        self.bound_means = (
            "the curves do not determine that many terms; take fewer or add a test"
            if terms > 1
            else "check the curves"
        )

    def holds(self, law):
        return isinstance(law, Ogden) and len(law.mu) == self.terms

    def law(self, theta):
        g, alpha = np.exp(theta[0::2]), theta[1::2]
        return Ogden(tuple(g / alpha), tuple(alpha))

    def modulus_gradient(self, values):
        return 1.5 * np.column_stack([values[1::2], values[0::2]]).ravel()  # E = 1.5 sum mu alpha

    def ordered(self, theta):
        pairs = theta.reshape(-1, 2)
        return pairs[np.argsort(-pairs[:, 0], kind="stable")].ravel()  # largest stiffness first

    def law_of(self, values):
        return Ogden(tuple(np.asarray(values)[0::2] / 1e3), tuple(np.asarray(values)[1::2]))

    def parameters_of(self, law):
        return np.column_stack([np.array(law.mu) * 1e3, law.alpha]).ravel()

    def values(self, theta):
        alpha = theta[1::2]
        mu = np.exp(theta[0::2]) / alpha * 1e3
        T = np.eye(2 * self.terms)
        for k in range(self.terms):
            T[2 * k, 2 * k : 2 * k + 2] = mu[k], -mu[k] / alpha[k]
        return np.column_stack([mu, alpha]).ravel(), T

    def unknowns(self, values):
        mu, alpha = values[0::2] / 1e3, values[1::2]
        return np.column_stack([np.log(mu * alpha), alpha]).ravel()

    def stress(self, points, theta):
        phi, slope = ogden_terms(points, theta[1::2])
        g = np.exp(theta[0::2])
        return phi @ g, np.stack([phi * g, slope * g], axis=-1).reshape(len(phi), -1)

    def bounds(self, points, stiffness):
        low = [np.log(stiffness * SMALLEST_SHARE), -LARGEST_EXPONENT] * self.terms
        high = [np.log(stiffness * 1e2), LARGEST_EXPONENT] * self.terms
        return np.array(low), np.array(high)

    def starts(self, points, weight, stress, stiffness):
        """Try all combinations of start exponents: at fixed exponents the g_k >= 0 are a linear problem."""
        from scipy import optimize  # slow to import: jobs that only read a law do without

        phi = ogden_terms(points, np.array(START_EXPONENTS))[0]
        # the triangle of the weighted columns keeps all their inner products
        columns = weight[:, None] * np.column_stack([phi, stress])
        R = cast(np.ndarray, np.linalg.qr(columns, mode="r"))  # numpy's types know of Q and R only
        ranked = []
        for chosen in combinations(range(len(START_EXPONENTS)), self.terms):
            g, misfit = optimize.nnls(R[:, list(chosen)], R[:, -1])
            ranked.append((misfit, chosen, g))
        starts = []
        # the best combinations of start exponents are refined
        for _, chosen, g in sorted(ranked, key=lambda f: f[:2])[:8]:
            g = np.maximum(g, 1e-4 * g.sum())  # a term that starts at nothing could not grow in ln g
            theta = np.column_stack([np.log(g), np.array(START_EXPONENTS)[list(chosen)]]).ravel()
            starts.append(np.clip(theta, *self.bounds(points, stiffness)))
        return starts


def ogden_terms(points: StressPoints, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return phi = s (lam_1^a - lam_3^a) / a and d phi / d a, both (n, K), finite at a = 0."""
    e1, e3 = points.logarithms[:, :1], points.logarithms[:, 2:]
    small = np.abs(alpha) < 1e-3  # the series is exact to 1e-12 there, the quotient to 1e-10 from there on
    a = np.where(small, 1.0, alpha)
    p1, p3 = np.exp(a * e1), np.exp(a * e3)
    phi = (p1 - p3) / a
    slope = (e1 * p1 - e3 * p3 - phi) / a
    if small.any():
        powers = [e1**k - e3**k for k in (1, 2, 3, 4)]
        series = powers[0] + alpha * (powers[1] / 2 + alpha * (powers[2] / 6 + alpha * powers[3] / 24))
        derivative = powers[1] / 2 + alpha * (powers[2] / 3 + alpha * powers[3] / 8)
        phi, slope = np.where(small, series, phi), np.where(small, derivative, slope)
    return points.scale[:, None] * phi, points.scale[:, None] * slope


class OgdenParameters(GivenParameters):
    """Ogden's model W = sum c_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3), c_k as its convention says."""

    law: Literal["ogden"] = Field("ogden", description="constitutive model")
    mu_kPa: list[float] = Field(min_length=1, max_length=MOST_TERMS, description="moduli mu_k [kPa]")
    alpha: list[float] = Field(min_length=1, max_length=MOST_TERMS, description="exponents alpha_k [-]")
    convention: Literal["ogden", "ansys", "abaqus"] = Field(
        "ogden",
        description="what mu_kPa means: ogden, ansys: c_k = mu_k/alpha_k, initial shear modulus sum mu_k alpha_k / 2; "
        "abaqus: c_k = 2 mu_k/alpha_k^2, initial shear modulus sum mu_k",
    )

    @model_validator(mode="after")
    def _signs(self):
        if len(self.mu_kPa) != len(self.alpha):
            raise ValueError(f"{len(self.mu_kPa)} mu_kPa but {len(self.alpha)} alpha; give one alpha per mu")
        for mu, alpha in zip(self.mu_kPa, self.alpha):
            if alpha == 0:
                raise ValueError("alpha 0: the term has no energy; leave it out")
            if not (mu > 0 if self.convention == "abaqus" else mu * alpha > 0):
                raise ValueError(self._softening(mu, alpha))
        return self

    def _softening(self, mu: float, alpha: float) -> str:
        """Return why a term is refused, and how the other convention writes it."""
        other = "ogden" if self.convention == "abaqus" else "abaqus"
        stated, meant = OGDEN_CONVENTIONS[self.convention], OGDEN_CONVENTIONS[other]
        needed = "mu_k > 0" if self.convention == "abaqus" else "mu_k alpha_k > 0, both of the same sign,"
        return (
            f"mu_kPa {mu:g} with alpha {alpha:g} is a term of negative stiffness: {needed} is needed in convention: "
            f"{self.convention}, energy factor {stated[0]}, initial shear modulus {stated[1]} ({stated[2]}); for parameters "
            f"written with {meant[0]}, initial shear modulus {meant[1]} ({meant[2]}), set convention: {other}"
        )

    @property
    def ogden_mu_kPa(self) -> tuple[float, ...]:
        """The moduli in Ogden's own convention, c_k = mu_k/alpha_k [kPa]."""
        if self.convention == "abaqus":
            return tuple(2 * mu / alpha for mu, alpha in zip(self.mu_kPa, self.alpha))
        return tuple(self.mu_kPa)

    def constitutive_model(self):
        return Ogden(tuple(m * 1e-3 for m in self.ogden_mu_kPa), tuple(self.alpha))


MODEL = Model(
    law=Ogden,
    parameters=OgdenParameters,
    families=tuple(OgdenFamily(terms) for terms in range(1, MOST_TERMS + 1)),
    formula="W = sum_k mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3), l1 l2 l3 = 1;"
    " E = 1.5 sum_k mu_k alpha_k",
)
