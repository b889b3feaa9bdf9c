"""The grid of positions is turned about the sensor's middle."""

import numpy as np

from gelforge.config import Study
from gelforge.mismatch.model.solver_effects import as_spin, half_an_element_far_out, has, solved


def across(study: Study) -> float:
    """Return the turn [deg] that moves what is far out by half an element."""
    return float(np.degrees(half_an_element_far_out(study)))


EFFECT = solved(
    "yaw",
    "turn",
    (-15.0, 15.0),
    "width: clamped by eye (judgement); bounds: seen by eye",
    present=has("kinematics.yaw_deg"),
    directed=True,
    means=("the sensor is turned on the stage",),
    signature="alternating sign around the walls, off the lines of symmetry only; nothing near the middle",
    separated_by="indentations close to the walls off the lines of symmetry; images",
    turned=as_spin,
    across=across,
)
