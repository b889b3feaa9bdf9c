r"""Ogden's law fitted jointly to the averaged curves of all tests.

The unknowns are ln g_k and alpha_k with g_k = mu_k alpha_k: mu_k alpha_k > 0 holds by construction, and the
nominal stress

.. math:: P = \sum_k g_k \frac{\lambda_1^{\alpha_k} - \lambda_3^{\alpha_k}}{\alpha_k \lambda_1}

passes smoothly through alpha_k = 0, so that no sign has to be chosen beforehand.

Least squares on the nominal stress, each test divided by its own root mean square and number of points: every
test counts the same, whatever its stress level and its number of rows. Unweighted, the stiffest test alone
(equibiaxial, whose stress can be several times larger) would decide the law.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares, nnls

from gelforge.characterisation.curves import MeanCurve
from gelforge.mechanics.homogeneous import nominal_stress, principal_stretches
from gelforge.mechanics.laws import Ogden

START_EXPONENTS = (-16.0, -8.0, -4.0, -2.0, 1.0, 2.0, 3.0, 4.0, 8.0, 16.0)
STARTS = 8  # the best combinations of start exponents are refined
LARGEST_EXPONENT = 30.0
SMALLEST_SHARE = 1e-9  # of a term in the stiffness
WORST_CONDITION = 1e7  # of the Jacobian with columns of length one: half of the digits of double precision


class FitError(ValueError):
    """Curves that do not determine the law asked for: what was found, what to do."""


@dataclass(frozen=True)
class OgdenFit:
    """A fitted law: parameters [MPa], covariance of (mu_1, alpha_1, mu_2, ...) [MPa, 1], quality by test."""

    law: Ogden
    covariance: np.ndarray  # (2K, 2K)
    r2_nominal: dict[str, float]
    valid_stretch: dict[str, tuple[float, float]]
    samples: dict[str, int]


def fit_ogden(curves: list[MeanCurve], terms: int) -> OgdenFit:
    """Return Ogden's law with the given number of terms, fitted to all curves together; largest term first.

    Raises FitError where the curves do not determine that many terms.
    """
    problem = _Problem.of(curves)
    solutions = [
        least_squares(
            lambda theta: problem.weight * (problem.model(theta) - problem.mean),
            start,
            jac=lambda theta: problem.weight[:, None] * problem.jacobian(theta),
            bounds=_bounds(problem, terms),
            x_scale="jac",
            ftol=1e-15,
            xtol=1e-15,
            gtol=1e-15,
            max_nfev=500,
        )
        for start in _starts(problem, terms)
    ]
    theta = _largest_first(min(solutions, key=lambda s: s.cost).x)
    _check_determined(problem, theta, terms)
    g, alpha = np.exp(theta[0::2]), theta[1::2]
    law = Ogden(tuple(g / alpha), tuple(alpha))
    return OgdenFit(
        law,
        _parameter_covariance(problem.covariance(theta), law),
        {c.test: _r2(c.nominal_stress, nominal_stress(law, c.test, c.stretch)) for c in curves},
        {c.test: (float(c.stretch[0]), float(c.stretch[-1])) for c in curves},
        {c.test: len(c.sample_nominal_stress) for c in curves},
    )


@dataclass(frozen=True)
class _Problem:
    """All tests' points in one row: n points, s samples; theta = (ln g_1, alpha_1, ln g_2, ...), g in MPa."""

    lam: np.ndarray  # (n, 3)
    mean: np.ndarray  # (n,) nominal stress averaged over samples
    weight: np.ndarray  # (n,)
    sample_scatter: (
        np.ndarray
    )  # (s, n) (sample - mean) / number of samples of its test, 0 at the points of other tests
    sample_part: np.ndarray  # (s, n) 1 / number of samples of its test, 0 at the points of other tests

    @classmethod
    def of(cls, curves: list[MeanCurve]) -> _Problem:
        mean = np.concatenate([c.nominal_stress for c in curves])
        weight = [np.full(len(c.stretch), _weight(c.nominal_stress)) for c in curves]
        parts, scatter, first = [], [], 0
        for c in curves:
            count = len(c.sample_nominal_stress)
            points = slice(first, first := first + len(c.stretch))
            for stress in c.sample_nominal_stress:
                part, deviation = np.zeros_like(mean), np.zeros_like(mean)
                part[points] = 1 / count
                deviation[points] = (stress - c.nominal_stress) / count
                parts.append(part)
                scatter.append(deviation)
        lam = np.concatenate([principal_stretches(c.test, c.stretch) for c in curves])
        return cls(lam, mean, np.concatenate(weight), np.array(scatter), np.array(parts))

    def model(self, theta: np.ndarray) -> np.ndarray:
        """Return the nominal stress (n,) [MPa]."""
        return _unit_terms(self.lam, theta[1::2])[0] @ np.exp(theta[0::2])

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Return d model / d theta (n, 2K)."""
        phi, dphi = _unit_terms(self.lam, theta[1::2])
        g = np.exp(theta[0::2])
        return np.stack([phi * g, dphi * g], axis=-1).reshape(len(phi), -1)

    def covariance(self, theta: np.ndarray) -> np.ndarray:
        """Return the covariance of theta (2K, 2K).

        Sandwich over samples (White 1980; Liang & Zeger 1986): the points of one sample share its stiffness
        and thickness error, so a sample, not a point, is the independent unit. With no more samples than
        parameters the points have to serve, which is too optimistic.
        """
        J = self.weight[:, None] * self.jacobian(theta)  # (n, p)
        length = np.linalg.norm(J, axis=0)
        inverse = np.linalg.inv((J / length).T @ (J / length)) / np.outer(length, length)
        residual = self.weight * (self.mean - self.model(theta))
        (s, n), p = self.sample_part.shape, len(theta)
        if s <= p:
            return inverse * (residual @ residual) / (n - p)
        scores = (
            self.weight * self.sample_scatter + residual * self.sample_part
        ) @ J  # (s, p); they add up to zero
        return inverse @ (scores.T @ scores) @ inverse * s / (s - p)


def _unit_terms(lam: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return phi = (lam_1^a - lam_3^a) / (a lam_1) and d phi / d a, both (n, K), finite at a = 0.

    lam_1^a - lam_3^a = 2 m^a sinh(a d / 2) with m = sqrt(lam_1 lam_3), d = ln(lam_1 / lam_3).
    """
    l1, l3 = lam[:, :1], lam[:, 2:]
    m, d = np.sqrt(l1 * l3), np.log(l1 / l3)
    x = alpha * d / 2
    small = np.abs(x) < 1e-4  # the series below is exact to rounding there
    safe = np.where(small, 1.0, x)
    sinhc = np.where(small, 1 + x**2 / 6, np.sinh(safe) / safe)
    slope = np.where(small, x / 3, (np.cosh(safe) - np.sinh(safe) / safe) / safe)
    scale = m**alpha * d / l1
    return scale * sinhc, scale * (np.log(m) * sinhc + slope * d / 2)


def _weight(nominal: np.ndarray) -> float:
    return float(1 / np.sqrt((nominal**2).sum()))


def _starts(problem: _Problem, terms: int) -> list[np.ndarray]:
    """Return the best start vectors: at fixed exponents the g_k >= 0 follow from a linear problem."""
    found = []
    for alpha in combinations(START_EXPONENTS, terms):
        phi = _unit_terms(problem.lam, np.array(alpha))[0]
        g, misfit = nnls(problem.weight[:, None] * phi, problem.weight * problem.mean)
        found.append((misfit, alpha, g))
    starts = []
    for _, alpha, g in sorted(found, key=lambda f: f[:2])[:STARTS]:
        g = np.maximum(g, 1e-4 * g.sum())  # a term that starts at nothing could not grow in ln g
        starts.append(np.clip(np.column_stack([np.log(g), alpha]).ravel(), *_bounds(problem, terms)))
    return starts


def _bounds(problem: _Problem, terms: int) -> tuple[np.ndarray, np.ndarray]:
    phi = _unit_terms(problem.lam, np.array([2.0]))[0][:, 0]
    stiffness = np.log(np.abs(problem.mean).sum() / np.abs(phi).sum())
    low = [stiffness + np.log(SMALLEST_SHARE), -LARGEST_EXPONENT] * terms
    high = [stiffness + np.log(1e2), LARGEST_EXPONENT] * terms
    return np.array(low), np.array(high)


def _largest_first(theta: np.ndarray) -> np.ndarray:
    pairs = theta.reshape(-1, 2)
    return pairs[np.argsort(-pairs[:, 0], kind="stable")].ravel()


def _check_determined(problem: _Problem, theta: np.ndarray, terms: int) -> None:
    remedy = (
        "the curves do not determine that many terms; lower ogden_terms or add a test"
        if terms > 1
        else "check the curves"
    )
    low, high = _bounds(problem, terms)
    at_bound = np.minimum(theta - low, high - theta) < 1e-3
    if at_bound.any():
        k = int(np.argmax(at_bound)) // 2
        g, alpha = np.exp(theta[2 * k]), theta[2 * k + 1]
        raise FitError(
            f"Ogden fit with {terms} terms: term {k + 1} ran to mu alpha = {g * 1e3:.3g} kPa,"
            f" alpha = {alpha:.3g} (limits {np.exp(low[0]) * 1e3:.3g} kPa and +-{LARGEST_EXPONENT:g});"
            f" {remedy}"
        )
    J = problem.weight[:, None] * problem.jacobian(theta)
    condition = np.linalg.cond(J / np.linalg.norm(J, axis=0))
    if not condition < WORST_CONDITION:
        raise FitError(
            f"Ogden fit with {terms} terms: condition {condition:.2g} of {WORST_CONDITION:.0g}; {remedy}"
        )


def _parameter_covariance(covariance: np.ndarray, law: Ogden) -> np.ndarray:
    """Return the covariance of (mu_1, alpha_1, ...) from that of (ln g_1, alpha_1, ...): mu = g / alpha."""
    T = np.eye(2 * len(law.mu))
    for k, (mu, alpha) in enumerate(zip(law.mu, law.alpha)):
        T[2 * k, 2 * k : 2 * k + 2] = mu, -mu / alpha
    return T @ covariance @ T.T


def _r2(measured: np.ndarray, model: np.ndarray) -> float:
    """Return 1 - residual over total sum of squares about the mean."""
    return float(1 - ((measured - model) ** 2).sum() / ((measured - measured.mean()) ** 2).sum())
