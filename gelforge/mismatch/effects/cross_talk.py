"""The axes of the force sensor see each other, or are turned against the stage's."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters, Parameter

SOURCE = "width: cross-talk of 1 to 2 % of full scale in common data sheets, or a turn of 1 deg (0.017); bounds: 11 deg"
AXES = "xyz"
PAIRS = [(i, j) for i in range(3) for j in range(3) if i != j]


def to_forces(context: Context, _: Hyperparameters, force: np.ndarray, theta: Sequence[float]) -> np.ndarray:
    """Return the forces (R, 3) with shares of the other axes; opposite numbers of a pair are a small turn."""
    C = np.zeros((3, 3))
    for (i, j), share in zip(PAIRS, theta, strict=True):
        C[i, j] = share
    return force + force @ C.T


EFFECT = Effect(
    name="cross_talk",
    family="force sensor",
    parameters=tuple(Parameter(f"{AXES[i]}_of_{AXES[j]}", "1", 0.02, (-0.2, 0.2), SOURCE) for i, j in PAIRS),
    means=("the force sensor has cross-talk between its axes",),
    signature="lateral readings in proportion to the normal force, of one sign at every place",
    separated_by="dead weights along each axis; an indentation at the middle of a level sensor",
    to_forces=to_forces,
)
