"""How far the tests determine what was not tested: the width of a law's prediction in the other load cases."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution

from gelforge.materials.fitting.curves import MeanCurve
from gelforge.materials.fitting.fit import LawFit, Problem, effective_points
from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, StressPoints, stress_points
from gelforge.mechanics.laws.models import FAMILIES
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke

TOLERANCE = 0.01  # of the spread of stress: real samples cannot distinguish laws that are closer than that
WIDTH_TO_WARN = 0.10  # high over low - 1 of a prediction
REFERENCE = "ogden3"  # contains neo-Hooke and Mooney-Rivlin (alpha = 2, -2) and Ogden with fewer terms, and stiffens twice
# Of a misfit: with fewer its scatter is not known at all, with three to 1 / sqrt(6) = 41 % (GUM 2008, E.4.3).
LEAST_FREEDOM = 3.0
# prescribed stress over that of a neo-Hookean law of the same stiffness
SCANNED = np.geomspace(1 / 30, 30, 15)
ROUGH = 1e-5  # relative tolerance of the fits with a prescribed stress: 0.3 % of a standard deviation


@dataclass(frozen=True)
class PredictionWidth:
    """Nominal stress [MPa] at a stretch of a load case that was not tested: the law's, and the range of equally good
    laws."""

    case: str
    stretch: float
    stress: float
    low: float
    high: float

    @property
    def text(self) -> str:
        """Return the width in words."""
        return (
            f"{self.case} was not tested: constitutive models that fit the tests as well put its nominal stress at"
            f" stretch {self.stretch:.3g} at least between {self.low * 1e3:.3g} and {self.high * 1e3:.3g} kPa, a factor of"
            f" {self.high / self.low:.3g} (this model: {self.stress * 1e3:.3g} kPa)"
        )

    @property
    def determined(self) -> bool:
        """Return whether equally good laws agree within WIDTH_TO_WARN."""
        return self.high / self.low - 1 <= WIDTH_TO_WARN


def prediction_widths(
    curves: list[MeanCurve], fit: LawFit, stretch: float | None = None, cases=tuple(LOAD_CASES)
) -> list[PredictionWidth]:
    """Return the width of the prediction in each standard load case that was not tested, at one stretch.

    stretch: the largest tested one if not given. The width is that of all laws of the fitted family and of Ogden's
    with three terms that the tests cannot distinguish from the best of their family (_largest_misfit): the stress is
    prescribed at one value after the other and the law fitted again (a profile of the misfit). Values outside
    SCANNED are not looked at, so that the width of what is not determined at all is a lower limit.
    """
    tested = {c.test for c in curves}
    problem, widths = Problem.of(curves), []
    stretch = stretch or float(problem.points.lam.max())  # of any direction: compression stretches sideways
    for case in (c for c in cases if c not in tested):
        point = stress_points(case, np.array([stretch]))
        admitted = []
        for family in dict.fromkeys((fit.family, FAMILIES[REFERENCE])):
            theta = fit.theta if family is fit.family else problem.solve(family)
            admitted += _admitted(problem, family, theta, point)
        # NaN beyond the limiting stretch of the law itself
        fitted_stress = _stress(fit.family, point, fit.theta)
        low, high = min(fitted_stress, *admitted), max(fitted_stress, *admitted)
        widths.append(PredictionWidth(case, stretch, fitted_stress, low, high))
    return widths


def _admitted(problem: Problem, family: Family, theta: np.ndarray, point: StressPoints) -> list[float]:
    """Return the lowest and highest nominal stress [MPa] at a point that fits as good as theta's admit."""
    limit = _largest_misfit(problem, family, theta)
    stress = SCANNED * float(point.measured_stress(NeoHooke(problem.stiffness))[0])
    fits, good = [], theta
    for prescribed in stress:
        good = _prescribed(problem, family, good, point, prescribed, limit)
        fits.append((problem.misfit(family, good) ** 2 <= limit, good))
    inside = [i for i, (admitted, _) in enumerate(fits) if admitted]
    if not inside:
        return [_stress(family, point, theta)] * 2
    ends = []
    for i, way in ((inside[0], -1), (inside[-1], 1)):
        low, high, good = stress[i], stress[i] * (SCANNED[1] / SCANNED[0]) ** way, fits[i][1]
        # the last step is halved to a factor of 1.06 in the stress
        for _ in range(3 if 0 < i < len(stress) - 1 else 0):
            middle = np.sqrt(low * high)
            refit = _prescribed(problem, family, good, point, middle, limit)
            if problem.misfit(family, refit) ** 2 <= limit:
                low, good = middle, refit
            else:
                high = middle
        ends.append(float(low))
    return ends


def _largest_misfit(problem: Problem, family: Family, theta: np.ndarray) -> float:
    """Return the largest squared misfit of laws that the tests cannot distinguish from the best one, theta.

    It grows by 1 + F(1, v) / v, the profile region of one quantity with v degrees of freedom (Bates & Watts 1988,
    sec. 6.1), v from as many points as correlated residuals are worth, and by TOLERANCE^2.
    """
    residual = problem.weight * (family.stress(problem.points, theta)[0] - problem.mean)
    v = max(effective_points(residual, problem.curve_sizes) - len(theta), LEAST_FREEDOM)
    return problem.misfit(family, theta) ** 2 * (1 + f_distribution.ppf(0.95, 1, v) / v) + TOLERANCE**2


def _stress(family: Family, point: StressPoints, theta: np.ndarray) -> float:
    """Return the nominal stress [MPa] of a law at one point, infinite where it has none."""
    return float(np.nan_to_num(point.measured_stress(family.law(theta))[0], nan=np.inf))


def _prescribed(
    problem: Problem, family: Family, start: np.ndarray, point: StressPoints, stress: float, limit: float
) -> np.ndarray:
    """Return theta fitted to the tests and to a prescribed stress [MPa] at one more point.

    It is the first found whose squared misfit of the tests is within the limit, else the best.
    """
    extended = replace(
        problem,
        points=StressPoints(
            np.concatenate([problem.points.lam, point.lam]),
            np.concatenate([problem.points.scale, point.scale]),
        ),
        mean=np.append(problem.mean, stress),
        # the prescribed stress is met to 1e-4
        weight=np.append(problem.weight, 100.0 / stress),
    )
    solutions = [extended.solve(family, start, ROUGH)]
    if family.is_linear or problem.misfit(family, solutions[0]) ** 2 <= limit:
        return solutions[0]
    # a fit that left a term unused cannot bring it back step by step: a fresh start can
    for fresh in family.starts(extended.points, extended.weight, extended.mean, extended.stiffness)[:2]:
        solutions.append(extended.solve(family, fresh, ROUGH))
        if problem.misfit(family, solutions[-1]) ** 2 <= limit:
            return solutions[-1]
    return min(solutions, key=lambda theta: extended.misfit(family, theta))
