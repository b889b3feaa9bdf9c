"""The zero of a tared session is off. Where each indentation's own zero is subtracted, a constant cancels."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Effect, Shape
from gelforge.mismatch.model.solver_effects import on_each_axis

SOURCE = (
    "width: resolution and settling at taring of common six-axis sensors of tens of newtons (judgement); bounds: the weight"
    " of a mounted sensor"
)


def shapes(context: Context) -> list[Shape]:
    """Return the sessions that were tared, one by one, and all at once: a zero that nobody took is the same in each."""
    observations = context.observations
    tared = observations.table["session"][observations.tared].unique()
    each: list[Shape] = [{"session": name} for name in tared]
    return each if len(each) == 1 else [{}, *each]


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces with a constant at every reading of a tared session, or of all of them."""
    session = context.observations.table["session"]
    own = (session == shape["session"]).to_numpy() if "session" in shape else np.ones(len(session), bool)
    return force + np.outer(own & context.observations.tared, np.asarray(amounts))


EFFECT = Effect(
    name="force_offset",
    family="force sensor",
    parameters=on_each_axis("N", 0.05, (-2.0, 2.0), SOURCE),
    means=("the force sensor's zero is off",),
    signature="the same force at every place and depth, without any at the contact point in the simulation",
    separated_by="readings before contact in every indentation, which a tared session may still have",
    to_forces=to_forces,
    shapes=shapes,
)
