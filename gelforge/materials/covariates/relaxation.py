r"""Relaxation at a held stretch: a Prony series by non-negative least squares, and a power law.

.. math:: P(t) = P_0 [g_\infty + \sum_i g_i e^{-t/\tau_i}], \qquad g_\infty + \sum_i g_i = 1.

A ramp of duration t_1 has already relaxed when the hold begins. By Boltzmann's superposition each mode then holds
only g_i (tau_i / t_1)(1 - exp(-t_1/tau_i)) of its step response; the design matrix contains that factor, so that
g_i are those of an ideal step. Times much shorter than the ramp cannot be seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, nnls

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.statistics import ROWS_OF_SCATTER, percentile_interval, resampled
from gelforge.materials.covariates.effects import NEGLIGIBLE

# Relaxation of SYNTHETIC samples is found, in ramps too (tests/materials/test_measured_effects.py):
BINS_PER_DECADE = 15  # rows are averaged in equal bins of log time: late, dense rows shall not decide alone
# Closer times cannot be distinguished: the kernel exp(-t/tau) is a decade wide (Baumgaertel & Winter 1989, one to two a
# decade).
TERMS_PER_DECADE = 2
LEAST_POINTS = ROWS_OF_SCATTER
# one more term must lower Schwarz' criterion by this much ("very strong", Kass and Raftery 1995)
BIC_GAIN = 10.0
# The level of an interval's end is then known to 1.6 %: sqrt(0.025 * 0.975 / 100) (Efron & Tibshirani 1993, ch. 19).
BOOTSTRAPS = 100


ENDINGS = {  # of a sentence, by the verdict
    "negligible": f"relaxation is negligible (below {NEGLIGIBLE:.0%})",
    "undecided": f"whether relaxation exceeds {NEGLIGIBLE:.0%} is not decided",
}


def relaxation_verdict(drop: tuple[float, float]) -> str:
    """Return "negligible", "undecided" or "significant relaxation" by the interval of the share of stress that is lost."""
    low, high = drop
    if high < NEGLIGIBLE:
        return "negligible"
    return "undecided" if low < NEGLIGIBLE else "significant relaxation"


@dataclass(frozen=True)
class Relaxation:
    """A fitted hold: shares and times of the Prony series, the power law, and how well either describes it."""

    stretch: float
    hold_s: tuple[float, float]  # first and last time since the hold began
    instantaneous_stress: float  # P_0 [MPa] of an ideal step
    shares: np.ndarray  # g_i (k,)
    times_s: np.ndarray  # tau_i (k,)
    equilibrium_share: float  # g_inf; stands for everything slower than the hold
    drop: float  # 1 - last / first measured stress of the hold
    drop_interval: tuple[float, float]
    equilibrium_interval: tuple[float, float]
    prony_rms: float  # relative to P_0
    power_exponent: float  # P ~ t^-n
    power_exponent_interval: tuple[float, float]
    power_rms: float  # relative to P_0
    points: int
    abscissa: str = "stretch"
    ramp_s: float = 0.0  # duration of the loading before the hold; 0 where it is not in the file

    def drop_at(self, time_s: float) -> float:
        """Return the share of an ideal step's stress that is gone after a time [s] within the hold (Prony series).

        It reaches back to the step: what relaxed before the first row of the hold is the series' extrapolation.
        """
        self._check_within(time_s)
        return float(np.sum(self.shares * -np.expm1(-time_s / self.times_s)))

    def drop_between(self, begin_s: float, end_s: float) -> float:
        """Return the share of the stress at one time [s] of the hold that is gone at a later one, as measured."""
        self._check_within(end_s)
        if not begin_s >= self.hold_s[0]:
            first = self.hold_s[0]
            raise ValueError(
                f"{begin_s:g} s is before the hold's first row at {first:g} s; ask for a later time"
            )
        return float(1 - self._stress(end_s) / self._stress(begin_s))

    def _check_within(self, time_s: float) -> None:
        if not time_s <= self.hold_s[1]:
            raise ValueError(
                f"{time_s:g} s is beyond the hold of {self.hold_s[1]:g} s; ask for a time within it"
            )

    def _stress(self, time_s: float) -> float:
        """Return the stress of the hold over that of an ideal step."""
        held = self.shares * _reduced(self.times_s, self.ramp_s) * np.exp(-time_s / self.times_s)
        return float(self.equilibrium_share + held.sum())

    @property
    def better(self) -> str:
        """Return which description has the smaller residual for its parameters (Schwarz' criterion)."""
        prony = _bic(self.prony_rms, self.points, 1 + 2 * len(self.shares))
        return "Prony series" if prony < _bic(self.power_rms, self.points, 2) else "power law"

    @property
    def verdict(self) -> str:
        """Return the relaxation_verdict of the drop; noise of the hold, not scatter of samples."""
        return relaxation_verdict(self.drop_interval)

    @property
    def sentence(self) -> str:
        """Return the finding as a paper writes it."""
        low, high = self.drop_interval
        text = (
            f"Held at {self.abscissa} {self.stretch:.3g} for {self.hold_s[1]:.3g} s, the stress drops by {self.drop:.1%}"
            f" (95 % interval {low:.1%} to {high:.1%})"
        )
        if self.verdict in ENDINGS:
            return f"{text}: {ENDINGS[self.verdict]}."
        terms = f"{len(self.shares)} Prony term{'s' if len(self.shares) > 1 else ''}"
        return (
            f"{text}: significant relaxation, {terms} (rms {self.prony_rms:.2%}) against a power law of exponent"
            f" {self.power_exponent:.3f} (rms {self.power_rms:.2%}); the {self.better} describes it better."
        )


def relaxation_of(test: MaterialTest, hold: int = 0, seed: int = 0) -> Relaxation:
    """Return the fit of one hold of a test (0: the first one that a loading leads to, or the test's only hold)."""
    holds = [i for i, s in enumerate(test.segments) if s.kind == "hold"]
    if test.time_s is None or len(holds) <= hold:
        raise ValueError(
            f"{test.source} {test.sample}: no hold {hold + 1} with a time; give a relaxation test"
        )
    segment = test.segments[holds[hold]]
    ramp, start = 0.0, test.time_s[segment.start]
    if holds[hold] > 0:
        ramp = float(start - test.time_s[test.segments[holds[hold] - 1].start])
    rows = slice(segment.start + (1 if ramp else 0), segment.stop)
    time = test.time_s[rows] - (start if ramp else 0.0)
    direction = np.sign(np.median(test.nominal_stress[rows])) or 1.0
    stress, held_at = direction * test.nominal_stress[rows], float(np.median(test.stretch[rows]))
    return replace(fit_relaxation(time, stress, held_at, ramp, seed), abscissa=test.abscissa)


def fit_relaxation(time_s, nominal_stress, stretch: float = np.nan, ramp_s: float = 0.0, seed: int = 0):
    """Return the Relaxation of a stress (n,) [MPa] at times (n,) [s] since the hold began."""
    time, stress = _binned(np.asarray(time_s, dtype=float), np.asarray(nominal_stress, dtype=float))
    if len(time) < LEAST_POINTS:
        raise ValueError(
            f"{len(time)} distinct times in the hold; {LEAST_POINTS} at least are needed for a relaxation spectrum:"
            " sample faster or hold longer"
        )
    times = _chosen_times(time, stress, ramp_s)
    amplitudes, model = _prony(time, stress, times, ramp_s)
    power, log_fit = _power(time, stress)
    again = resampled(model, stress - model, BOOTSTRAPS, np.random.default_rng(seed))
    draws = np.array([_refitted(time, drawn, times, ramp_s) for drawn in again])
    drop, equilibrium, exponent = (percentile_interval(values) for values in draws.T)
    P0 = amplitudes.sum()
    kept = amplitudes[1:] > 1e-6 * P0
    prony_rms, power_rms = (float(np.sqrt(np.mean((stress - fit) ** 2)) / P0) for fit in (model, log_fit))
    return Relaxation(
        stretch, (float(time[0]), float(time[-1])), float(P0), amplitudes[1:][kept] / P0, times[kept],
        float(amplitudes[0] / P0), float(1 - model[-1] / model[0]), drop, equilibrium, prony_rms,
        float(-power[1]), exponent, power_rms, len(time), ramp_s=float(ramp_s),
    )  # fmt: skip


def _binned(time, stress) -> tuple[np.ndarray, np.ndarray]:
    """Return time and stress averaged in bins of equal log time; single rows stay as they are."""
    time, stress = time[time > 0], stress[time > 0]
    index = np.floor(np.log10(time) * BINS_PER_DECADE).astype(int)
    bins = [index == group for group in np.unique(index)]
    mean_time = np.array([np.exp(np.log(time[rows]).mean()) for rows in bins])
    return mean_time, np.array([stress[rows].mean() for rows in bins])


def _chosen_times(time, stress, ramp) -> np.ndarray:
    """Return relaxation times (k,); k is the least number that Schwarz' criterion supports."""
    low, high = _window(time, ramp)
    decades = np.log10(high / low)
    most = max(1, min(int(TERMS_PER_DECADE * decades), len(time) // 3))
    best: np.ndarray | None = None
    best_bic = np.inf
    for k in range(1, most + 1):
        edges = np.linspace(np.log10(low), np.log10(high), k + 1)
        times = _refined(time, stress, 10 ** (edges[:-1] + np.diff(edges) / 2), ramp)
        amplitudes, model = _prony(time, stress, times, ramp)
        rms = float(np.sqrt(np.mean((stress - model) ** 2)) / amplitudes.sum())
        bic = _bic(rms, len(time), 1 + 2 * int((amplitudes[1:] > 0).sum()))
        if bic < best_bic - BIC_GAIN:
            best, best_bic = times, bic
    if best is None:
        raise ValueError(
            "no relaxation times fit: the stress of the hold has no finite misfit; look at its rows"
        )
    return best


def _window(time, ramp) -> tuple[float, float]:
    """Return the relaxation times that a hold can show: not shorter than its ramp, not longer than itself."""
    return max(time[0], 0.3 * ramp), time[-1]


def _refined(time, stress, times, ramp, evaluations: int | None = None) -> np.ndarray:
    """Return the relaxation times (k,) of least error; amplitudes follow by non-negative least squares.

    Variable projection (Golub and Pereyra 1973): only the logarithms of the times are searched.
    """
    low, high = np.log(_window(time, ramp))
    scale = stress.max()

    def residual(log_times):
        return (_prony(time, stress, np.exp(log_times), ramp)[1] - stress) / scale

    start = np.clip(np.log(times), low + 1e-3, high - 1e-3)
    fitted = least_squares(residual, start, bounds=(low, high), max_nfev=evaluations, xtol=1e-4, ftol=1e-6)
    return np.exp(np.sort(fitted.x))


def _bic(rms: float, points: int, parameters: int) -> float:
    return 2 * points * np.log(max(rms, 1e-6)) + parameters * np.log(points)


def _reduced(times, ramp) -> np.ndarray:
    """Return what a ramp leaves of each mode's step response (k,)."""
    return times / ramp * -np.expm1(-ramp / times) if ramp else np.ones(len(times))


def _prony(time, stress, times, ramp) -> tuple[np.ndarray, np.ndarray]:
    """Return (P_inf, P_1, ..., P_k) and the modelled stress (n,)."""
    design = np.column_stack([np.ones(len(time)), _reduced(times, ramp) * np.exp(-time[:, None] / times)])
    amplitudes, _ = nnls(design, stress)
    return amplitudes, design @ amplitudes


def _power(time, stress) -> tuple[np.ndarray, np.ndarray]:
    """Return (ln P at 1 s, -n) and the modelled stress (n,) of P = P(1 s) t^-n."""
    usable = stress > 0
    if usable.sum() < LEAST_POINTS:
        below = int((~usable).sum())
        raise ValueError(f"{below} of {len(stress)} stresses of the hold are not above 0; check its sign")
    design = np.column_stack([np.ones(len(time)), np.log(time)])
    beta, *_ = np.linalg.lstsq(design[usable], np.log(stress[usable]), rcond=None)
    return beta, np.exp(design @ beta)


def _refitted(time, stress, times, ramp) -> tuple[float, float, float]:
    """Return drop, g_inf and n of a hold, its relaxation times (k,) searched for near those that are known."""
    amplitudes, fitted = _prony(time, stress, _refined(time, stress, times, ramp, evaluations=5), ramp)
    exponent = -_power(time, stress)[0][1] if (stress > 0).all() else np.nan
    return 1 - fitted[-1] / fitted[0], amplitudes[0] / amplitudes.sum(), exponent
