"""The stage has lateral play: where the ball lands depends on the side from which it came."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters, Parameter

AXES = ("x", "y")
SOURCE = "width: a belt or a worn screw (judgement; a preloaded one has 1e-3 mm); bounds: seen by eye"


def to_forces(context: Context, _: Hyperparameters, force: np.ndarray, theta: Sequence[float]) -> np.ndarray:
    """Return the forces with each indentation shifted by half of the play towards where the stage came from.

    By the derivatives along misregistration.
    """
    shifts = -0.5 * context.observations.came_along @ np.asarray(theta, dtype=float)  # (R, 2) [mm]
    for shift, axis in zip(shifts.T, AXES):
        force = force + shift[:, None] * context.derivative(f"misregistration.{axis}")
    return force


EFFECT = Effect(
    name="lateral_play",
    family="kinematics",
    parameters=tuple(Parameter(axis, "mm", 0.2, (0.0, 2.0), SOURCE) for axis in AXES),
    means=("the stage has lateral play",),
    signature="indentations to one place differ with the side from which the stage came; near a wall softer where"
    " it comes from within, harder where it comes from without",
    separated_by="one place near a wall, met from both sides in turn; the last move always from the same side",
    depends_on=("misregistration",),
    to_forces=to_forces,
)
