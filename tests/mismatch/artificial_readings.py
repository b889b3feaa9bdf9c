"""Artificial readings next to a base, for tests of the inference: a force that grows like Hertz's, no mechanics solved."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.mismatch.evidence.covariance import Covariance, readings_covariance
from gelforge.mismatch.model.effect import Context, Curves
from gelforge.mismatch.readings.observations import Observations

WIDTH = 32.0  # mm
NOISE, ZERO, CONTACT_POINT, FLOOR, LAW = 0.010, 0.004, 0.02, 0.01, 0.02  # N, N, mm, share, share


def grid(n: int, spacing: float = 5.0) -> np.ndarray:
    """Return the (n*n, 2) positions [mm] of a centred grid."""
    axis = WIDTH / 2 + spacing * (np.arange(n) - (n - 1) / 2)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def base_force(xy: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return forces (..., 3) [N]: z like Hertz's ball, a sideways part off the centre."""
    fz = -0.4 * np.maximum(depth, 0) ** 1.5
    lean = 0.2 * (xy - WIDTH / 2) / WIDTH
    return np.stack([lean[..., 0] * fz, lean[..., 1] * fz, fz], axis=-1)


def readings(
    sites: np.ndarray,
    depths=(0.5, 1.0, 1.5, 2.0),
    seed: int = 0,
    unload: bool = False,
    sessions: int = 1,
    zero_by: str = "press",
    blind: tuple[int, ...] = (),
    dwell: int = 0,
    rounding: float = 0.0,
    drift: float = 0.0,
    trend: float = 0.0,
) -> Context:
    """Return a context of presses in random order, one for each site and depth, read at half depth and at depth.

    The forces of its observations are the base's; draws of a covariance are added by the tests. blind: axes not read.
    dwell: further readings at the depth. rounding: standard deviation [N] that they share.
    zero_by: who has an error of the depth: press, session or both. drift [N/s^0.5], trend [N/s]: of the zero.
    """
    rng = np.random.default_rng(seed)
    rows, press = [], 0
    for session in range(sessions):
        plan = rng.permutation([(s, d) for s in range(len(sites)) for d in depths])
        for order, (site, deepest) in enumerate(plan):
            path = [(deepest / 2, "load"), (deepest, "load")] + dwell * [(deepest, "dwell")]
            path += unload * [(deepest / 2, "unload")]
            for k, (depth, phase) in enumerate(path):
                x, y = sites[int(site)]
                time = 20.0 * order + 2 * k
                row = (f"s{session}", press, order, int(site), phase, time, 2.0 * k + 1, x, y, depth)
                rows.append((*row, deepest, 3.0 * session, 23.0))
            press += 1
    names = "session press order site phase time_s press_time_s x_mm y_mm depth_mm deepest_mm age_days temperature_C"
    table = pd.DataFrame(rows, columns=names.split())
    force = base_force(table[["x_mm", "y_mm"]].to_numpy(), table["depth_mm"].to_numpy())
    measured = force.copy()
    measured[:, list(blind)] = np.nan
    of = np.ones_like(force)
    observations = Observations(
        table,
        measured,
        sites,
        NOISE * of,
        ZERO * of,
        *(CONTACT_POINT * (zero_by in (by, "both")) * of[:, 0] for by in ("press", "session")),
        rounding_N=rounding,
        drift_N=drift * np.sqrt(table["press_time_s"].to_numpy())[:, None],
        trend_N=trend * table["press_time_s"].to_numpy()[:, None],
    )
    knots = np.linspace(0.05, max(depths), 40)
    values = tuple(base_force(np.broadcast_to(xy, (40, 2)), knots) for xy in sites)
    curves = Curves(tuple([knots] * len(sites)), values)
    return Context(None, observations, force, curves, {})  # the inference never looks at the study


def law_directions(context: Context) -> np.ndarray:
    """Return (R, 3, 2) [N]: the base's two uncertain directions, its scale and its exponent."""
    depth = context.observations.table["depth_mm"].to_numpy()[:, None]
    return LAW * np.stack([context.force, context.force * (depth - 1)], axis=-1)


def covariance_of(context: Context) -> Covariance:
    return readings_covariance(context, law_directions(context), FLOOR * context.force)


def flat_base(context: Context) -> np.ndarray:
    return context.observations.flat(context.force)


def draws_of(covariance: Covariance, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return draws (n, count) of N(0, C): what is independent, and of each group of a level its directions times draws."""
    found = np.sqrt(covariance.variance)[:, None] * rng.standard_normal((len(covariance), count))
    for level in covariance.levels:
        for group in np.unique(level.group):
            own = level.group == group
            found[own] += level.directions[own] @ rng.standard_normal((level.directions.shape[1], count))
    return found
