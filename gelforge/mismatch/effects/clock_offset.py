"""The force's clock is late or early against the stage's: forces belong to an earlier depth, or a later one."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters, Parameter
from gelforge.mismatch.model.solver_effects import per_depth

STAMPS = ("late", "early")  # forces belong to the way before a reading, or to that after it


def speed(context: Context, stamp: str) -> np.ndarray:
    """Return the speed (R,) [mm/s] at which depth grows before (late) or after (early) a reading; 0 where the stage waits.

    Before: from the reading before, or touch. After: to the next reading of the same way; at the end of a loading the
    stage stops, at that of an unloading it goes on.
    """
    table = context.observations.table
    press = table["press"].to_numpy()
    before = table.groupby("press", sort=False)[["press_time_s", "depth_mm"]].shift(fill_value=0.0)
    seconds = (table["press_time_s"] - before["press_time_s"]).to_numpy(float)
    way = (table["depth_mm"] - before["depth_mm"]).to_numpy(float)
    moving = table["phase"].isin(["load", "unload"]).to_numpy() & (seconds > 0)
    speeds = pd.Series(np.where(moving, way / np.where(moving, seconds, 1.0), 0.0), table.index)
    if stamp == "late":
        return speeds.to_numpy()
    following = table["phase"].groupby(press, sort=False).shift(-1)
    after = speeds.groupby(press, sort=False).shift(-1).where(following == table["phase"], 0.0)
    return after.where(following.notna() | (table["phase"] != "unload"), speeds).to_numpy()


def grid(context: Context) -> list[Hyperparameters]:
    """Return a force read late and one read early: at the end of a way they are no mirror images."""
    return [{"stamp": stamp} for stamp in STAMPS]


def to_forces(
    context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
) -> np.ndarray:
    """Return the forces of `lag` seconds before at moving readings: by `per_depth` and speed.

    Without hyperparameters the lag's sign says which way it is.
    """
    (lag,) = theta
    stamp = str(hyperparameters.get("stamp", "late" if lag >= 0 else "early"))
    return force - lag * speed(context, stamp)[:, None] * per_depth(context)


SOURCE = (
    "width: recorders without a common trigger, or a filter of some hertz (judgement); bounds: seen by eye"
)
EFFECT = Effect(
    name="clock_offset",
    family="kinematics",
    parameters=(Parameter("lag", "s", 0.05, (-1.0, 1.0), SOURCE),),
    means=("the clocks of force sensor and stage disagree",),
    signature="less force during loading and more during unloading, in proportion to speed; nothing while the stage waits",
    separated_by="the same indentation at two speeds, with a wait at the end; one trigger line for all recorders",
    depends_on=("contact_zero",),
    to_forces=to_forces,
    grid=grid,
)
