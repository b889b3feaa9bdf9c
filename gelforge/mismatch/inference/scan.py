"""Is there a mismatch, and where: a global test, and a scan over places, depths, times and axes that pays for looking.

Before either is asked, single readings whose error no neighbour shares are left out: glitches of a force sensor. No effect
changes one reading of one indentation by many standard deviations and leaves its neighbours in depth, time and place as they
are. One such reading is evidence for something that differs from one indentation to the next, though, and would be reported
as that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from gelforge.config.parts.mismatch import Mismatch
from gelforge.mismatch.evidence.covariance import Covariance, Estimated
from gelforge.mismatch.evidence.kernels import kernels_of
from gelforge.mismatch.evidence.problem import Problem, never_solved
from gelforge.mismatch.inference.patterns import AXES, Atoms, Pattern, dictionary
from gelforge.mismatch.readings.observations import Observations, SetAside

DRAWS = Mismatch.model_fields["draws"].default  # the p-value of the maximum then moves by 0.0035 at 0.025
# Standard deviations from what all other readings say of it. Normal noise goes beyond once in 1.7 million readings; readings
# that are off by 15 are found next to any effect (tests/mismatch/test_spikes.py).
SPIKE = 5.0
MOST = 0.004  # of the entries, at least one: what strikes more of them is no glitch


@dataclass(frozen=True)
class Scan:
    """What the scan found, strongest first, and the probability of a maximum as large without any mismatch."""

    ranked: tuple[Pattern, ...]
    p: float

    @property
    def best(self) -> Pattern:
        """Return the strongest pattern."""
        return self.ranked[0]


@dataclass(frozen=True)
class GlobalTest:
    """Sum of squares of the whitened residual against its law without any mismatch."""

    chi2: float
    degrees: int
    p: float


def global_test(residual: np.ndarray, covariance: Covariance, fitted: np.ndarray | None = None) -> GlobalTest:
    """Return the test of r' C^-1 r.

    Nuisances are part of C and not fitted, so without a mismatch the sum has the chi-square law with n degrees, exactly
    for normal draws: a parametric bootstrap gives the same p. Fitted columns take their degrees with them, so that what was
    fitted neither helps nor harms. Of variances that were estimated the sum has an F law, and heavy tails widen it: a
    chi-square law of the same mean and variance stands for it (Satterthwaite 1946, doi:10.2307/3002019).

    Parameters
    ----------
    residual : numpy.ndarray
        r (n,) [N].
    covariance : Covariance
        C.
    fitted : numpy.ndarray, optional
        (n, p), columns of a model with fitted values.

    Returns
    -------
    GlobalTest
        Sum of squares [-], degrees of freedom and p.
    """
    white, degrees = covariance.whiten(residual), len(residual)
    if fitted is not None:
        Q = _basis(covariance.whiten(fitted))
        white, degrees = white - Q @ (Q.T @ white), degrees - Q.shape[1]
    square = float(white @ white)
    mean, variance = float(degrees), 2.0 * degrees
    if covariance.estimated is not None:
        mean, variance = _law_of_sum(covariance.estimated, degrees)
    p = chi2_distribution.sf(2 * mean * square / variance, 2 * mean**2 / variance)
    return GlobalTest(square, degrees, float(p))


def _law_of_sum(estimated: Estimated, degrees: int) -> tuple[float, float]:
    """Return mean and variance of the sum of squares of whitened draws whose variances were estimated."""
    count = np.bincount(estimated.group, minlength=len(estimated.repeats)) * degrees / len(estimated.group)
    freedom = estimated.repeats / estimated.tails
    bias = 1 / (1 - 2 / np.maximum(freedom, 4.0))
    variance = 2 * estimated.tails * count + 2 * count**2 / freedom
    return float(np.sum(count * bias)), float(np.sum(variance * bias**2))


def _basis(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, rank) of columns (n, p)."""
    norms = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return U[:, s > 1e-8 * s.max(initial=0)]  # columns that rounding distinguishes are one


def whitened(atoms: Atoms, covariance: Covariance, fitted: np.ndarray | None = None) -> Atoms:
    """Return the atoms with W values, less what the columns fitted (n, p) [N] of a model could have taken up."""
    values = np.empty_like(atoms.values)
    for first in range(0, values.shape[1], 128):  # of 120 000 entries these take 120 MB
        part = slice(first, first + 128)
        values[:, part] = covariance.whiten(atoms.values[:, part])
    if fitted is not None:
        Q = _basis(covariance.whiten(fitted))
        values -= Q @ (Q.T @ values)
    return replace(atoms, values=values)


def scan(
    residual: np.ndarray,
    atoms: Atoms,
    rng: np.random.Generator,
    draws: int = DRAWS,
    estimated: Estimated | None = None,
) -> Scan:
    """Return the scan of a whitened residual (n,) by whitened atoms, p for the maximum over all of them.

    An atom's score is z = a'r / |a|. Without a mismatch the scores are jointly normal with the atoms' cosines as
    covariance; the largest |z| of that many draws is compared, so p pays for looking everywhere. Where variances were
    estimated (from repeats), each draw has errors of theirs too.
    """
    norms = np.linalg.norm(atoms.values, axis=0)
    here = np.flatnonzero(norms > 1e-9 * norms.max(initial=0))  # the others are zero on these readings
    if not len(here):
        raise ValueError("no pattern changes these readings; give readings whose nominal forces are not zero")
    unit = atoms.values[:, here] / norms[here]
    z = unit.T @ residual
    l, E = np.linalg.eigh(unit.T @ unit)
    root = E * np.sqrt(np.maximum(l, 0))
    drawn = np.abs(root @ rng.standard_normal((len(here), draws)))
    if estimated is not None:
        drawn *= np.sqrt(_variance_ratios(unit, estimated, rng, draws))
    p = (1 + np.sum(drawn.max(axis=0) >= np.abs(z).max())) / (1 + draws)
    ranked = tuple(replace(atoms.patterns[here[k]], z=float(z[k])) for k in np.argsort(-np.abs(z)))
    return Scan(ranked, float(p))


def _variance_ratios(
    unit: np.ndarray, estimated: Estimated, rng: np.random.Generator, draws: int
) -> np.ndarray:
    """Return draws (m, draws) of true over estimated variance of unit atoms (n, m), by the groups on which they lie."""
    groups = range(estimated.group.max() + 1)
    shares = np.stack([(unit[estimated.group == k] ** 2).sum(axis=0) for k in groups], axis=1)
    ratios = np.ones((len(groups), draws))
    for k, freedom in zip(groups, estimated.repeats / estimated.tails):
        if np.isfinite(freedom):
            ratios[k] = freedom / rng.chisquare(freedom, draws)
    return shares @ ratios


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
    draws: int,
    rng: np.random.Generator,
    fitted: np.ndarray | None = None,
    atoms: Atoms | None = None,
) -> ResidualTests:
    """Return both tests of a residual (n,); fitted (n, p): columns that were fitted; atoms: in place of the dictionary's."""
    covariance = problem.covariance
    if atoms is None:
        atoms = dictionary(problem.labels, problem.observations.flat(problem.base))
    white = whitened(atoms, covariance, fitted)
    scanned = scan(covariance.whiten(residual), white, rng, draws, covariance.estimated)
    return ResidualTests(global_test(residual, covariance, fitted), scanned)


def without_spikes(observations: Observations, base: np.ndarray, covariance: Covariance) -> Observations:
    """Return the observations without single entries far off all others; each is reported in `set_aside`.

    base (R, 3) [N]; covariance of the n entries. What strikes several readings of one indentation the judge must explain:
    that press keeps them. So do all where more than MOST are far off.
    """
    away = spikes(Problem(observations, base, covariance, (), {}, never_solved, {}))
    labels = observations.labels().iloc[list(away)].assign(away=away.values())
    labels = labels[labels.groupby("press")["reading"].transform("nunique") == 1]
    if labels.empty or len(labels) > max(1, MOST * len(covariance)):
        return observations
    force = observations.force.copy()
    force[labels["reading"], labels["axis"]] = np.nan
    reported = tuple(
        SetAside(
            session=row.session,
            press=row.press.removeprefix(f"{row.session}/"),
            time_s=row.time_s,
            depth_mm=row.depth_mm,
            axis=AXES[row.axis],
            size=round(abs(row.away), 1),
            reason="far from what the other readings of its indentation, place and depth say of it",
        )
        for row in labels.itertuples()
    )
    return replace(observations, force=force, set_aside=(*observations.set_aside, *reported))


def spikes(problem: Problem) -> dict[int, float]:
    """Return the entries far off all others, by number, and how far [standard deviations]; found one by one.

    Whatever is smooth in depth, place, time or path, or in the depth of one indentation, is free to three times what is
    plausible, 30 % of the force. How far: r_i less its mean given all other entries, over its standard deviation, which is
    (C^-1 r)_i / sqrt((C^-1)_ii).
    """
    covariance, residual = _with_room(problem), problem.residual
    left = np.arange(len(residual))
    distance: dict[int, float] = {}
    while len(distance) <= max(1, MOST * len(residual)):
        part = covariance.restricted(left)
        white = part.whiten(residual[left])
        tried = np.argsort(-np.abs(white))[:200]
        single = np.zeros((len(left), len(tried)))
        single[tried, np.arange(len(tried))] = 1.0
        columns = part.whiten(single)
        away = columns.T @ white / np.linalg.norm(columns, axis=0)
        farthest = np.argmax(np.abs(away))
        if abs(away[farthest]) <= SPIKE:
            break
        distance[int(left[tried[farthest]])] = float(away[farthest])
        left = np.delete(left, tried[farthest])
    return distance


def _with_room(problem: Problem) -> Covariance:
    """Return the covariance with room for whatever is not a single reading's."""
    rounding = problem.observations.flat(problem.observations.rounding_N)
    # a reading that falls into the next step is no spike: as if each were rounded by itself, too
    covariance = problem.covariance.scattering(rounding**2)
    kernels = kernels_of(problem)
    kernels.sort(key=lambda kernel: kernel.groups is None)  # those of each indentation before what all share
    for kernel in kernels:
        covariance = kernel.added_to(covariance, 3.0)
    return covariance
