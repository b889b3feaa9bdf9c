"""The force sensor lags behind: it reads more during unloading than during loading at the same force."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters
from gelforge.mismatch.model.solver_effects import on_each_axis


def grid(context: Context) -> list[Hyperparameters]:
    """Return both loops; none without readings during unloading, where they have nothing that is theirs alone."""
    up = (context.observations.table["phase"] == "unload").any()
    return [{"loop": loop} for loop in LOOPS] if up else []


def largest_so_far(context: Context, force: np.ndarray) -> np.ndarray:
    """Return by axis the largest force (R, 3) [N] of each reading's press so far, with its sign."""
    largest = np.zeros_like(force)
    for rows in context.observations.table.groupby("press", sort=False).indices.values():
        F = force[rows]
        size = np.abs(F)
        number = np.where(size >= np.maximum.accumulate(size, axis=0), np.arange(len(rows))[:, None], 0)
        largest[rows] = np.take_along_axis(F, np.maximum.accumulate(number, axis=0), axis=0)
    return largest


def lens(context: Context, force: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the opening (R, 3) [N] share (3,) 4 s (1 - s) P, s = F / P and P the largest F of the indentation so far.

    It is zero at the peak and at no force and share P at half of it: hysteresis as data sheets define it, by axis.
    """
    P = largest_so_far(context, force)
    s = np.clip(np.divide(force, P, out=np.ones_like(force), where=P != 0), 0.0, 1.0)
    return share * 4 * s * (1 - s) * P


def play(context: Context, force: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the opening (R, 3) [N] of a reading that stays where it is as long as the force is within a band about it.

    Half of the band is a share (3,) of the largest base force of all, by axis: during loading the reading is so much too
    small, during unloading too large (Prandtl's play, as Coulomb friction in a mount makes it).
    """
    largest = np.max([np.abs(values).max(axis=0) for values in context.curves.values], axis=0)
    if not largest.any():  # weights that lie still
        largest = np.abs(context.force).max(axis=0)
    half = share * largest
    shown = np.empty_like(force)
    for rows in context.observations.table.groupby("press", sort=False).indices.values():
        last = np.zeros(3)
        for row in rows:
            last = shown[row] = np.clip(last, force[row] - half, force[row] + half)
    return shown - force


# A material that damps, as data sheets draw it; friction of a mount, as wide at any force.
LOOPS = {"lens": lens, "play": play}


def to_forces(
    context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
) -> np.ndarray:
    """Return the forces as a sensor with hysteresis reads them; the lens is calibrated during loading."""
    return force + LOOPS[str(hyperparameters.get("loop", "lens"))](context, force, np.asarray(theta))


SOURCE = (
    "width: data sheets of load cells give 0.1 to 1 % of full scale, printed and optical ones several per cent;"
    " bounds: no sensor to measure with"
)
EFFECT = Effect(
    name="force_hysteresis",
    family="force sensor",
    parameters=on_each_axis("1", 0.02, (0.0, 0.3), SOURCE),
    means=("the force sensor has hysteresis",),
    signature="more force during unloading than during loading, most at half of the indentation's largest force or"
    " as much at any",
    separated_by="dead weights put on and taken off; unloading at two speeds (hysteresis does not know time)",
    to_forces=to_forces,
    grid=grid,
)
