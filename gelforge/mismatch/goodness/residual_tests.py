"""What a model leaves of readings: the tests of whether that is noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.config.parts.mismatch import Mismatch
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.goodness.patterns import Atoms, dictionary
from gelforge.mismatch.goodness.scan import GlobalTest, Scan, global_test, scan, whitened
from gelforge.mismatch.terms.problem import Problem


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """What a model leaves of some readings, by chance or not."""

    test: GlobalTest
    scan: Scan
    unknown_p: float = 1.0  # bound on that of as much evidence for a discrepancy, where that was asked
    known_p: float = 1.0  # and for the known effects

    @property
    def p(self) -> float:
        return min(self.test.p, self.scan.p, self.unknown_p, self.known_p)


def residual_tests(
    problem: Problem,
    residual: np.ndarray,
    mask: np.ndarray,
    settings: Mismatch,
    rng: np.random.Generator,
    fitted: np.ndarray | None = None,
) -> ResidualTests:
    """Return both tests of a residual (m,) of some entries (n,) bool; fitted (m, p): columns that were fitted to them."""
    labels = problem.labels[mask].reset_index(drop=True)
    atoms = dictionary(labels, problem.observations.flat(problem.base)[mask])
    return both_tests(residual, problem.covariance.restricted(mask), atoms, rng, settings.draws, fitted)


def both_tests(
    residual: np.ndarray,
    covariance: Covariance,
    atoms: Atoms,
    rng: np.random.Generator,
    draws: int,
    fitted: np.ndarray | None = None,
) -> ResidualTests:
    """Return both tests of a residual (n,) by atoms that are not whitened."""
    white = whitened(atoms, covariance, fitted)
    found = scan(covariance.whiten(residual), white, rng, draws, covariance.estimated)
    return ResidualTests(global_test(residual, covariance, fitted), found)
