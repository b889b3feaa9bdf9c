"""Sets of changes that the nominal model of material tests may lack, by the linear Gaussian engine of recordings.

Every change alone is fitted at its most probable values, and is linear from there on: all sets are weighed by these linear
changes. A set is then fitted with its changes as they are, and its evidence is that of the linear model about the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.identifiability import indistinguishable
from gelforge.mismatch.evidence.screen import Candidate, Screened, judged_by
from gelforge.mismatch.inference.linear import Linear
from gelforge.mismatch.inference.posterior import Effects, Posterior, set_tables
from gelforge.mismatch.material.material_readings import Change, Dense, Readings
from gelforge.mismatch.model.effect import Parameter
from gelforge.mismatch.terms.problem import secant
from gelforge.mismatch.terms.refit import Refitted
from gelforge.progress import tracked

# In which effects apply: the material first and the sensor last.
ORDER = (
    *("viscoelastic", "adhesion", "mullins", "ageing", "temperature"),
    *("force_gain", "force_offset", "force_drift", "force_hysteresis", "clock_offset"),
)
AT_BOUND = 1e-3  # widths; nearer to 0 a signed value counts as absent
STEP = 1e-4  # widths, of the Jacobian's differences


@dataclass(frozen=True, eq=False)
class Fitted:
    """Changes at their most probable values."""

    model: tuple[Change, ...]  # in the order in which they apply
    prediction: np.ndarray  # (n,)
    covariance: Covariance  # of measured less prediction
    judged: Screened  # the linear model about these values; columns of its parts: the Jacobian (n, p)
    log_evidence: float

    @property
    def columns(self) -> np.ndarray:
        """Return the Jacobian (n, p) of all values."""
        return np.column_stack([part.columns for part in self.judged.parts])

    @property
    def refitted(self) -> Refitted:
        """Return the same as a fit of the judge."""
        j = self.judged
        amounts = tuple(j.amounts[own] for own in slices(self.model))
        prior_sd = np.concatenate([np.broadcast_to(part.prior_sd, part.columns.shape[1]) for part in j.parts])
        return Refitted(
            j.parts, amounts, self.columns, j.covariance, prior_sd, j.log_bayes_factor, converged=True
        )


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


def fitted(readings: Readings, changes: Sequence[Change]) -> Fitted:
    """Return changes fitted to all readings."""
    model = tuple(sorted(changes, key=lambda change: ORDER.index(change.name)))
    parameters = [p for change in model for p in change.parameters]
    prior_sd, signs = np.array([p.width for p in parameters]), np.array([p.sign for p in parameters])
    bounds = np.array([_limits(p) for p in parameters]).T / prior_sd
    u = np.where(bounds[1] <= 0, -0.1, np.clip(0.1, *bounds))  # values in units of their widths
    # First every row by its own deviation, then with the correlations that belong to the prediction so far.
    C: Covariance = Dense(np.diag(readings.covariance.variance))
    for _ in range(3):
        u = _most_probable(readings, model, C, u, prior_sd, bounds)
        prediction = predicted(readings, model, u * prior_sd)
        C = readings.covariance_of(prediction)
    moved = [predicted(readings, model, (u + STEP * one) * prior_sd) - prediction for one in np.eye(len(u))]
    J = np.column_stack(moved) / (STEP * prior_sd)
    left = readings.measured - prediction + J @ (u * prior_sd)
    white = C.whiten(np.column_stack([left, J]))
    parts = [Candidate(c.name, c.shape, J[:, s], prior_sd[s], signs[s]) for c, s in zip(model, slices(model))]
    judged = judged_by(white[:, 0], parts, [white[:, 1:][:, s] for s in slices(model)])
    evidence = C.log_density_of_white(white[:, 0]) + judged.log_bayes_factor
    at_fit = replace(judged, amounts=u * prior_sd, change=prediction - readings.base)
    return Fitted(model, prediction, C, at_fit, evidence)


def _limits(parameter: Parameter) -> tuple[float, float]:
    low, high = parameter.bounds
    return (0.0 if parameter.sign > 0 else low), (0.0 if parameter.sign < 0 else high)


def _most_probable(readings, model, covariance, start, prior_sd, bounds) -> np.ndarray:
    """Return the values (p,) in units of their widths, so that no unit decides where the search ends."""

    def residual(u):
        return np.r_[covariance.whiten(readings.measured - predicted(readings, model, u * prior_sd)), u]

    low, high = bounds
    inside = np.clip(start, low + 1e-6, high - 1e-6)
    u = least_squares(residual, inside, bounds=bounds, xtol=1e-8, ftol=1e-8, gtol=1e-8, max_nfev=100).x
    return np.where((np.abs(u) < AT_BOUND) & ((low == 0) | (high == 0)), 0.0, u)


def posterior_of(readings: Readings) -> tuple[Posterior, dict[Effects, Fitted]]:
    """Return how probable sets of effects are by all readings, and each set as it was fitted."""
    changes = readings.changes
    if not changes:
        return Posterior({}, {}, {}, {}, 0, {}), {}
    residual, covariance = readings.measured - readings.base, readings.covariance
    nothing = covariance.log_density(residual)
    alone = [fitted(readings, (change,)) for change in tracked(changes, "effects and their shapes fitted")]
    linear = Linear.of(residual, covariance, [_through(fit).parts[0] for fit in alone])
    tables, number, scale = set_tables(linear)
    fits: dict[Effects, Fitted] = {}
    sets: dict[Effects, Screened] = {}
    for effects, average, _, chosen in tracked(tables, "sets of effects fitted"):
        fit = fitted(readings, [changes[number[k]].scaled(scale[k]) for k in chosen])
        best = linear.log_bayes_factors(number[chosen][None], scale[chosen][None])[0]
        # Other shapes and scales are taken to gain what the best ones gain by the fit.
        gained = fit.log_evidence - nothing - best
        fits[effects], sets[effects] = fit, replace(_through(fit), log_bayes_factor=float(average + gained))
    singles = {name: one for (name, *others), one in sets.items() if not others}
    evidence = {effects: one.log_bayes_factor for effects, one in sets.items()}
    return Posterior(sets, singles, evidence, {}, len(singles), indistinguishable(covariance, singles)), fits


def _through(fit: Fitted) -> Screened:
    """Return what was fitted as a linear change that meets the fit."""
    judged, amounts = fit.judged, fit.judged.amounts
    if not amounts.any():
        return judged
    prior_sd = np.concatenate([part.prior_sd for part in judged.parts])
    columns = secant(fit.columns, judged.change - fit.columns @ amounts, amounts, prior_sd)
    own = zip(judged.parts, slices(fit.model))
    return replace(judged, parts=tuple(replace(part, columns=columns[:, rows]) for part, rows in own))
