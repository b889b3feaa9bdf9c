"""The force sensor reads too much or too little, axis by axis."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters
from gelforge.mismatch.model.solver_effects import on_each_axis

SOURCE = (
    "width: full-scale uncertainty of 1 to 2 % in common six-axis data sheets, a good deal more of the reading at a tenth of"
    " the range; bounds: a wrong unit or range is a data-entry error and not a gain"
)


def to_forces(context: Context, _: Hyperparameters, force: np.ndarray, theta: Sequence[float]) -> np.ndarray:
    """Return the forces with each axis by its own gain."""
    return force + force * np.asarray(theta)


EFFECT = Effect(
    name="force_gain",
    family="force sensor",
    parameters=on_each_axis("1", 0.05, (-0.5, 0.5), SOURCE),
    means=("the force sensor's gain is off",),
    signature="in proportion to the force at every place, depth and time; images clean",
    separated_by="dead weights on the force sensor; images, as particles follow the depth and not the reading",
    to_forces=to_forces,
)
