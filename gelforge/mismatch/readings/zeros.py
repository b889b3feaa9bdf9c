"""Noise and drift of the force sensor from the zero rows of all indentations together, where each has only one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from gelforge.mismatch.readings.noise import LEAST_FREEDOM, Repeats, repeats_of
from gelforge.recording.readings import RAW, Recording, force_on_sensor

LEAST_STEP_S = 1e-6  # between two rows that were written with one time
BLOCK = 500  # zero rows that are taken at once: they know a standard deviation to 4 %, and a root of their matrix is quick
RATIOS = 30  # of drift to noise that are tried before the likeliest is refined


@dataclass(frozen=True, eq=False)
class Zeros:
    """What zero rows z = offset + trend t + a random walk + noise say: the noise as repeats, and the drift, by axis."""

    repeats: Repeats
    trend: np.ndarray  # (3,) [N/s], a standard deviation: the trend found, and how well
    wander: np.ndarray  # (3,) [N/s^0.5] standard deviation of the random walk after 1 s

    def drift(self, readings: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
        """Return the standard deviations (R, 3) [N] of the zero's walk and trend since each reading's own zero rows."""
        zero = readings[readings["phase"] == "zero"].groupby("press")["time_s"].mean()
        since = readings["time_s"].to_numpy() - zero.reindex(readings["press"]).to_numpy()
        since = np.maximum(since, 0.0)[:, None]
        return self.wander * np.sqrt(since), self.trend * since


def zeros_together(recording: Recording) -> Zeros | None:
    """Return what the zero rows of all indentations say together; None where single ones show it, or all are too few."""
    readings = recording.readings
    rows = readings[readings["phase"] == "zero"]
    if len(rows) < LEAST_FREEDOM or repeats_of(readings, "zero", 1).freedom >= LEAST_FREEDOM:
        return None
    time = rows["time_s"].to_numpy()
    force = force_on_sensor(rows[RAW].to_numpy(), recording.session.force)
    found = [
        _block(time[part], force[part])
        for part in np.array_split(np.arange(len(rows)), -(-len(rows) // BLOCK))
    ]
    repeats = sum((one.repeats for one in found), Repeats.none())
    trend, wander = (
        np.sqrt(np.mean([getattr(one, name) ** 2 for one in found], axis=0)) for name in ("trend", "wander")
    )
    return Zeros(repeats, trend, wander)


def _block(time: np.ndarray, force: np.ndarray) -> Zeros:
    """Return what zero rows (N,) [s], (N, 3) [N] in the order taken say, by restricted maximum likelihood of each axis.

    Their differences d have the covariance s^2 A + q B, A tridiagonal (2, -1), B diagonal of the steps in time: in the basis
    that makes both diagonal, y ~ N(trend x, s^2 m + q) entry by entry.
    """
    step = np.maximum(np.diff(time), LEAST_STEP_S)
    D = np.diff(np.eye(len(time)), axis=0)
    scaled = D / np.sqrt(step)[:, None]
    m, E = np.linalg.eigh(scaled @ scaled.T)
    basis = E.T @ scaled  # (N - 1, N): y of the rows themselves
    x = E.T @ np.sqrt(step)
    axes = [_axis(m, x, basis, z) for z in (force - force.mean(axis=0)).T]
    variance, freedom, residual, expected, trend, wander = (np.array(found) for found in zip(*axes))
    known = float(freedom.min())
    repeats = Repeats(variance * known, (residual**4).sum(axis=1), expected, known)
    return Zeros(repeats, trend, wander)


def _axis(m: np.ndarray, x: np.ndarray, basis: np.ndarray, z: np.ndarray) -> tuple:
    """Return of one axis' zero rows z (N,): variance of the noise, its degrees of freedom, residuals, trend and walk.

    Residuals are R e of the noise e, R = s^2 P of the generalised least squares; with them what `Repeats` expects of R.
    """
    y, m = basis @ z, np.maximum(m, m.max() * np.finfo(float).eps)

    def fitted(ratio: float) -> tuple[np.ndarray, float, float]:
        weight = 1 / (m + ratio)
        trend = (weight * x) @ y / ((weight * x) @ x)
        return weight, trend, float(weight @ (y - trend * x) ** 2 / (len(y) - 1))

    def cost(ratio: float) -> float:
        weight, _, variance = fitted(ratio)
        return (len(y) - 1) * np.log(variance) - np.log(weight).sum() + np.log((weight * x) @ x)

    ratio = _likeliest(cost, m) if np.ptp(z) > 0 else 0.0
    weight, trend, variance = fitted(ratio)
    root = basis.T @ np.diag(weight) @ basis
    along = basis.T @ (weight * x)
    R = root - np.outer(along, along) / ((weight * x) @ x)
    of_trend = variance / ((weight * x) @ x)
    information = np.array([[np.sum((m * weight) ** 2), m @ weight**2], [m @ weight**2, weight @ weight]])
    freedom = 1 / np.linalg.inv(information)[0, 0]  # 2 s^4 over the variance of the estimate of s^2
    expected = np.array([np.sum(np.diag(R) ** 2), np.sum(R**4)])
    return variance, freedom, R @ z, expected, np.hypot(trend, np.sqrt(of_trend)), np.sqrt(ratio * variance)


def _likeliest(cost, m: np.ndarray) -> float:
    """Return the ratio of the walk's variance per second to the noise's that costs least, 0 where none does better."""
    logs = np.linspace(np.log(m.min() * 1e-2), np.log(m.max() * 1e2), RATIOS)
    best = logs[int(np.argmin([cost(np.exp(log)) for log in logs]))]
    width = logs[1] - logs[0]
    found = minimize_scalar(
        lambda log: cost(np.exp(log)), bounds=(best - width, best + width), method="bounded"
    )
    return float(np.exp(found.x)) if found.fun < cost(0.0) else 0.0
