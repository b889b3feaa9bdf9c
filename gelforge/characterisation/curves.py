"""Curves of several samples, resampled on one stretch grid and averaged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.characterisation.material_tests import SampleCurve
from gelforge.mechanics.homogeneous import LOAD_CASES

GRID_POINTS = 120  # per test; twice as many change the stress fitted to the demo by 0.01 %


@dataclass(frozen=True)
class MeanCurve:
    """One test's samples on a common grid: stretch (n,), nominal stress of each sample (s, n) [MPa]."""

    test: str
    stretch: np.ndarray
    sample_nominal_stress: np.ndarray

    @property
    def nominal_stress(self) -> np.ndarray:
        """Return the nominal stress averaged over the samples (n,) [MPa]."""
        return self.sample_nominal_stress.mean(axis=0)


def mean_curves(curves: list[SampleCurve]) -> list[MeanCurve]:
    """Return one averaged curve per test, in the order of the load cases.

    The grid spans the stretches that every sample of the test reached, so that each point averages all
    samples.
    """
    return [_mean(test, group) for test in LOAD_CASES if (group := [c for c in curves if c.test == test])]


def _mean(test: str, curves: list[SampleCurve]) -> MeanCurve:
    low = max(c.stretch.min() for c in curves)
    high = min(c.stretch.max() for c in curves)
    if not low < high:
        raise ValueError(
            f"{test}: the samples share no stretch (from {low:g} to {high:g}); give them separate materials"
        )
    stretch = np.linspace(low, high, GRID_POINTS)
    return MeanCurve(test, stretch, np.array([_resampled(c, stretch) for c in curves]))


def _resampled(curve: SampleCurve, stretch: np.ndarray) -> np.ndarray:
    order = np.argsort(curve.stretch, kind="stable")  # small back-steps of the strain measurement
    return np.interp(stretch, curve.stretch[order], curve.nominal_stress[order])
