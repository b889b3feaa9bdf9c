"""Sets of changes that the nominal model of material tests may lack, by the linear Gaussian engine of recordings.

Every change alone is fitted at its most probable values, and is linear from there on: all sets are weighed by these linear
changes. A set is then fitted with its changes as they are, and its evidence is that of the linear model about the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.identifiability import indistinguishable
from gelforge.mismatch.evidence.screen import Candidate, Screened, judged_by
from gelforge.mismatch.inference.linear import Linear
from gelforge.mismatch.inference.posterior import Effects, Posterior, set_tables
from gelforge.mismatch.material.material_readings import Dense, Readings
from gelforge.mismatch.model.effect import Parameter
from gelforge.mismatch.terms.problem import secant
from gelforge.progress import tracked

# In which effects apply: the material first and the sensor last.
ORDER = (
    *("viscoelastic", "adhesion", "mullins", "ageing", "temperature"),
    *("force_gain", "force_offset", "force_drift", "force_hysteresis", "clock_offset"),
)
AT_BOUND = 1e-3  # widths; nearer to 0 a signed value counts as absent
STEP = 1e-4  # widths, of the Jacobian's differences


@dataclass(frozen=True)
class Change:
    """An effect in one shape: what (n,) becomes of a prediction (n,) at some values (p,); 0 is no effect."""

    name: str
    parameters: tuple[Parameter, ...]
    apply: Callable[[np.ndarray, np.ndarray], np.ndarray]
    shape: Mapping[str, float | str] = field(default_factory=dict)

    def scaled(self, scale: float) -> Change:
        """Return the change with other plausible values."""
        return replace(self, parameters=tuple(replace(p, width=scale * p.width) for p in self.parameters))


@dataclass(frozen=True)
class Tests:
    """Readings, what may change them, and what the nominal model is in words."""

    readings: Readings
    changes: tuple[Change, ...]
    base_words: str
    unit: str  # of the readings
    cannot_enter: tuple[str, ...] = ()  # effects that change none of these readings


@dataclass(frozen=True, eq=False)
class Fitted:
    """Changes at their most probable values, found on some rows; predictions and covariances are of all n rows."""

    model: tuple[Change, ...]  # in the order in which they apply
    prediction: np.ndarray  # (n,)
    covariance: Covariance  # of measured less prediction
    judged: Screened  # the linear model about these values; columns of its parts: the Jacobian (n, p)
    log_evidence: float  # of the rows that it was found on

    @property
    def columns(self) -> np.ndarray:
        """Return the Jacobian (n, p) of all values."""
        return np.column_stack([part.columns for part in self.judged.parts])

    def own(self, number: int) -> slice:
        """Return where the values of one change are."""
        return slices(self.model)[number]

    def changes(self, readings: Readings) -> list[np.ndarray]:
        """Return what (n,) each change adds to those before it."""
        upto = [
            predicted(readings, self.model[:k], self.judged.amounts) for k in range(1, len(self.model) + 1)
        ]
        return [after - before for before, after in zip([readings.base, *upto], upto)]


def slices(model: Sequence[Change]) -> list[slice]:
    """Return where the values of each change are among those of a model."""
    ends = np.cumsum([0, *(len(change.parameters) for change in model)]).tolist()
    return [slice(a, b) for a, b in zip(ends, ends[1:])]


def predicted(readings: Readings, model: Sequence[Change], amounts: np.ndarray) -> np.ndarray:
    """Return the prediction (n,) of a model; all of it acts on the material before the plates let go of it."""
    stress = readings.base
    for change, own in zip(model, slices(model)):
        stress = change.apply(stress, amounts[own])
    if readings.pushed is None:
        return stress
    return np.where(readings.pushed, np.maximum(stress, np.minimum(readings.base, 0.0)), stress)


def fitted(readings: Readings, changes: Sequence[Change], rows: np.ndarray | None = None) -> Fitted:
    """Return changes fitted to all rows, or to some (n,) bool."""
    model = tuple(sorted(changes, key=lambda change: ORDER.index(change.name)))
    rows = np.ones(len(readings.measured), bool) if rows is None else rows
    parameters = [p for change in model for p in change.parameters]
    prior_sd, signs = np.array([p.width for p in parameters]), np.array([p.sign for p in parameters])
    bounds = np.array([_limits(p) for p in parameters]).T / prior_sd
    u = np.where(bounds[1] <= 0, -0.1, np.clip(0.1, *bounds))  # values in units of their widths
    # First every row by its own deviation, then with the correlations that belong to the prediction so far.
    C: Covariance = Dense(np.diag(readings.covariance.variance))
    for _ in range(3):
        u = _most_probable(readings, model, rows, C.restricted(rows), u, prior_sd, bounds)
        prediction = predicted(readings, model, u * prior_sd)
        C = readings.covariance_of(prediction)
    moved = [predicted(readings, model, (u + STEP * one) * prior_sd) - prediction for one in np.eye(len(u))]
    J = np.column_stack(moved) / (STEP * prior_sd)
    left = readings.measured - prediction + J @ (u * prior_sd)
    own = C.restricted(rows)
    white = own.whiten(np.column_stack([left, J])[rows])
    parts = [Candidate(c.name, c.shape, J[:, s], prior_sd[s], signs[s]) for c, s in zip(model, slices(model))]
    judged = judged_by(white[:, 0], parts, [white[:, 1:][:, s] for s in slices(model)])
    evidence = own.log_density_of_white(white[:, 0]) + judged.log_bayes_factor
    at_fit = replace(judged, amounts=u * prior_sd, change=prediction - readings.base)
    return Fitted(model, prediction, C, at_fit, evidence)


def _limits(parameter: Parameter) -> tuple[float, float]:
    low, high = parameter.bounds
    return (0.0 if parameter.sign > 0 else low), (0.0 if parameter.sign < 0 else high)


def _most_probable(readings, model, rows, covariance, start, prior_sd, bounds) -> np.ndarray:
    """Return the values (p,) in units of their widths, so that no unit decides where the search ends."""

    def residual(u):
        left = readings.measured - predicted(readings, model, u * prior_sd)
        return np.r_[covariance.whiten(left[rows]), u]

    low, high = bounds
    inside = np.clip(start, low + 1e-6, high - 1e-6)
    u = least_squares(residual, inside, bounds=bounds, xtol=1e-8, ftol=1e-8, gtol=1e-8, max_nfev=100).x
    return np.where((np.abs(u) < AT_BOUND) & ((low == 0) | (high == 0)), 0.0, u)


def posterior_of(readings: Readings, changes: Sequence[Change]) -> tuple[Posterior, dict[Effects, Fitted]]:
    """Return how probable sets of effects are by all readings, and each set as it was fitted."""
    if not changes:
        return Posterior({}, {}, {}, {}, 0, {}), {}
    residual, covariance = readings.measured - readings.base, readings.covariance
    nothing = covariance.log_density(residual)
    alone = [fitted(readings, (change,)) for change in tracked(changes, "effects and their shapes fitted")]
    linear = Linear.of(residual, covariance, [_through(fit) for fit in alone])
    tables, number, scale = set_tables(linear)
    fits: dict[Effects, Fitted] = {}
    sets: dict[Effects, Screened] = {}
    for effects, average, _, chosen in tracked(tables, "sets of effects fitted"):
        fit = fitted(readings, [changes[number[k]].scaled(scale[k]) for k in chosen])
        best = linear.log_bayes_factors(number[chosen][None], scale[chosen][None])[0]
        # Other shapes and scales are taken to gain what the best ones gain by the fit.
        gained = fit.log_evidence - nothing - best
        fits[effects], sets[effects] = fit, replace(fit.judged, log_bayes_factor=float(average + gained))
    singles = {name: one for (name, *others), one in sets.items() if not others}
    evidence = {effects: one.log_bayes_factor for effects, one in sets.items()}
    return Posterior(sets, singles, evidence, {}, len(singles), indistinguishable(covariance, singles)), fits


def _through(fit: Fitted) -> Candidate:
    """Return a change alone as the linear one that meets its fit."""
    (part,), amounts = fit.judged.parts, fit.judged.amounts
    if not amounts.any():
        return part
    missing = fit.judged.change - part.columns @ amounts
    return replace(part, columns=secant(part.columns, missing, amounts, part.prior_sd))
