r"""A law fitted jointly to the averaged curves of all tests.

Least squares on the nominal stress, each kind of test divided by the root of its sum of squares about its mean: the
sum of 1 - R2 over the kinds of tests is minimised, so that each counts the same, whatever its stress level and its
number of rows. Unweighted, the stiffest test alone (equibiaxial, whose stress can be several times larger) would
decide the law. With a robust loss the samples' own curves are fitted instead of
their mean, so that a sample or a stretch of rows that disagrees with the others loses its pull.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from gelforge.materials.fitting.curves import MeanCurve
from gelforge.materials.fitting.valid_range import ValidRange, unstable_from
from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.homogeneous import StressPoints
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models import FAMILIES
from gelforge.robust import SIGMA_OF_MEDIAN

WEIGHTS = "sum over the kinds of tests of 1 - R2 of the nominal stress: each kind counts the same"
LEAST_SPREAD = 0.1  # of a test's sum of squares: a short piece of a curve must not count for its flatness
LOSSES = ("linear", "soft_l1")  # quadratic, or growing only linearly beyond 1.345 robust standard deviations
# of the median absolute residual (Huber 1964: 95 % efficient for normal scatter)
ROBUST_SCALE = 1.345 * SIGMA_OF_MEDIAN
# Of the Jacobian with columns of length 1: half of the 16 digits of double precision (IEEE 754-2019).
WORST_CONDITION = 1e7
ROWS_PER_PARAMETER = 3  # fewer rows than that cannot show a misfit
FEW_ROWS = 12  # in a test: a curve whose shape between the rows is not seen; named in a note
# Relative tolerances: to rank starts; so that another machine gives the same 10 digits.
COARSE, FINE = 1e-6, 1e-15
NEIGHBOUR = 1e-8  # from a neighbouring fit: far below the scatter between samples, 1e-2


class FitError(ValueError):
    """Curves that do not determine the law asked for: what was found, what to do."""


class Undetermined(FitError):
    """Curves that leave a parameter of the law open; one of fewer parameters may be determined."""


@dataclass(frozen=True)
class LawFit:
    """A fitted law, its parameters in the units of files, their covariance, and the quality by kind of test."""

    family: Family
    theta: np.ndarray  # (p,) unknowns of the family
    theta_covariance: np.ndarray  # (p, p), 0 for unknowns at a bound
    freedom: int  # degrees of freedom of the covariance
    covariance_from: str  # what the independent units of the covariance are
    misfit: float  # root of 1 - R2 averaged over the kinds of tests
    r2_nominal: dict[str, float]
    valid_stretch: dict[str, tuple[float, float]]
    samples: dict[str, int]
    valid: ValidRange
    unstable_from: float | None  # share of the valid range, None where stable
    notes: tuple[str, ...] = field(default=())
    loss: str = "linear"
    at_bound: tuple[str, ...] = ()  # parameters at the least value that stability allows: they add nothing

    @property
    def law(self) -> PrincipalLaw:
        """Return the law [MPa]."""
        return self.family.law(self.theta)

    @property
    def parameters(self) -> np.ndarray:
        """Return the parameters (p,) in the units of files."""
        return self.family.values(self.theta)[0]

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (p, p) of the parameters in the units of files."""
        T = self.family.values(self.theta)[1]
        return T @ self.theta_covariance @ T.T

    def stress_interval(self, points: StressPoints) -> tuple[np.ndarray, np.ndarray]:
        """Return the nominal stress (n,) [MPa] and the half-width (n,) of its 95 % interval, from the covariance."""
        stress, J = self.family.stress(points, self.theta)
        sigma = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", J, self.theta_covariance, J), 0))
        return stress, student.ppf(0.975, self.freedom) * sigma


def fit_law(
    curves: list[MeanCurve], name: str, loss: str = "linear", start: np.ndarray | None = None
) -> LawFit:
    """Return the law of a family (FAMILIES) fitted to all curves together.

    start (p,) replaces the family's own starts where a neighbouring fit is known. Raises FitError where the curves
    do not determine the law.
    """
    if name not in FAMILIES:
        raise FitError(f"constitutive model {name!r} is not known; one of {', '.join(FAMILIES)}")
    if loss not in LOSSES:
        raise FitError(f"loss {loss!r} is not known; one of {', '.join(LOSSES)}")
    family, problem = FAMILIES[name], Problem.of(curves)
    _check_rows(curves, family)
    theta = problem.solve(family, start)
    if loss != "linear":
        theta, problem = problem.robust_solve(family, theta, loss)
    free = _check_determined(problem, family, theta)
    at_bound = tuple(name for name, inside in zip(family.parameters, free) if not inside)
    notes = [f"{name} is 0, the least that stability allows" for name in at_bound]
    covariance, freedom, source = problem.covariance(family, theta, free)
    fitted = family.law(theta)
    valid = ValidRange.of(problem.points.lam)
    unstable = unstable_from(fitted, valid)
    if unstable is not None:
        notes.append(
            f"not Drucker-stable from {unstable:.0%} of the tested range on; not for finite elements"
        )
    of_kind = {kind: [c for c in curves if c.test == kind] for kind in problem.kinds}
    return LawFit(
        family, theta, covariance, freedom, source, problem.misfit(family, theta),
        {kind: r_squared(*_pooled(alike, fitted)) for kind, alike in of_kind.items()},
        {kind: _ends([c.stretch for c in alike]) for kind, alike in of_kind.items()},
        {kind: len({n for c in alike for n in c.sample_names}) for kind, alike in of_kind.items()},
        valid, unstable, (*_few_rows(curves), *notes), loss, at_bound,
    )  # fmt: skip


@dataclass(frozen=True)
class Problem:
    """All points of all curves in one row (n), and the samples' readings at them (m rows).

    unit: what is independent of the others, a sample; stratum: the kind of test of a unit.
    """

    points: StressPoints
    mean: np.ndarray  # (n,) nominal stress averaged over samples
    weight: np.ndarray  # (n,)
    curve_sizes: tuple[int, ...]
    kinds: tuple[str, ...]
    row_point: np.ndarray  # (m,) index into the points
    row_stress: np.ndarray  # (m,)
    row_share: np.ndarray  # (m,) 1 / number of samples of the curve
    row_unit: np.ndarray  # (m,) index of the sample
    stratum: np.ndarray  # (units,) index of the kind of test
    row_pull: np.ndarray | None = None  # (m,) weight of a row by a robust loss, and
    row_curvature: np.ndarray | None = None  # (m,) its part in the Hessian

    @classmethod
    def of(cls, curves: list[MeanCurve]) -> Problem:
        """Return the problem of some curves."""
        kinds = tuple(dict.fromkeys(c.test for c in curves))
        power = {k: _spread(np.concatenate([c.nominal_stress for c in curves if c.test == k])) for k in kinds}
        units = list(dict.fromkeys(name for c in curves for name in c.sample_names))
        sizes = tuple(len(c.stretch) for c in curves)
        firsts = np.cumsum([0, *sizes])
        samples = [  # first point, stress (n,), share, unit
            (first, stress, 1 / len(c.sample_nominal_stress), units.index(name))
            for c, first in zip(curves, firsts)
            for name, stress in zip(c.sample_names, c.sample_nominal_stress)
        ]
        counts = [len(stress) for _, stress, _, _ in samples]
        lam, scale = (np.concatenate([getattr(c.points, name) for c in curves]) for name in ("lam", "scale"))
        return cls(
            StressPoints(lam, scale),
            np.concatenate([c.nominal_stress for c in curves]),
            np.concatenate([np.full(n, power[c.test] ** -0.5) for c, n in zip(curves, sizes)]),
            sizes,
            kinds,
            np.concatenate([np.arange(first, first + n) for (first, *_), n in zip(samples, counts)]),
            np.concatenate([stress for _, stress, _, _ in samples]),
            np.repeat([share for _, _, share, _ in samples], counts),
            np.repeat([unit for _, _, _, unit in samples], counts),
            np.array([kinds.index(name.split("/")[0]) for name in units]),
        )

    @property
    def stiffness(self) -> float:
        """Return a shear modulus [MPa] of the order of the curves'."""
        unit = self.points.scale * (self.points.lam[:, 0] ** 2 - self.points.lam[:, 2] ** 2)
        return float(np.abs(self.mean).sum() / np.abs(unit).sum())

    def misfit(self, family: Family, theta: np.ndarray) -> float:
        """Return the root of 1 - R2 averaged over the kinds of tests."""
        residual = self.weight * (family.stress(self.points, theta)[0] - self.mean)
        return float(np.sqrt(residual @ residual / len(self.kinds)))

    def solve(
        self, family: Family, start: np.ndarray | None = None, tolerance: float = NEIGHBOUR
    ) -> np.ndarray:
        """Return the best theta of all starts, or, to a tolerance, that next to a given one."""
        bounds = family.bounds(self.points, self.stiffness)
        if start is not None and not family.is_linear:
            return self._minimise(family, np.clip(start, *bounds), bounds, tolerance).x
        starts = family.starts(self.points, self.weight, self.mean, self.stiffness)
        if family.is_linear:
            return starts[0]
        solutions = sorted((self._minimise(family, s, bounds, COARSE) for s in starts), key=lambda s: s.cost)
        best = min((self._minimise(family, f.x, bounds, FINE) for f in solutions[:2]), key=lambda s: s.cost)
        return family.ordered(best.x)

    def _minimise(self, family, start, bounds, tolerance):
        return _least_squares(
            family, self.points, start, bounds, tolerance, lambda model: self.weight * (model - self.mean),
            lambda J: self.weight[:, None] * J,
        )  # fmt: skip

    def robust_solve(self, family: Family, theta: np.ndarray, loss: str) -> tuple[np.ndarray, Problem]:
        """Return theta under a robust loss over the samples' rows, and the problem with the weights it ends in."""
        weight = (self.weight[self.row_point] * np.sqrt(self.row_share))[:, None]
        bounds = family.bounds(self.points, self.stiffness)

        def residual(model):
            return weight[:, 0] * (model[self.row_point] - self.row_stress)

        for _ in range(2):  # the scale follows from the residuals, which follow from the scale
            r = residual(family.stress(self.points, theta)[0])
            scale = max(ROBUST_SCALE * float(np.median(np.abs(r))), 1e-9)
            solution = _least_squares(
                family, self.points, np.clip(theta, *bounds), bounds, 1e-12, residual,
                lambda J: weight * J[self.row_point], loss=loss, f_scale=scale,
            )  # fmt: skip
            theta = solution.x
        z = (residual(family.stress(self.points, theta)[0]) / scale) ** 2
        # soft_l1: rho(z) = 2 (sqrt(1 + z) - 1); derivative of the cost by a residual: r (1 + z)^(-1/2)
        return family.ordered(theta), replace(self, row_pull=(1 + z) ** -0.5, row_curvature=(1 + z) ** -1.5)

    def covariance(self, family: Family, theta: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, int, str]:
        """Return the covariance of theta (p, p), its degrees of freedom, and where it comes from.

        Sandwich over samples (White 1980; Liang & Zeger 1986): the points of one sample share its stiffness and
        thickness error, so a sample, not a point, is the independent unit. Samples are drawn within their kind of
        test, so scores are compared with the mean of their kind. With one sample of a kind, all samples are
        compared with each other, and with no more samples than parameters the points have to serve, as many as
        the correlation of neighbouring residuals leaves; that knows nothing of the scatter between samples.
        """
        model, J = family.stress(self.points, theta)
        J = J[:, free] * self.weight[:, None]
        rows = J[self.row_point]
        pull = 1.0 if self.row_pull is None else self.row_pull
        curvature = self.row_share * (1.0 if self.row_curvature is None else self.row_curvature)
        length = np.linalg.norm(J, axis=0)
        inverse = np.linalg.inv((rows / length).T @ (curvature[:, None] * rows / length))
        inverse = inverse / np.outer(length, length)
        residual = self.weight[self.row_point] * (self.row_stress - model[self.row_point])
        counts, p = np.bincount(self.stratum), J.shape[1]
        scores = np.zeros((len(self.stratum), p))
        np.add.at(scores, self.row_unit, (self.row_share * pull * residual)[:, None] * rows)
        if counts.min() >= 2:
            mean = np.stack([np.bincount(self.stratum, s) / counts for s in scores.T], axis=-1)
            scores = (scores - mean[self.stratum]) * np.sqrt(counts / (counts - 1))[self.stratum, None]
            freedom, source = counts.sum() - len(counts), "samples"
            C = inverse @ (scores.T @ scores) @ inverse
        elif len(scores) > p:
            freedom, source = len(scores) - p, "samples of all tests together"
            C = inverse @ (scores.T @ scores) @ inverse * len(scores) / freedom
        else:
            r = self.weight * (self.mean - model)
            n = effective_points(r, self.curve_sizes)
            freedom, source = max(1, int(n) - p), "points of single samples"
            C = inverse * (r @ r) / freedom
        full = np.zeros((len(theta),) * 2)
        full[np.ix_(free, free)] = C
        return full, int(freedom), source


def effective_points(residual: np.ndarray, sizes: tuple[int, ...]) -> float:
    """Return how many independent points the residuals of curves are worth.

    Neighbouring residuals r of a smooth curve are correlated; with the correlation rho of a first-order process n
    points are worth n (1 - rho) / (1 + rho) (Bayley & Hammersley 1946).

    Parameters
    ----------
    residual : numpy.ndarray
        (n,), curve after curve.
    sizes : tuple of int
        Points of each curve.

    Returns
    -------
    float
        At least 1 for each curve.
    """
    total = 0.0
    for r in np.split(residual, np.cumsum(sizes)[:-1]):
        rho = np.clip((r[1:] @ r[:-1]) / max(r @ r, 1e-300), 0.0, 0.999)
        total += max(len(r) * (1 - rho) / (1 + rho), 1.0)
    return total


def _spread(stress: np.ndarray) -> float:
    """Return the sum of squares about the mean, or a tenth of the sum of squares where that is more."""
    return max(((stress - stress.mean()) ** 2).sum(), LEAST_SPREAD * (stress**2).sum())


def _pooled(curves: list[MeanCurve], law: PrincipalLaw) -> tuple[np.ndarray, np.ndarray]:
    """Return measured and modelled nominal stress of all curves of a kind of test in one row."""
    measured = np.concatenate([c.nominal_stress for c in curves])
    return measured, np.concatenate([c.points.measured_stress(law) for c in curves])


def _ends(stretches: list[np.ndarray]) -> tuple[float, float]:
    return float(min(s[0] for s in stretches)), float(max(s[-1] for s in stretches))


def r_squared(measured: np.ndarray, model: np.ndarray) -> float:
    """Return 1 - residual over total sum of squares about the mean."""
    return float(1 - ((measured - model) ** 2).sum() / ((measured - measured.mean()) ** 2).sum())


def _least_squares(family, points, start, bounds, tolerance, residual, jacobian, **loss):
    """Return scipy's solution; stress and Jacobian come from one evaluation."""
    last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def evaluated(theta):
        key = theta.tobytes()
        if key not in last:
            last.clear()
            last[key] = family.stress(points, theta)
        return last[key]

    tolerances = dict.fromkeys(("ftol", "xtol", "gtol"), tolerance)
    return least_squares(
        lambda theta: residual(evaluated(theta)[0]),
        start,
        jac=lambda theta: jacobian(evaluated(theta)[1]),
        **dict(bounds=bounds, x_scale="jac", max_nfev=300) | tolerances | loss,
    )


def _check_rows(curves: list[MeanCurve], family: Family) -> None:
    rows, needed = sum(sum(c.row_counts) for c in curves), ROWS_PER_PARAMETER * len(family.parameters)
    if rows < needed:
        raise FitError(
            f"{family.title}: {rows} rows for {len(family.parameters)} parameters; {needed} at least are needed,"
            " add readings or take a simpler constitutive model"
        )


def _few_rows(curves: list[MeanCurve]) -> list[str]:
    few = [f"{c.label} ({max(c.row_counts)})" for c in curves if max(c.row_counts) < FEW_ROWS]
    remark = f"fewer than {FEW_ROWS} rows per specimen: the curve between them is not measured, and the intervals do not"
    return [f"{remark} include that: {', '.join(few)}"] if few else []


def _check_determined(problem: Problem, family: Family, theta: np.ndarray) -> np.ndarray:
    """Return which unknowns (p,) are inside their bounds; refuse what is undetermined."""
    low, high = family.bounds(problem.points, problem.stiffness)
    near = 1e-9 * problem.stiffness if family.is_linear else 1e-3
    at_bound = np.minimum(theta - low, high - theta) < near
    values = family.values(theta)[0]
    if at_bound.any() and (at_bound[0] or not family.is_linear):
        k = int(np.argmax(at_bound))
        stated = ", ".join(f"{n} = {v:.3g}" for n, v in zip(family.parameters, values))
        found = f"{family.parameters[k]} ran to the limit of its range ({stated})"
        raise Undetermined(f"{family.title}: {found}; {family.bound_means}")
    J = (problem.weight[:, None] * family.stress(problem.points, theta)[1])[:, ~at_bound]
    condition = np.linalg.cond(J / np.linalg.norm(J, axis=0))
    if not condition < WORST_CONDITION:
        found = f"condition {condition:.2g} of {WORST_CONDITION:.0g}"
        raise Undetermined(f"{family.title}: {found}; {family.bound_means}")
    return ~at_bound
