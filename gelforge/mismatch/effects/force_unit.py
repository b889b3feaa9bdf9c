"""A blunder: the readings are not in newtons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.context import Context
from gelforge.mismatch.effect import Effect, Parameter, Shape
from gelforge.mismatch.solver_effects import ON

# What is read of one newton; thousands are refused when a recording is read.
READ = {
    "kgf": 1 / 9.80665,
    "lbf": 1 / 4.4482216,
    "N, multiplied by 9.81": 9.80665,
    "N, multiplied by 4.45": 4.4482216,
}


def shapes(context: Context) -> list[Shape]:
    """Return the units that force sensors come with."""
    return [{"unit": name} for name in READ]


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces in the other unit."""
    (a,) = amounts
    return force + a * (READ[str(shape.get("unit", "kgf"))] - 1) * force


EFFECT = Effect(
    name="force_unit",
    family="analyst",
    parameters=(Parameter("on", "1", 1.0, ON, "on or off: a blunder of the session, no quantity", sign=1),),
    enters="force readings: a unit other than the newtons that their columns state",
    signature="all forces in proportion, by a factor between two units; images clean",
    confused_with=("force_gain", "body_stiffness"),
    separated_by="one known weight on the force sensor",
    to_forces=to_forces,
    shapes=shapes,
    switch=True,
    form_error=0.02,  # of the base's own errors, which grow with the factor
)
