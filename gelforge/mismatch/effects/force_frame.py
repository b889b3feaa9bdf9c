"""A blunder: the lateral axes of the force sensor, or of the stage, are not those that the session states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.context import Context
from gelforge.mismatch.effect import Effect, Parameter, Shape
from gelforge.mismatch.solver_effects import ON

# What was read as (Fx, Fy), of the force (Fx, Fy) on the sensor: all other ways to lay a square on itself.
READ = {
    "turned by 90 deg": ((0, -1), (1, 0)),
    "turned by 180 deg": ((-1, 0), (0, -1)),
    "turned by 270 deg": ((0, 1), (-1, 0)),
    "x reversed": ((-1, 0), (0, 1)),
    "y reversed": ((1, 0), (0, -1)),
    "x and y swapped": ((0, 1), (1, 0)),
    "x and y swapped and reversed": ((0, -1), (-1, 0)),
}


def shapes(context: Context) -> list[Shape]:
    """Return the ways to take the lateral axes for others."""
    return [{"axes": name} for name in READ]


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces along the axes that are meant."""
    (a,) = amounts
    read = np.array(READ[str(shape.get("axes", "x and y swapped"))], dtype=float)
    change = np.zeros_like(force)
    change[:, :2] = force[:, :2] @ read.T - force[:, :2]
    return force + a * change


EFFECT = Effect(
    name="force_frame",
    family="analyst",
    parameters=(Parameter("on", "1", 1.0, ON, "on or off: a blunder of the session, no quantity", sign=1),),
    enters="force.axes and stage_to_sensor in session.yaml",
    signature="lateral forces as large as they should be, along other axes; vertical forces clean",
    confused_with=("cross_talk", "misregistration"),
    separated_by="a look at how the force sensor is mounted; one press beside each wall, which pushes the ball away from it",
    to_forces=to_forces,
    shapes=shapes,
    switch=True,
)
