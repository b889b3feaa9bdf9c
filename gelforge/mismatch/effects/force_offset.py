"""The zero of a tared session is off. Where each indentation's own zero is subtracted, a constant cancels."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters
from gelforge.mismatch.model.solver_effects import on_each_axis

SOURCE = (
    "width: resolution and settling at taring of common six-axis sensors of tens of newtons (judgement); bounds: the weight"
    " of a mounted sensor"
)


def grid(context: Context) -> list[Hyperparameters]:
    """Return the sessions that were tared, one by one, and all at once: a zero that nobody took is the same in each."""
    observations = context.observations
    tared = observations.table["session"][observations.tared].unique()
    sessions: list[Hyperparameters] = [{"session": name} for name in tared]
    return sessions if len(sessions) == 1 else [{}, *sessions]


def to_forces(
    context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
) -> np.ndarray:
    """Return the forces with a constant at every reading of a tared session, or of all of them."""
    session = context.observations.table["session"]
    chosen = (
        (session == hyperparameters["session"]).to_numpy()
        if "session" in hyperparameters
        else np.ones(len(session), bool)
    )
    return force + np.outer(chosen & context.observations.tared, np.asarray(theta))


EFFECT = Effect(
    name="force_offset",
    family="force sensor",
    parameters=on_each_axis("N", 0.05, (-2.0, 2.0), SOURCE),
    means=("the force sensor's zero is off",),
    signature="the same force at every place and depth, without any at the contact point in the simulation",
    separated_by="readings before contact in every indentation, which a tared session may still have",
    to_forces=to_forces,
    grid=grid,
)
