"""The base law of a kind of material test: an incompressible solid's, or a foam's where that comes closer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gelforge.materials.fitting.choice import compare_laws
from gelforge.materials.fitting.curves import MeanCurve
from gelforge.materials.fitting.fit import LawFit, Problem, effective_points
from gelforge.mechanics.laws.homogeneous import stress_points

SOLIDS = ("neo_hooke", "mooney_rivlin", "yeoh", "gent", "ogden1", "ogden2")
FOAM_EXPONENTS = (-8.0, 2.0, 8.0, 25.0)  # where the search begins: densifies, or gives in
MOST_EXPONENT = 60.0

# Nominal stress (n,) [MPa] at stretches (n,), and its derivatives by the law's unknowns (n, p).
Stress = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class BaseLaw:
    """A law fitted to one loading of one kind of test."""

    title: str
    stress: Stress
    covariance: np.ndarray  # (p, p) of its unknowns
    valid: tuple[float, float]  # stretches that it was fitted at


def base_law(curves: list[MeanCurve], kind: str) -> BaseLaw:
    """Return the law of curves of one kind of test. Raises FitError where none is determined.

    A foam gives way in its cells and not to the side, and no incompressible law has its curve: pressed between plates, its
    law is tried too, and taken for a lower AICc.
    """
    fit = compare_laws(curves, list(SOLIDS)).chosen.fitted
    if kind != "compression":
        return _solid(fit, kind)
    problem = Problem.of(curves)
    solid, foam = _solid(fit, kind), _foam(problem, fit.valid_stretch[kind])
    residuals = [
        problem.weight * (problem.mean - law.stress(problem.points.lam[:, 0])[0]) for law in (solid, foam)
    ]
    worth = effective_points(min(residuals, key=np.linalg.norm), problem.curve_sizes)
    aicc = [_aicc(r, worth, len(law.covariance)) for r, law in zip(residuals, (solid, foam))]
    return foam if aicc[1] < aicc[0] else solid


def _solid(fit: LawFit, kind: str) -> BaseLaw:
    case = "uniaxial" if kind == "compression" else kind

    def stress(stretch):
        points = stress_points(case, stretch)
        return points.measured_stress(fit.law), fit.family.stress(points, fit.theta)[1]

    return BaseLaw(fit.family.title, stress, fit.theta_covariance, fit.valid_stretch[kind])


def foam_stress(stretch: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r"""Return Ogden and Hill's stress of a foam that does not widen (Hill 1978; Storakers 1986 with beta = 0).

    .. math:: P = 2 \mu (\lambda^{\alpha - 1} - \lambda^{-1}) / \alpha, \qquad \theta = (\ln \mu, \alpha)

    alpha far above 2: the cells give in after a stiff begin; below: they are pressed shut.
    """
    mu, alpha = np.exp(theta[0]), theta[1]
    power = stretch**alpha
    stress = 2 * mu * (power - 1) / (alpha * stretch)
    return stress, np.column_stack(
        [stress, 2 * mu * power * np.log(stretch) / (alpha * stretch) - stress / alpha]
    )


def _foam(problem: Problem, valid: tuple[float, float]) -> BaseLaw:
    stretch, w = problem.points.lam[:, 0], problem.weight

    def fitted(alpha):
        return least_squares(
            lambda t: w * (foam_stress(stretch, t)[0] - problem.mean), [np.log(problem.stiffness), alpha],
            jac=lambda t: w[:, None] * foam_stress(stretch, t)[1],
            bounds=([-np.inf, -MOST_EXPONENT], [np.inf, MOST_EXPONENT]), x_scale="jac",
        )  # fmt: skip

    best = min((fitted(alpha) for alpha in FOAM_EXPONENTS), key=lambda found: found.cost)
    freedom = max(1.0, effective_points(best.fun, problem.curve_sizes) - 2)
    # of lower rank where the exponent is so large that the stress follows from mu / alpha alone
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * 2 * best.cost / freedom
    title = "Ogden and Hill's foam"
    return BaseLaw(title, lambda stretch: foam_stress(stretch, best.x), covariance, valid)


def _aicc(residual: np.ndarray, worth: float, unknowns: int) -> float:
    """Return AICc (Hurvich & Tsai 1989) of a fit whose n points are worth fewer independent ones."""
    q = unknowns + 1
    n = max(worth, q + 2.0)
    return float(n * np.log(max(residual @ residual, 1e-24)) + 2 * q + 2 * q * (q + 1) / (n - q - 1))
