"""The base plate, held at its edges, bends under the indentation."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Hyperparameters
from gelforge.mismatch.model.solver_effects import has, per_depth, solved


def to_forces(context: Context, _: Hyperparameters, force: np.ndarray, theta: Sequence[float]) -> np.ndarray:
    """Return the forces to first order: less deep by the plate's sag: its first mode, driven and read at the indentation."""
    (c,) = theta
    sensor = context.study.sensor
    xy = context.observations.table[["x_mm", "y_mm"]].to_numpy(float)
    mode = np.sin(np.pi * xy / [sensor.width_x_mm, sensor.width_y_mm]).prod(axis=1)
    return force + c * mode[:, None] ** 2 * context.force[:, 2:] * per_depth(context)


EFFECT = solved(
    "base_bending",
    "compliance",
    (0.0, 0.5),
    "width: 20 N/mm at its middle, a thin acrylic plate over the camera (judgement); bounds: 2 N/mm",
    present=has("kinematics.base_bending_mm_per_N"),
    means=("the base under the gel bends",),
    signature="softer in the middle, as force times slope; nothing at the edges",
    separated_by="a dial gauge under the plate; a rigid block pressed at the middle and at the edge",
    depends_on=("contact_zero",),
    to_forces=to_forces,
)
