"""The force sensor's zero drifts: over a tared session, or from an indentation's own zero rows on."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters
from gelforge.mismatch.model.solver_effects import on_each_axis

SOURCE = (
    "width: warming up of strain gauges, of the order of 0.1 N in the first hour for ranges of tens of newtons (judgement);"
    " bounds: seen by eye"
)


def hours(context: Context) -> np.ndarray:
    """Return the time (R,) [h] since zero: the session's first reading if it is tared, the indentation's touch if not."""
    table = context.observations.table
    of_session = table["time_s"] - table.groupby("session")["time_s"].transform("min")
    return np.where(context.observations.tared, of_session, table["press_time_s"]) / 3600.0


def grid(context: Context) -> list[Hyperparameters]:
    """Return a drift that goes on evenly, and of a tared session one that settles, as what warms up does."""
    # electronics settle in minutes, a machine in the better part of an hour (judgement)
    settling: list[Hyperparameters] = [{"settles_s": 120.0}, {"settles_s": 600.0}]
    return [{}, *settling] if context.observations.tared.any() else [{}]


def to_forces(
    context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
) -> np.ndarray:
    """Return the forces with a zero that grows in time, evenly or exponentially to rest, by the values in an hour."""
    t = hours(context)
    if "settles_s" in hyperparameters:
        tau = float(hyperparameters["settles_s"]) / 3600.0
        t = np.expm1(-t / tau) / np.expm1(-1.0 / tau)
    return force + np.outer(t, theta)


EFFECT = Effect(
    name="force_drift",
    family="force sensor",
    parameters=on_each_axis("N/h", 0.1, (-5.0, 5.0), SOURCE),
    means=("the force sensor's zero drifts",),
    signature="the same force at every place and depth, growing with time for good or until all is warm; in raster order"
    " a slope over the sensor",
    separated_by="random order, zero readings before and after every indentation",
    to_forces=to_forces,
    grid=grid,
)
