r"""The laws that can be fitted, by name: their unknowns, bounds, starts and analytic Jacobians.

A family describes a law by unknowns theta in which its constraints are simple bounds, and by parameters with the
units of files (kPa). Stress at measured states is s (beta_1 - beta_3) (mechanics.homogeneous).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import combinations

import numpy as np

from gelforge.mechanics.homogeneous import StressPoints
from gelforge.mechanics.laws import Gent, MooneyRivlin, NeoHooke, Ogden, PrincipalLaw, Yeoh

START_EXPONENTS = (-16.0, -8.0, -4.0, -2.0, 1.0, 2.0, 3.0, 4.0, 8.0, 16.0)
START_LIMITS = (1.02, 1.1, 1.5, 3.0, 10.0, 100.0)  # of Gent's Jm over the largest tested I_1 - 3
STARTS = 8  # the best combinations of start exponents are refined
LARGEST_EXPONENT = 30.0
SMALLEST_SHARE = 1e-9  # of a term in the stiffness
LARGEST_LIMIT = 1e4  # of Gent's Jm over the largest tested I_1 - 3: the law is neo-Hookean long before


class Family(ABC):
    """A law with its unknowns theta (p,); everything that a fit needs to know about it."""

    name: str
    title: str
    parameters: tuple[str, ...]  # as in law.json, with their unit
    logarithmic: tuple[bool, ...]  # parameters whose sign is fixed: intervals are those of the logarithm
    is_linear = False  # the stress is linear in theta
    modulus_per_parameter: tuple[float, ...]  # dE / d parameters, where it does not depend on them
    bound_means: str  # what to do when an unknown runs to its bound

    @abstractmethod
    def law(self, theta: np.ndarray) -> PrincipalLaw:
        """Return the law [MPa]."""

    @abstractmethod
    def values(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parameters (p,) in the units of files and their derivatives d parameters / d theta (p, p)."""

    @abstractmethod
    def unknowns(self, values: np.ndarray) -> np.ndarray:
        """Return theta (p,) of parameters (p,) in the units of files."""

    @abstractmethod
    def stress(self, points: StressPoints, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the nominal stress (n,) [MPa] and its derivatives by theta (n, p)."""

    @abstractmethod
    def bounds(self, points: StressPoints, stiffness: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest theta; stiffness [MPa] is a shear modulus of the order of the curves'."""

    @abstractmethod
    def starts(self, points: StressPoints, weight: np.ndarray, stress: np.ndarray, stiffness: float) -> list:
        """Return start vectors, the most promising first; the same for the same curves."""

    def modulus_gradient(self, values: np.ndarray) -> np.ndarray:
        """Return the derivatives (p,) of Young's modulus [kPa] by the parameters in the units of files."""
        return np.array(self.modulus_per_parameter)

    def ordered(self, theta: np.ndarray) -> np.ndarray:
        """Return theta with exchangeable terms in one order, so that the same law has the same parameters."""
        return theta

    def unit(self, parameter: str) -> str:
        """Return the unit of a parameter as its name says."""
        return "kPa" if parameter.endswith("_kPa") else "1"

    def law_of(self, values: np.ndarray) -> PrincipalLaw:
        """Return the law [MPa] of parameters in the units of files."""
        return self.law(self.unknowns(np.asarray(values, dtype=float)))


class OgdenFamily(Family):
    r"""Ogden's law with K terms; theta = (ln g_1, alpha_1, ln g_2, ...), g_k = mu_k alpha_k > 0 by construction.

    .. math:: \beta_1 - \beta_3 = \sum_k g_k (\lambda_1^{\alpha_k} - \lambda_3^{\alpha_k}) / \alpha_k

    passes smoothly through alpha_k = 0, so that no sign has to be chosen beforehand.
    """

    def __init__(self, terms: int):
        self.terms = terms
        self.name = f"ogden{terms}"
        self.title = f"Ogden, K = {terms}"
        self.parameters = tuple(n for k in range(1, terms + 1) for n in (f"mu_{k}_kPa", f"alpha_{k}"))
        self.logarithmic = (True, False) * terms
        self.bound_means = (
            "the curves do not determine that many terms; take fewer or add a test"
            if terms > 1
            else "check the curves"
        )

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
        R = np.linalg.qr(weight[:, None] * np.column_stack([phi, stress]), mode="r")
        found = []
        for chosen in combinations(range(len(START_EXPONENTS)), self.terms):
            g, misfit = optimize.nnls(R[:, list(chosen)], R[:, -1])
            found.append((misfit, chosen, g))
        starts = []
        for _, chosen, g in sorted(found, key=lambda f: f[:2])[:STARTS]:
            g = np.maximum(g, 1e-4 * g.sum())  # a term that starts at nothing could not grow in ln g
            theta = np.column_stack([np.log(g), np.array(START_EXPONENTS)[list(chosen)]]).ravel()
            starts.append(np.clip(theta, *self.bounds(points, stiffness)))
        return starts


class LinearFamily(Family):
    """A law whose constants [MPa] enter the stress linearly; theta = constants. Only the first must be positive."""

    is_linear = True
    free: tuple[bool, ...]  # constants that may be negative

    def law(self, theta):
        return self.kind(*(float(c) for c in theta))

    def values(self, theta):
        return theta * 1e3, np.eye(len(theta)) * 1e3

    def unknowns(self, values):
        return values / 1e3

    def stress(self, points, theta):
        columns = self.columns(points)
        return columns @ theta, columns

    def bounds(self, points, stiffness):
        low = np.where(self.free, -np.inf, 0.0)
        low[0] = stiffness * 1e-6
        return low, np.full(len(low), np.inf)

    def starts(self, points, weight, stress, stiffness):
        from scipy import optimize  # slow to import: jobs that only read a law do without

        columns = weight[:, None] * self.columns(points)
        length = np.linalg.norm(columns, axis=0)
        low, high = (b * length for b in self.bounds(points, stiffness))
        solution = optimize.lsq_linear(
            columns / length, weight * stress, (low, high), method="bvls", tol=1e-15
        )
        return [np.maximum(solution.x / length, self.bounds(points, stiffness)[0])]

    @abstractmethod
    def columns(self, points: StressPoints) -> np.ndarray:
        """Return the stress per unit of each constant (n, p)."""


class NeoHookeFamily(LinearFamily):
    name, title, kind, free = "neo_hooke", "Neo-Hooke", NeoHooke, (False,)
    parameters, logarithmic = ("mu_kPa",), (True,)
    modulus_per_parameter = (3.0,)
    bound_means = "check the sign of the stress"

    def columns(self, points):
        return _first_invariant(points)[:, None] / 2


class MooneyRivlinFamily(LinearFamily):
    name, title, kind, free = "mooney_rivlin", "Mooney-Rivlin", MooneyRivlin, (False, False)
    parameters, logarithmic = ("C10_kPa", "C01_kPa"), (True, False)
    modulus_per_parameter = (6.0, 6.0)
    bound_means = "the curves do not follow this law; try ogden1"

    def columns(self, points):
        l1, l3 = points.lam[:, 0], points.lam[:, 2]
        return np.column_stack([_first_invariant(points), 2 * points.scale * (l3**-2 - l1**-2)])


class YeohFamily(LinearFamily):
    name, title, kind, free = "yeoh", "Yeoh", Yeoh, (False, True, False)
    parameters, logarithmic = ("C10_kPa", "C20_kPa", "C30_kPa"), (True, False, False)
    modulus_per_parameter = (6.0, 0.0, 0.0)
    bound_means = "the curves do not follow this law; try ogden2"

    def columns(self, points):
        x = points.I1 - 3
        return _first_invariant(points)[:, None] * np.column_stack([np.ones_like(x), 2 * x, 3 * x**2])


class GentFamily(Family):
    """Gent's law; theta = (ln mu, ln Jm), Jm above every I_1 - 3 of the tests."""

    name, title, kind = "gent", "Gent", Gent
    parameters, logarithmic = ("mu_kPa", "Jm"), (True, True)
    modulus_per_parameter = (3.0, 0.0)
    bound_means = "the curves show no limiting stretch; take neo_hooke, or test further"

    def law(self, theta):
        return Gent(*(float(v) for v in np.exp(theta)))

    def values(self, theta):
        values = np.exp(theta) * [1e3, 1.0]
        return values, np.diag(values)

    def unknowns(self, values):
        return np.log(values / [1e3, 1.0])

    def stress(self, points, theta):
        mu, Jm = np.exp(theta)
        share = (points.I1 - 3) / Jm
        stress = _first_invariant(points) * mu / 2 / (1 - share)
        return stress, np.column_stack([stress, -stress * share / (1 - share)])

    def bounds(self, points, stiffness):
        reached = np.log((points.I1 - 3).max())
        low = [np.log(stiffness * 1e-4), reached + np.log(1.001)]
        return np.array(low), np.array([np.log(stiffness * 1e4), reached + np.log(LARGEST_LIMIT)])

    def starts(self, points, weight, stress, stiffness):
        reached, starts = (points.I1 - 3).max(), []
        for factor in START_LIMITS:
            unit = weight * self.stress(points, np.array([0.0, np.log(factor * reached)]))[0]
            mu = max((unit @ (weight * stress)) / (unit @ unit), stiffness * 1e-3)
            misfit = np.linalg.norm(mu * unit - weight * stress)
            starts.append((misfit, np.array([np.log(mu), np.log(factor * reached)])))
        return [theta for _, theta in sorted(starts, key=lambda s: s[0])]


FAMILIES = {
    family.name: family
    for family in (
        NeoHookeFamily(),
        MooneyRivlinFamily(),
        YeohFamily(),
        GentFamily(),
        *(OgdenFamily(terms) for terms in (1, 2, 3, 4)),
    )
}


def family_of(law: PrincipalLaw) -> Family:
    """Return the family of a law."""
    if isinstance(law, Ogden):
        return FAMILIES.get(f"ogden{len(law.mu)}") or OgdenFamily(len(law.mu))
    return next(f for f in FAMILIES.values() if getattr(f, "kind", None) is type(law))


def parameters_of(law: PrincipalLaw) -> np.ndarray:
    """Return the parameters (p,) of a law in the units of files, in the order of its family."""
    if isinstance(law, Ogden):
        return np.column_stack([np.array(law.mu) * 1e3, law.alpha]).ravel()
    units = [1e3 if name.endswith("_kPa") else 1.0 for name in family_of(law).parameters]
    return np.array([getattr(law, name.removesuffix("_kPa")) for name in family_of(law).parameters]) * units


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


def _first_invariant(points: StressPoints) -> np.ndarray:
    """Return the stress (n,) per unit of W_1 = dW/dI_1: 2 s (lam_1^2 - lam_3^2)."""
    return 2 * points.scale * (points.lam[:, 0] ** 2 - points.lam[:, 2] ** 2)
