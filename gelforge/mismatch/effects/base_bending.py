"""The base plate, held at its edges, bends under the indentation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Effect, Shape
from gelforge.mismatch.model.solver_effects import amount, has, per_depth, solver


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces to first order: less deep by the plate's sag: its first mode, driven and read at the indentation."""
    (c,) = amounts
    sensor = context.study.sensor
    xy = context.observations.table[["x_mm", "y_mm"]].to_numpy(float)
    mode = np.sin(np.pi * xy / [sensor.width_x_mm, sensor.width_y_mm]).prod(axis=1)
    return force + c * mode[:, None] ** 2 * context.force[:, 2:] * per_depth(context)


EFFECT = Effect(
    name="base_bending",
    family="kinematics",
    parameters=(
        amount(
            "base_bending", "compliance", (0.0, 0.5),
            "width: 20 N/mm at its middle, a thin acrylic plate over the camera (judgement); bounds: 2 N/mm", sign=1,
        ),
    ),
    signature="softer in the middle, as force times slope; nothing at the edges",
    confused_with=("frame_compliance", "compressibility", "elastic_base"),
    separated_by="a dial gauge under the plate; a rigid block pressed at the middle and at the edge",
    depends_on=("contact_zero",),
    **solver("base_bending", has("kinematics.base_bending_mm_per_N")) | {"to_forces": to_forces},
)  # fmt: skip
