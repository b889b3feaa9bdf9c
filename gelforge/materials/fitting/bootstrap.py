"""Bootstrap over samples: the scatter of a law when the samples of each test are drawn again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from gelforge.materials.fitting.curves import MeanCurve
from gelforge.materials.fitting.fit import FitError, LawFit, Problem
from gelforge.mechanics.laws.family import Family
from gelforge.workers import each

CHUNKS = "bootstrap, 125 refits each"  # each refit has a seed of its own


@dataclass(frozen=True)
class Bootstrap:
    """The unknowns (B, p) of a law refitted to B redrawn sets of samples."""

    family: Family
    theta: np.ndarray
    freedom: int  # samples beyond one per test

    @property
    def parameters(self) -> np.ndarray:
        """Return the parameters (B, p) in the units of files."""
        return np.array([self.family.values(theta)[0] for theta in self.theta])

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (p, p) of the parameters in the units of files."""
        return np.atleast_2d(np.cov(self.parameters, rowvar=False))

    def interval(self, quantity: np.ndarray, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Return the ends (...) of the interval of a quantity (B, ...) computed from each refit.

        Percentiles are set further apart by Student's t, as few samples know their own scatter badly (Hesterberg
        2015, doi 10.1080/00031305.2015.1089789, sec. 5.3).
        """
        tail = norm.cdf(-student.ppf(0.5 + level / 2, self.freedom))
        return np.quantile(quantity, tail, axis=0), np.quantile(quantity, 1 - tail, axis=0)


def bootstrap(
    curves: list[MeanCurve], fit: LawFit, replicates: int, seed: int, workers: int = 1
) -> Bootstrap:
    """Return refits of a fitted law to samples drawn again, with replacement, within each test.

    Deviations from the mean are stretched by sqrt(n / (n - 1)), n samples of a test, without which n samples would
    scatter too little. Each refit starts at the law and has its own seed: the number of workers changes nothing.
    Raises FitError where a test has one sample only.
    """
    single = [c.label for c in curves if len(c.sample_nominal_stress) < 2]
    if single:
        raise FitError(
            f"{', '.join(single)}: one sample; a bootstrap over samples needs two of each test at least, add samples"
            " or use the sandwich covariance"
        )
    seeds = np.array(np.random.SeedSequence(seed).spawn(replicates), object)
    chunks = np.array_split(seeds, -(-replicates // 125))
    refit = partial(_refits, curves, fit.family, fit.theta)
    theta = each(refit, chunks, workers, CHUNKS)
    return Bootstrap(fit.family, np.concatenate(theta), sum(fit.samples.values()) - len(fit.samples))


def _refits(curves: list[MeanCurve], family: Family, start: np.ndarray, seeds) -> np.ndarray:
    problem = Problem.of(curves)
    means = (_redrawn(curves, np.random.default_rng(seed)) for seed in seeds)
    return np.array([replace(problem, mean=mean).solve(family, start) for mean in means])


def _redrawn(curves: list[MeanCurve], rng: np.random.Generator) -> np.ndarray:
    """Return the mean curves (n,) of samples drawn again; curves of one sample are drawn together."""
    drawn: dict[tuple, np.ndarray] = {}
    parts = []
    for c in curves:
        n = len(c.sample_nominal_stress)
        if c.sample_names not in drawn:
            drawn[c.sample_names] = np.bincount(rng.integers(n, size=n), minlength=n)
        surplus = (drawn[c.sample_names] - 1) / n * np.sqrt(n / (n - 1))
        parts.append(c.nominal_stress + surplus @ c.sample_nominal_stress)
    return np.concatenate(parts)
