r"""Work lost per cycle, residual strain, and softening between cycles (Mullins effect).

Ogden and Roxburgh (1999, doi 10.1098/rspa.1999.0431): on unloading and reloading below the largest stretch the
stress is :math:`\eta P_0` of the first loading,

.. math:: \eta = 1 - \frac{1}{r}\,\mathrm{erf}\frac{W_m - W}{m + \beta W_m},

W the strain energy of the first loading at the stretch, W_m at the largest stretch so far. It describes damage;
a single loop cannot distinguish damage from viscosity, for that a reloading is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.statistics import mean_of
from gelforge.materials.covariates.effects import NEGLIGIBLE
from gelforge.mechanics.laws.softening import lost_share


@dataclass(frozen=True)
class Loop:
    """One cycle: work per undeformed volume [MPa = mJ/mm^3] put in and lost, and where the stress returned to 0."""

    cycle: int
    largest_stretch: float
    loading_work: float
    lost_share: float  # (loading - unloading work) / loading work
    quadrature_error: float  # of lost_share: from every other row
    residual_strain: float | None  # strain left at zero stress; None if unloading ended before
    abscissa: str = "stretch"
    held: bool = False  # the cycle contains holds, so that relaxation in them is part of the loss

    @property
    def sentence(self) -> str:
        """Return the finding as a paper writes it."""
        text = (
            f"Cycle {self.cycle} to {self.abscissa} {self.largest_stretch:.3g} loses {self.lost_share:.1%} of the"
            f" loading work (+- {self.quadrature_error:.1%} from the spacing of rows)"
            f"{', relaxation in its holds included' if self.held else ''}"
        )
        known = self.residual_strain is not None
        left = f"; {self.residual_strain:.1%} of strain are left at zero stress" if known else ""
        if abs(self.lost_share) + self.quadrature_error < NEGLIGIBLE:
            return f"{text}: hysteresis is negligible (below {NEGLIGIBLE:.0%}){left}."
        return f"{text}: significant hysteresis{left}."


@dataclass(frozen=True)
class OgdenRoxburgh:
    """Parameters r [-], m [MPa], beta [-] of the softening, with the relative error they leave."""

    r: float
    m_MPa: float
    beta: float
    rms: float  # of the stress, over the largest first-loading stress
    standard_error: np.ndarray  # (3,) of r, m, beta

    @property
    def determined(self) -> bool:
        """Return whether each parameter exceeds twice its standard error."""
        return bool(np.all(np.array([self.r, self.m_MPa, self.beta]) > 2 * self.standard_error))

    @property
    def sentence(self) -> str:
        """Return the finding as a paper writes it."""
        text = (
            f"Ogden-Roxburgh softening r = {self.r:.3g}, m = {self.m_MPa * 1e3:.3g} kPa, beta = {self.beta:.3g} describes"
            f" unloading and reloading with an rms of {self.rms:.1%} of the largest stress"
        )
        return f"{text}{'' if self.determined else ', but the data do not determine all three parameters'}."


def loops(test: MaterialTest) -> list[Loop]:
    """Return the cycles of a test that load and unload."""
    cycles = sorted({s.cycle for s in test.segments if s.kind == "unload"})
    if not cycles:
        raise ValueError(f"{test.source} {test.sample}: no unloading is found; hysteresis needs a cycle")
    return [loop for cycle in cycles if (loop := _loop(test, cycle)) is not None]


def _loop(test: MaterialTest, cycle: int) -> Loop | None:
    segments = [s for s in test.segments if s.cycle == cycle]
    if not any(s.kind == "load" for s in segments):
        return None
    rows = np.arange(segments[0].start, segments[-1].stop)
    strain = test.stretch[rows] - test.at_rest
    turn = int(np.argmax(np.abs(strain)))
    away = np.sign(strain[turn])
    stress = away * test.nominal_stress[rows]
    strain = away * strain
    down, residual = _until_zero(strain[turn:], stress[turn:])
    loaded = np.trapezoid(stress[: turn + 1], strain[: turn + 1])
    lost = [_lost(strain, stress, turn, down, step) for step in (1, 2)]
    error = float(abs(lost[0] - lost[1]) / 3)  # the trapezoid rule is of second order
    largest, held = float(test.at_rest + away * strain[turn]), any(s.kind == "hold" for s in segments)
    return Loop(cycle, largest, float(loaded), float(lost[0]), error, residual, test.abscissa, held)


def _until_zero(strain, stress) -> tuple[int, float | None]:
    """Return how many rows of the unloading have a stress above 0, and the strain where it vanishes."""
    below = np.flatnonzero(stress <= 0)
    if not len(below):
        return len(stress), None
    i = int(below[0])
    a, b = stress[i - 1], stress[i]
    return i, float(strain[i - 1] + (strain[i] - strain[i - 1]) * a / (a - b))


def _lost(strain, stress, turn, down, step) -> float:
    up = np.unique(np.r_[np.arange(0, turn, step), turn])
    back = turn + np.unique(np.r_[np.arange(0, down, step), down - 1])
    loaded = np.trapezoid(stress[up], strain[up])
    returned = -np.trapezoid(stress[back], strain[back])
    return (loaded - returned) / loaded


def softening_between(first: MaterialTest, again: MaterialTest) -> float:
    """Return the relative change of stress from one loading to another, over the first half of their range.

    Close to the largest stretch both meet again, whatever the damage.
    """
    away = np.sign(first.stretch[-1] - first.at_rest)
    strains = [away * (c.stretch - c.at_rest) for c in (first, again)]
    low = max(strains[0].min(), strains[1].min(), 0.1 * strains[0].max())
    high = min(s.max() for s in strains)
    if not high > low:
        raise ValueError(f"{first.source}, {again.source}: the loadings share no range of strain")
    grid = np.linspace(low, low + (high - low) / 2, 30)
    once, twice = (_stress_at(grid, s, away * c.nominal_stress) for s, c in zip(strains, (first, again)))
    return float(twice.mean() / once.mean() - 1)


def softening_interval(changes: list[float]) -> tuple[float, float] | None:
    """Return the 95 % interval (Student's t) of the mean change of several samples, None for one."""
    return mean_of(changes).interval if len(changes) > 1 else None


def softening_verdict(changes: list[float]) -> str:
    """Return "negligible" (interval within +-5 %), "significant softening" (below 0) or "undecided"."""
    interval = softening_interval(changes)
    if interval is None:
        return "undecided"
    if -NEGLIGIBLE <= interval[0] and interval[1] <= NEGLIGIBLE:
        return "negligible"
    return "significant softening" if interval[1] < 0 else "undecided"


def softening_sentence(changes: list[float]) -> str:
    """Return the finding on softening (the changes of several samples) as a paper writes it."""
    text = f"From the first to loading 2 the stress in the lower half of the range changes by {np.mean(changes):+.1%}"
    interval = softening_interval(changes)
    if interval is None:
        return f"{text} in one sample: without repeats it is not known whether that exceeds their scatter."
    text += f" (95 % interval {interval[0]:+.1%} to {interval[1]:+.1%}, {len(changes)} samples)"
    endings = {
        "negligible": f"softening between cycles is negligible (within {NEGLIGIBLE:.0%})",
        "significant softening": "significant softening (Mullins effect)",
        "undecided": "these tests do not decide whether the material softens",
    }
    return f"{text}: {endings[softening_verdict(changes)]}."


def _stress_at(grid, strain, stress):
    order = np.argsort(strain, kind="stable")
    return np.interp(grid, strain[order], stress[order])


def fit_ogden_roxburgh(tests: list[MaterialTest]) -> OgdenRoxburgh:
    """Return the softening parameters of unloadings and reloadings, against each test's own first loading."""
    parts = [part for test in tests for part in _softened(test)]
    if not parts:
        raise ValueError("no unloading in the tests; softening needs cycles")
    P0, W, Wm, P = (np.concatenate(columns) for columns in zip(*parts))
    largest, energy = P0.max(), Wm.max()

    def residual(theta):
        r, m, beta = 1 + np.exp(theta[0]), energy * np.exp(theta[1]), np.exp(theta[2])
        return ((1 - lost_share(W, Wm, m, beta) / r) * P0 - P) / largest

    starts = np.log(list(product((0.5, 2.0), (0.05, 0.5), (0.05, 0.5))))  # r - 1, m over the energy, beta
    bounds = ([-7, -9, -9], [5, 3, 3])
    best = min((least_squares(residual, s, bounds=bounds) for s in starts), key=lambda fit: fit.cost)
    r, m, beta = 1 + np.exp(best.x[0]), energy * np.exp(best.x[1]), np.exp(best.x[2])
    variance = 2 * best.cost / max(len(P) - 3, 1) * np.linalg.pinv(best.jac.T @ best.jac)
    error = np.sqrt(np.diag(variance)) * np.array([r - 1, m, beta])
    return OgdenRoxburgh(float(r), float(m), float(beta), float(np.sqrt(2 * best.cost / len(P))), error)


def _softened(test: MaterialTest):
    """Yield (P_0, W, W_m, P) (n,) of rows below the largest strain so far, with P_0 from the envelope of loading."""
    strain = np.abs(test.stretch - test.at_rest)
    stress = test.nominal_stress * np.sign(test.stretch[np.argmax(strain)] - test.at_rest)
    furthest = np.maximum.accumulate(strain)
    virgin = np.r_[True, np.diff(furthest) > 0] & (strain == furthest)
    if virgin.sum() < 4:
        return
    s0, P0 = strain[virgin], stress[virgin]
    W0 = np.r_[0, np.cumsum(np.diff(s0) * (P0[1:] + P0[:-1]) / 2)]
    below = ~virgin & (strain > 0.05 * strain.max()) & (stress > 0)
    if not any(s.kind == "unload" for s in test.segments) or not below.any():
        return
    x, reached = strain[below], furthest[below]
    yield np.interp(x, s0, P0), np.interp(x, s0, W0), np.interp(reached, s0, W0), stress[below]
