"""The machine's frame yields in series with the sensor."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Hyperparameters
from gelforge.mismatch.model.solver_effects import has, per_depth, solved


def to_forces(context: Context, _: Hyperparameters, force: np.ndarray, theta: Sequence[float]) -> np.ndarray:
    """Return the forces to first order: less deep by compliance x pressing force; no solution is needed."""
    (c,) = theta
    return force + c * context.force[:, 2:] * per_depth(context)  # Fz is negative where the indenter presses


EFFECT = solved(
    "frame_compliance",
    "compliance",
    (0.0, 0.5),
    "width: 20 N/mm, a light printed frame with a force sensor (judgement; machined ones have 1000); bounds: 2 N/mm."
    " A negative compliance fits many stiffening curves and is no physics",
    present=has("kinematics.frame_compliance_mm_per_N"),
    means=("the stage's frame is compliant",),
    signature="softer as force times slope: nothing at small depth, most at the deepest indentations and near the wall",
    separated_by="pressing a rigid block in place of the sensor; images, which show the true depth",
    depends_on=("contact_zero",),
    to_forces=to_forces,
)
