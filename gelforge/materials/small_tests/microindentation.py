r"""Young's modulus from pressing a ball into a layer, and adhesion from pulling it off.

Hertz with the correction for a thin layer bonded to a rigid base (Dimitriadis et al. 2002, doi
10.1016/S0006-3495(02)75620-8, eq. 13, incompressible), chi = sqrt(R d) / h:

.. math:: F = \tfrac{16}{9} E \sqrt{R} d^{3/2} [1 + 1.133 \chi + 1.283 \chi^2 + 0.769 \chi^3 + 0.0975 \chi^4].

The contact point is searched for: at each candidate the rest follows by linear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from gelforge.materials.basis.common_form import IndentationTest
from gelforge.materials.basis.statistics import ROWS_OF_SCATTER, percentile_interval, resampled
from gelforge.robust import SIGMA_OF_MEDIAN

# Of an incompressible bonded layer (Dimitriadis et al. 2002, eq. 13).
COEFFICIENTS = (1.133, 1.283, 0.769, 0.0975)
# Dimitriadis et al. 2002 compare with finite elements up to about here.
LARGEST_CHI = 1.0
LARGEST_DEPTH_TO_RADIUS = 0.3  # the parabola stands for the ball: Hertz is then off by less than 5 %
# of the travel in contact; the sample's share is then the small difference of large numbers
LARGEST_GIVE = 0.7
# The modulus is found to 1 %, and 95 % intervals hold it in 34 of 40 draws at least (tests/materials/test_small_tests.py):
LEAST_ROWS = ROWS_OF_SCATTER  # in contact
BEFORE_START = 0.05  # of the travel: machines that zero where they touch begin so near to the contact
AT_TOUCH = 0.98  # share of rows in contact from which there is none left that shows the force at rest
LARGEST_SHIFT = 0.1  # of the largest push, between the baselines before and after an indentation
FLAT = 0.02  # of the largest push: change over the far rows of a withdrawal that is free of the sample
# The level of an interval's end is then known to 1.1 %: sqrt(0.025 * 0.975 / 200) (Efron & Tibshirani 1993, ch. 19).
BOOTSTRAPS = 200


@dataclass(frozen=True)
class Modulus:
    """Young's modulus [MPa] with 95 % interval, the contact point, and what limits the number."""

    youngs_modulus: float
    interval: tuple[float, float]
    contact_mm: float  # position at which the ball touches
    force_at_rest_N: float
    largest_depth_mm: float
    correction: float  # factor of the force at the largest depth by the finite thickness; 1 without
    warnings: tuple[str, ...]


def layer_factor(depth_mm, radius_mm: float, thickness_mm: float | None):
    """Return the factor on Hertz's force of a bonded incompressible layer, any shape; 1 for a half space."""
    if thickness_mm is None:
        return np.ones_like(np.asarray(depth_mm, dtype=float))
    chi = np.sqrt(radius_mm * np.maximum(depth_mm, 0.0)) / thickness_mm
    return 1 + sum(c * chi ** (k + 1) for k, c in enumerate(COEFFICIENTS))


def fit_modulus(
    test: IndentationTest, thickness_mm: float | None = None, machine: IndentationTest | None = None
) -> Modulus:
    """Return Young's modulus of an incompressible layer from one loading by a ball.

    Parameters
    ----------
    test : IndentationTest
        Position [mm], force [N] and ball radius [mm].
    thickness_mm : float, optional
        Of the layer; None for a half space.
    machine : IndentationTest, optional
        The same indentation on a rigid board. Its give at each force is taken off the depth; contact points of both
        are found separately.

    Returns
    -------
    Modulus
        [MPa] with 95 % interval, contact point [mm], and what limits the number.

    Raises
    ------
    ValueError
        For a ball of unknown radius, and data without contact or rest.
    """
    if test.ball_radius_mm is None:
        raise ValueError(f"{test.source}: the ball's radius is not known; give ball_radius_mm")
    R, said = test.ball_radius_mm, []
    z, F = np.asarray(test.position_mm, dtype=float), np.asarray(test.force_N, dtype=float)
    if machine is not None:
        give = _give(machine, F)
        travel = float(z.max() - contact_point(z, F, R, thickness_mm))
        if give.max() > LARGEST_GIVE * travel:
            raise ValueError(
                f"{test.source}: the machine gives {give.max():.3g} mm on the board, the indentation itself travels"
                f" {travel:.3g} mm in contact; at most {LARGEST_GIVE:.0%} of it can be distinguished from the specimen:"
                " stiffen the fixture, press a softer or thicker sample, or track the surface"
            )
        said.append(f"the machine gives {give.max():.3g} mm of {np.ptp(z):.3g} mm travel")
        z = z - give
    contact, (rest, E), residual = _search(z, F, R, thickness_mm)
    depth = z - contact
    model = rest + E * _shape(depth, R, thickness_mm)
    drawn = resampled(model, residual, BOOTSTRAPS, np.random.default_rng(0))
    moduli = [_refitted(z, again, R, thickness_mm, contact) for again in drawn]
    deepest = float(depth.max())
    if (depth > 0).mean() > AT_TOUCH:
        said.append(
            "the rows begin at the touch: the force at rest is found with the modulus, which widens the interval"
        )
    said += _limits(deepest, R, thickness_mm, (depth > 0).sum(), machine)
    interval, factor = percentile_interval(moduli), float(layer_factor(deepest, R, thickness_mm))
    return Modulus(float(E), interval, float(contact), float(rest), deepest, factor, tuple(said))


def contact_point(position_mm, force_N, radius_mm: float, thickness_mm: float | None = None) -> float:
    """Return the position at which the force begins to follow Hertz.

    Parameters
    ----------
    position_mm : array
        (n,), rising with the depth.
    force_N : array
        (n,).
    radius_mm : float
        Of the ball.
    thickness_mm : float, optional
        Of the layer; None for a half space.

    Returns
    -------
    float
        [mm].

    Raises
    ------
    ValueError
        For too few rows before and in contact.
    """
    return float(_search(np.asarray(position_mm), np.asarray(force_N), radius_mm, thickness_mm)[0])


@dataclass(frozen=True)
class Adhesion:
    """Pull-off: the largest tension while withdrawing [N], over the largest push [N], both from the far baseline."""

    pull_off_N: float
    largest_push_N: float
    baseline_shift_N: float  # from approach to withdrawal, far from the sample
    noise_N: float
    detached: bool  # the withdrawal ends on the flat baseline of the approach

    @property
    def ratio(self) -> float:
        """Return pull-off over push."""
        return self.pull_off_N / self.largest_push_N

    @property
    def sentence(self) -> str:
        """Return the finding as a paper writes it."""
        if not self.detached:
            return (
                f"The withdrawal does not come back to the baseline (shift {self.baseline_shift_N:.3g} N): still"
                " attached, tilt or drag; adhesion cannot be judged, withdraw further."
            )
        size = f"{self.pull_off_N:.3g} N, {self.noise_N:.1g} N noise"
        text = f"The pull-off force is {self.ratio:.0%} of the largest push ({size})"
        if self.pull_off_N < 5 * self.noise_N or self.ratio < 0.05:
            return f"{text}: adhesion is negligible."
        return f"{text}: significant adhesion, which Hertz leaves out."


def adhesion(approach: IndentationTest, withdrawal: IndentationTest, far_share: float = 0.1) -> Adhesion:
    """Return the adhesion of an indentation; the baselines are the farthest rows (far_share) of either way."""
    far_in = approach.force_N[approach.position_mm <= np.quantile(approach.position_mm, far_share)]
    far_out = withdrawal.force_N[withdrawal.position_mm <= np.quantile(withdrawal.position_mm, far_share)]
    before, after = float(np.median(far_in)), float(np.median(far_out))
    push = float(max(approach.force_N.max(), withdrawal.force_N.max())) - before
    noise = float(SIGMA_OF_MEDIAN / np.sqrt(2) * np.median(np.abs(np.diff(far_in))))  # a slope is no noise
    half = len(far_out) // 2
    change = abs(np.median(far_out[:half]) - np.median(far_out[half:]))
    pull_off = after - float(withdrawal.force_N.min())
    free = change <= max(FLAT * push, 3 * noise) and abs(after - before) <= LARGEST_SHIFT * push
    return Adhesion(pull_off, push, after - before, noise, bool(free))


def _shape(depth, radius, thickness):
    """Return the force [N] of a layer of Young's modulus 1 MPa (n,); 0 without contact."""
    d = np.maximum(depth, 0.0)
    return 16 / 9 * np.sqrt(radius) * d**1.5 * layer_factor(d, radius, thickness)


def _search(z, F, radius, thickness):
    """Return the contact position, (force at rest, E) and residuals (n,) with the least squared error."""
    inner = np.sort(z)[3:-LEAST_ROWS]
    if len(inner) < 3:
        raise ValueError(f"{len(z)} rows; {3 + LEAST_ROWS + 3} at least, before and in contact, are needed")
    before = z.min() - BEFORE_START * np.ptp(z)
    grid = np.linspace(before, inner[-1], 84)
    best = int(np.argmin([_cost(z, F, contact, radius, thickness) for contact in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    minimum = _best_contact(z, F, radius, thickness, bounds, xatol=1e-6 * np.ptp(z))
    beta, residual = _linear(z, F, minimum, radius, thickness)
    if best == 0 or not beta[1] > 0:
        raise ValueError(
            "no contact point is found: the force does not begin to rise within the travel, nor at its first row; start"
            " above the sample"
        )
    return minimum, beta, residual


def _linear(z, F, contact, radius, thickness):
    design = np.column_stack([np.ones(len(z)), _shape(z - contact, radius, thickness)])
    beta, *_ = np.linalg.lstsq(design, F, rcond=None)
    return beta, F - design @ beta


def _cost(z, F, contact, radius, thickness) -> float:
    """Return the sum of squared residuals of the best layer that begins at a contact position."""
    residual = _linear(z, F, contact, radius, thickness)[1]
    return residual @ residual


def _give(machine: IndentationTest, force) -> np.ndarray:
    """Return the position of the machine pressed on a rigid board at each force (n,) [mm], 0 at its touch."""
    F = np.asarray(machine.force_N, dtype=float)
    before = F[: max(len(F) // 4, 3)]
    rest, noise = np.median(before), np.std(before)
    first = int(np.argmax(F - rest > 5 * noise + 0.01 * np.ptp(F)))
    if first == 0:
        raise ValueError(
            f"{machine.source}: the indentation of the board has no rows before contact; start above it"
        )
    push, way = np.maximum.accumulate(F[first:] - rest), machine.position_mm[first:]
    slope = np.polyfit(push[: min(8, len(push))], way[: min(8, len(push))], 1)[0]
    touch = way[0] - max(slope, 0.0) * push[0]
    known = force - np.median(force[: max(len(force) // 4, 3)])
    if known.max() > push[-1] * 1.02:
        raise ValueError(
            f"{machine.source}: the board was pressed with {push[-1]:.3g} N, the sample with {known.max():.3g} N; press"
            " the board as hard"
        )
    return np.interp(known, np.r_[0, push], np.r_[0, way - touch], left=0.0)


def _refitted(z, F, radius, thickness, contact) -> float:
    """Return Young's modulus of forces F (n,), the contact point searched for near the one that is known."""
    width = 0.05 * np.ptp(z)
    minimum = _best_contact(z, F, radius, thickness, (contact - width, contact + width))
    return _linear(z, F, minimum, radius, thickness)[0][1]


def _best_contact(z, F, radius, thickness, bounds: tuple[float, float], **options: float) -> float:
    """Return the contact position within bounds of least squared error."""
    cost = partial(_cost, z, F, radius=radius, thickness=thickness)
    return minimize_scalar(cost, bounds=bounds, method="bounded", options=options).x


def _limits(deepest, radius, thickness, rows, machine) -> list[str]:
    said = []
    if rows < LEAST_ROWS:
        said.append(f"only {rows} rows in contact")
    if deepest > LARGEST_DEPTH_TO_RADIUS * radius:
        said.append(
            f"depth {deepest:.3g} mm is beyond {LARGEST_DEPTH_TO_RADIUS:g} of the radius {radius:g} mm: Hertz overstates"
            " the contact; press less deep"
        )
    if thickness is None:
        said.append("no layer thickness is given: a half space is assumed, a thin layer would seem too stiff")
    elif (chi := np.sqrt(radius * deepest) / thickness) > LARGEST_CHI:
        said.append(f"sqrt(R d)/h is {chi:.2f}, beyond the correction's {LARGEST_CHI:g}")
    if machine is None:
        said.append(
            "no test on a rigid board is given: the machine's compliance is counted as the specimen's"
        )
    return said
