"""What a fit sees: the loading curves of all samples, those of one test on one stretch grid and averaged."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gelforge.materials.basis.common_form import LOAD_CASE_OF, MaterialTest
from gelforge.materials.basis.stresses import LEAST_STRAIN
from gelforge.materials.covariates.effects import first_loading
from gelforge.mechanics.laws.homogeneous import StressPoints, stress_points

# Per test: as measured on the demo, twice as many change the fitted stress by 0.01 %.
GRID_POINTS = 120


@dataclass(frozen=True)
class MeanCurve:
    """One test's samples on a common grid: stretch (n,), nominal stress of each sample (s, n) [MPa].

    stretch_2 (n,) belongs to a biaxial test. component says which stress it is: "1" along the load, "2" across it,
    "1-2" the Cauchy difference divided by the stretch.
    """

    test: str
    stretch: np.ndarray
    sample_nominal_stress: np.ndarray
    stretch_2: np.ndarray | None = None
    component: str = "1"
    samples: tuple[str, ...] = ()
    rows: tuple[int, ...] = ()  # of each sample as measured, before it was put on the grid
    part: str = ""  # distinguishes curves of one test, e.g. biaxial ones of different second stretch

    @property
    def nominal_stress(self) -> np.ndarray:
        """Return the nominal stress averaged over the samples (n,) [MPa]."""
        return self.sample_nominal_stress.mean(axis=0)

    @property
    def label(self) -> str:
        """Return the name of the curve: the test, and its part and component where it has several."""
        component = {"2": "P22", "1-2": "difference"}.get(self.component)
        return " ".join(filter(None, (self.test, self.part, component)))

    @property
    def sample_names(self) -> tuple[str, ...]:
        """Return one name per sample; curves of one sample share it."""
        names = self.samples or tuple(str(k) for k in range(len(self.sample_nominal_stress)))
        return tuple(f"{self.test}/{name}" for name in names)

    @property
    def row_counts(self) -> tuple[int, ...]:
        """Return how many rows each sample was measured at; those of the grid where that is not known."""
        return self.rows or (len(self.stretch),) * len(self.sample_nominal_stress)

    @property
    def cauchy_stress(self) -> np.ndarray:
        """Return the averaged stress per current area (n,) [MPa]; the shear stress in simple shear."""
        return self.nominal_stress if self.test == "simple_shear" else self.nominal_stress / self.points.scale

    @cached_property
    def points(self) -> StressPoints:
        """Return the measured states, in which a law predicts the nominal stress."""
        return stress_points(LOAD_CASE_OF[self.test], self.stretch, self.stretch_2, self.component)


def mean_curves(tests: list[MaterialTest]) -> list[MeanCurve]:
    """Return one averaged curve per test and measured stress, in the order of LOAD_CASE_OF.

    The grid spans the stretches that every sample of the test reached: each point averages all samples. A single sample
    with few rows keeps its own. Biaxial samples are not averaged: each has its own second stretch.

    Parameters
    ----------
    tests : list of MaterialTest
        Of one material; stretch [-] and nominal stress [MPa].

    Returns
    -------
    list of MeanCurve
        Stretch (n,) [-] and nominal stress of each sample (s, n) [MPa].
    """
    curves = []
    for kind in LOAD_CASE_OF:
        group = [t for t in tests if t.test == kind]
        if kind == "biaxial":
            curves += [c for t in group for c in _curves(kind, [t], t.sample)]
        elif group:
            curves += _curves(kind, group)
    return curves


def sample_curves(test: MaterialTest) -> list[MeanCurve]:
    """Return the curves of one sample as measured, one for each stress, by stretch."""
    return _curves(test.test, [test], test.sample if test.test == "biaxial" else "", grid_points=10**9)


def monotonic_loading(tests: list[MaterialTest]) -> tuple[list[MaterialTest], list[str]]:
    """Return the parts of tests to which an elastic law can be fitted, and what was left out, in words.

    Of a cyclic test only the first loading is taken, for the virgin material, and no test of a later cycle. Relaxation
    tests are left out, unless there is nothing else: then their ramps are taken, without the holds.

    Parameters
    ----------
    tests : list of MaterialTest
        Of one material.

    Returns
    -------
    list of MaterialTest
        Loadings.
    list of str
        What was left out.
    """
    held = [t for t in tests if t.history == "relaxation"]
    kept, notes = _loadings([t for t in tests if t.history != "relaxation"])
    if kept:
        why = "a relaxation test is not fitted by an elastic model; left out"
        return kept, notes + [f"{t.test} {t.sample}: {why}" for t in held]
    ramps, more = _loadings(held)
    return ramps, [*notes, *more]


def _loadings(tests: list[MaterialTest]) -> tuple[list[MaterialTest], list[str]]:
    kept, notes = [], []
    for t in tests:
        name = f"{t.test} {t.sample}"
        if t.test not in LOAD_CASE_OF:
            notes.append(f"{name}: not fitted by an elastic model; left out")
        elif t.cycle is not None and t.cycle > 1:
            notes.append(f"{name}: cycle {t.cycle} of a softened sample is not fitted; left out")
        elif t.history == "monotonic":
            kept.append(t)
        elif any(s.kind == "load" for s in t.segments):
            first = first_loading(t)
            if t.history == "relaxation":  # what follows the largest stress already relaxes
                first = first.part(slice(0, int(np.nanargmax(np.abs(first.nominal_stress))) + 1))
            if np.ptp(first.stretch) < LEAST_STRAIN:
                notes.append(f"{name}: its loading is no ramp of {LEAST_STRAIN:g} of stretch; left out")
                continue
            kept.append(first)
            notes.append(f"{name}: of the {t.history} test only the first loading is fitted")
        else:
            notes.append(f"{name}: no loading found in the {t.history} test; left out")
    return kept, notes


def _curves(kind: str, group: list[MaterialTest], part: str = "", grid_points=GRID_POINTS) -> list[MeanCurve]:
    """Return the curves of one test: one for each stress that its samples measured."""
    curves = []
    for component, name in (("1", "nominal_stress"), ("2", "nominal_stress_2"), ("1-2", "cauchy_difference")):
        if component == "2" and kind not in ("biaxial", "pure_shear"):
            continue  # zero in uniaxial tests, and the same as along the load in equibiaxial ones
        measured = [(t, s) for t in group if (s := _finite(t, name)) is not None]
        if measured:
            curves.append(_mean(kind, component, measured, part, grid_points))
    return curves


def _finite(test: MaterialTest, name: str) -> tuple[np.ndarray, ...] | None:
    """Return stretch, stress and second stretch (NaN if unknown) of the rows with a stress, by stretch; or None."""
    values = getattr(test, name)
    if values is None or np.isfinite(values).sum() < 2:
        return None
    lateral = np.full(len(values), np.nan) if test.stretch_2 is None else test.stretch_2
    stress = values / test.stretch if name == "cauchy_difference" else values
    rows = np.flatnonzero(np.isfinite(stress) & np.isfinite(test.stretch))
    rows = rows[np.argsort(test.stretch[rows], kind="stable")]  # small back-steps of the strain measurement
    return test.stretch[rows], stress[rows], lateral[rows]


def _mean(kind: str, component: str, measured: list, part: str, grid_points: int) -> MeanCurve:
    low = max(stretch[0] for _, (stretch, _, _) in measured)
    high = min(stretch[-1] for _, (stretch, _, _) in measured)
    if not low < high:
        span = f"from {low:g} to {high:g}"
        raise ValueError(f"{kind}: the samples share no stretch ({span}); give them separate materials")
    first, first_stress, first_lateral = measured[0][1]
    grid = first if len(measured) == 1 and len(first) <= grid_points else np.linspace(low, high, grid_points)
    stress = np.array([np.interp(grid, x, s) for _, (x, s, _) in measured])
    lateral = np.mean([np.interp(grid, x, l) for _, (x, _, l) in measured], axis=0)
    if len(grid) == len(first) and len(measured) == 1:  # interpolation would merge rows of equal stretch
        stress, lateral = first_stress[None], first_lateral
    lateral = lateral if kind == "biaxial" else None
    samples, rows = tuple(t.sample for t, _ in measured), tuple(len(x) for _, (x, _, _) in measured)
    return MeanCurve(kind, grid, stress, lateral, component, samples, rows, part)
