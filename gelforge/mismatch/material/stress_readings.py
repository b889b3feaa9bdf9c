"""Stress tests next to the law of their fastest loading branch.

The law, an incompressible solid's or a foam's where that comes closer, is fitted to one loading of one sample. What another
branch may differ by without any missing physics: the instrument, the zero of force and of strain, the law's own misfit and
covariance, and that samples made alike differ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.statistics import row_noise
from gelforge.materials.covariates.circumstances import alike_groups
from gelforge.materials.covariates.effects import NEGLIGIBLE, RATE, scatter_between
from gelforge.materials.fitting.choice import compare_laws
from gelforge.materials.fitting.curves import MeanCurve, mean_curves, monotonic_loading
from gelforge.materials.fitting.fit import LawFit, Problem, effective_points
from gelforge.materials.plausibility.findings import STRAIN_AT_START
from gelforge.mechanics.laws.homogeneous import stress_points
from gelforge.mismatch.material.material_readings import (
    FORCE_CLASS,
    Readings,
    binned,
    means,
    misfit_covariance,
    reduced,
)

SOLIDS = ("neo_hooke", "mooney_rivlin", "yeoh", "gent", "ogden1", "ogden2")

# Nominal stress (n,) [MPa] at stretches (n,), and its derivatives by the law's unknowns (n, p).
Stress = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
KINDS = ("uniaxial", "compression", "pure_shear", "equibiaxial", "simple_shear")  # one stress for one stretch
ZERO_STRAIN = STRAIN_AT_START  # slack that a test may begin with
SAMPLES = NEGLIGIBLE, 2  # scatter of samples of one sheet, weighed as so many repeats next to those measured


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
            # beyond an exponent of 60 the stress follows from mu / alpha alone
            bounds=([-np.inf, -60.0], [np.inf, 60.0]), x_scale="jac",
        )  # fmt: skip

    # begun where a foam densifies, and where it gives in
    best = min((fitted(alpha) for alpha in (-8.0, 2.0, 8.0, 25.0)), key=lambda found: found.cost)
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


@dataclass(frozen=True)
class Path:
    """One test along its time: m rows up to where it leaves the range of the law, and which rows make a reading."""

    test: MaterialTest
    time_s: np.ndarray  # (m,)
    stress: np.ndarray  # (m,) [MPa] of the base law
    slope: np.ndarray  # (m,) [MPa] of the same over strain
    strain: np.ndarray  # (m,) distance from rest, positive
    branches: tuple[tuple[int, np.ndarray], ...]  # number of the segment, and rows averaged into one reading
    started_s: float  # when it left rest

    def reduced(self, values: np.ndarray) -> np.ndarray:
        """Return values (m, ...) averaged into readings (k, ...)."""
        return means([rows for _, rows in self.branches], values)


@dataclass(frozen=True)
class StressTests:
    """The readings of one material's stress tests, and what changes need to know of their histories."""

    readings: Readings
    paths: tuple[Path, ...]
    bases: dict[str, MaterialTest]  # by kind of test: whose fastest loading the law is fitted to

    def reach(self, kind: str) -> float:
        """Return the range of strain of a kind's nominal loading."""
        return _reach(self.bases[kind])


def stress_tests(tests: list[MaterialTest]) -> StressTests:
    """Return the readings of stress tests next to their base laws; raises ValueError (FitError) where there is none."""
    usable = [t for t in tests if t.test in KINDS and t.cauchy_difference is None]
    said = [f"{t.sample}: tests of kind {t.test} are not judged" for t in tests if t.test not in KINDS]
    timed = [t for t in usable if t.time_s is not None or t.rate_per_s]
    said += [
        f"{t.sample}: neither time nor rate is stated, so it is not known where it belongs; left out"
        for t in usable
        if t not in timed
    ]
    bases, laws = {}, {}
    for kind in dict.fromkeys(t.test for t in timed):
        loading = fastest_loading([t for t in timed if t.test == kind])
        if loading is None:
            said.append(f"{kind}: no loading to fit a constitutive model to; not judged")
            continue
        bases[kind] = loading
        laws[kind] = base_law(mean_curves(monotonic_loading([loading])[0]), kind)
    if not laws:
        raise ValueError(
            f"{'; '.join(said) or 'no stress test'}: a nominal model needs a loading with a time or a rate"
        )
    paths = _paths([t for t in timed if t.test in laws], laws, bases)
    scatter = _scatter(timed)
    said += [
        *_assumed(paths),
        f"specimens made alike are taken to scatter by {scatter:.1%} in stress: a factor of that size between"
        " specimens, and an offset or a gain of a single test's force, cannot be distinguished from it and are no"
        " physics here",
    ]
    words = " and ".join(
        f"{laws[kind].title} fitted to the loading of specimen {t.sample} ({kind.replace('_', ' ')}) at"
        f" {t.rate_per_s:.3g} 1/s"
        for kind, t in bases.items()
    )
    words += "; stresses are forces on 1 mm2 of undeformed section"
    return StressTests(_readings(paths, laws, bases, scatter, tuple(said), words), tuple(paths), bases)


def fastest_loading(tests: list[MaterialTest]) -> MaterialTest | None:
    """Return the test whose loading was the fastest; of rates alike the least treated, youngest, farthest strained."""
    loading = [t for t in tests if t.rate_per_s and t.cycle in (None, 1) and _loads(t)]
    loading = [t for t in loading if len(monotonic_loading([t])[0])]
    rates = [float(t.rate_per_s or 0.0) for t in loading]
    fast = [t for t, rate in zip(loading, rates) if np.log10(max(rates) / rate) <= RATE.alike]
    return min(
        fast, key=lambda t: (t.dose or 0.0, t.age_days or 0.0, -_reach(t), t.sample), default=None
    )  # fmt: skip


def _loads(test: MaterialTest) -> bool:
    return any(s.kind == "load" for s in test.segments)


def _reach(test: MaterialTest) -> float:
    return float(np.abs(test.stretch - test.at_rest).max())


def _away(test: MaterialTest) -> float:
    """Return the sign of the strain: stress and strain are positive in what follows, in compression too."""
    return float(np.sign(test.stretch[np.argmax(np.abs(test.stretch - test.at_rest))] - test.at_rest)) or 1.0


def _paths(tests, laws: dict[str, BaseLaw], bases) -> list[Path]:
    kept = []
    for test in tests:
        away, reach = _away(test), max(abs(end - test.at_rest) for end in laws[test.test].valid)
        strain = away * (test.stretch - test.at_rest)
        # what lies 10 % beyond the range that the law was fitted in is not judged
        inside = (strain <= 1.1 * reach) & np.isfinite(test.nominal_stress)
        m = len(inside) if inside.all() else int(np.argmin(inside))
        if m >= 2 and away == _away(bases[test.test]):
            kept.append((test, m))
    segments = sum(sum(s.start < m - 1 for s in t.segments) for t, m in kept)
    count = int(np.clip(600 // max(segments, 1), 4, 24))  # rows of a branch; the covariance of all is dense
    return [_path(t, m, laws[t.test], count) for t, m in kept]


def _path(test: MaterialTest, m: int, law: BaseLaw, count: int) -> Path:
    away, stretch, step = _away(test), test.stretch[:m], 1e-4
    strain = away * (stretch - test.at_rest)
    if test.time_s is not None:
        time = np.asarray(test.time_s[:m], dtype=float)
    else:
        time = np.r_[0, np.cumsum(np.abs(np.diff(strain)))] / test.rate_per_s
    held = test.history == "relaxation" and test.segments and test.segments[0].kind == "hold"
    before = 0.0 if held or not test.rate_per_s else max(strain[0], 0.0) / test.rate_per_s
    branches = []
    for number, segment in enumerate(test.segments):
        rows = np.arange(segment.start, min(segment.stop, m))
        if len(rows) >= 2:
            x = _log_time(time[rows]) if segment.kind == "hold" else strain[rows]
            branches += [(number, group) for group in binned(x, rows, count)]
    stress = law.stress(stretch)[0]
    slope = away * (stress - law.stress(stretch - away * step)[0]) / step
    started = min(0.0, time[0]) if held else time[0] - before
    return Path(test, time, away * stress, slope, strain, tuple(branches), float(started))


def _log_time(time: np.ndarray) -> np.ndarray:
    since = time - time[0]
    return np.log(np.maximum(since, since[since > 0].min(initial=since[-1] + 1e-9)))


def _assumed(paths: list[Path]) -> list[str]:
    by_rate = [p.test.sample for p in paths if p.test.time_s is None]
    cut = [p.test.sample for p in paths if len(p.time_s) < len(p.test.stretch)]
    said = (
        (by_rate, "no time is recorded; unloading is taken to have gone at the stated rate of loading, and holds between"
         " them cannot be seen"),
        (cut, "not judged from where the strain leaves the range in which the nominal model was fitted"),
    )  # fmt: skip
    return [f"{', '.join(samples)}: {text}" for samples, text in said if samples]


def _scatter(tests: list[MaterialTest]) -> float:
    """Return the standard deviation of a sample's factor: repeats where there are some, shrunk to what sheets scatter by."""
    usual, repeats = SAMPLES
    groups = [g for g in alike_groups([t for t in tests if _loads(t)]) if len(g) > 1]
    try:
        between = scatter_between(groups)
    except ValueError:
        return usual
    squares = between.freedom * between.deviation**2 + repeats * usual**2
    return float(np.sqrt(squares / (between.freedom + repeats)))


def _readings(paths: list[Path], laws, bases, scatter: float, said: tuple[str, ...], words: str) -> Readings:
    """Return the readings with the covariance of what a prediction errs by (see Readings)."""
    table = pd.concat([_rows(number, p, bases) for number, p in enumerate(paths)], ignore_index=True)
    table["segment"] = table.groupby(["path", "part"], sort=False).ngroup()

    def all_of(values):
        return np.concatenate([p.reduced(values(p)) for p in paths])

    measured = all_of(lambda p: p.test.nominal_stress[: len(p.time_s)] * _away(p.test))
    base, slope = all_of(lambda p: p.stress), all_of(lambda p: p.slope)
    number, share = table["path"].to_numpy(), table["share"].to_numpy()
    same = number[:, None] == number
    force = FORCE_CLASS * np.array([np.abs(measured[number == k]).max() for k in range(len(paths))])[number]
    count = np.concatenate([[len(rows) for _, rows in p.branches] for p in paths])
    rows = np.array([row_noise(p.test.nominal_stress[: len(p.time_s)]) for p in paths])
    noise = np.hypot(rows[number] / np.sqrt(count), force)
    # errors of a sample, of its strain and of the law are shares of the stress that is there, however much of it relaxed
    law = np.zeros((len(base), len(base)))
    for kind, fit in laws.items():
        here = (table["test"] == kind).to_numpy()
        fitted_rows = here & table["is_base"].to_numpy()
        misfit = float(np.sqrt(np.mean((measured - base)[fitted_rows] ** 2)))
        # beyond its range the polynomial's errors are not the law's
        J = fit.stress(np.clip(table["at"][here].to_numpy(), *fit.valid))[1]
        law[np.ix_(here, here)] = J @ fit.covariance @ J.T + misfit_covariance(share[here], misfit)
    sample = pd.factorize(table["sample"])[0]
    other = ~table["sample"].isin([t.sample for t in bases.values()]).to_numpy()
    # both samples are drawn: other and base
    together = np.outer(other, other) * ((sample[:, None] == sample) + 1.0)
    shared = law + ZERO_STRAIN**2 * np.outer(slope, slope) * same
    for pattern, size in ((base, scatter), (base * (2 * share - 1), scatter / 2)):
        shared += size**2 * np.outer(pattern, pattern) * together
    return Readings(
        table, measured, base, np.diag(noise**2) + force**2 * same, noise, np.sqrt(np.diag(law)),
        FORCE_CLASS * float(np.abs(measured).max()), words, said, (table["test"] == "compression").to_numpy(), shared,
    )  # fmt: skip


def _rows(number: int, path: Path, bases) -> pd.DataFrame:
    test, base = path.test, bases[path.test.test]
    kinds = [s.kind for s in test.segments]
    first_unload = kinds.index("unload") if "unload" in kinds else len(kinds)
    part = np.array([k for k, _ in path.branches], dtype=int)
    columns = {
        "at": test.stretch[: len(path.time_s)],
        "share": path.strain / _reach(base),
        "time_s": path.time_s,
    }
    table = reduced([rows for _, rows in path.branches], part, **columns)
    branch = np.array(kinds)[part]
    is_base = (test is base) & (branch == "load") & (part < first_unload)
    return table.assign(
        path=number, test=test.test, sample=test.sample, part=part, branch=branch, is_base=is_base
    )
