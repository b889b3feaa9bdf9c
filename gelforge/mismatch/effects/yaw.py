"""The grid of positions is turned about the sensor's middle."""

import numpy as np

from gelforge.config import Study
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, as_spin, half_an_element_far_out, has, solver


def across(study: Study) -> float:
    """Return the turn [deg] that moves what is far out by half an element."""
    return float(np.degrees(half_an_element_far_out(study)))


EFFECT = Effect(
    name="yaw",
    family="kinematics",
    parameters=(
        amount(
            "yaw", "turn", (-15.0, 15.0),
            "width: clamped by eye (judgement); bounds: seen by eye",
        ),
    ),
    signature="alternating sign around the walls, off the lines of symmetry only; nothing near the middle",
    confused_with=("misregistration", "grid_scale", "cross_talk"),
    separated_by="indentations close to the walls off the lines of symmetry; images",
    **solver("yaw", has("kinematics.yaw_deg"), directed=True)
    | {"turned": as_spin, "across": across},
)  # fmt: skip
