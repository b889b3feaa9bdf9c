"""The stage's origin lies elsewhere on the sensor than described."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import (
    amount,
    as_vector,
    first_order,
    half_an_element,
    pair_of,
    solver,
)

SOURCE = "width: an edge found by eye (judgement); bounds: a tenth of a usual sensor"

EFFECT = Effect(
    name="misregistration",
    family="kinematics",
    parameters=tuple(amount("misregistration", along, (-3.0, 3.0), SOURCE) for along in ("x", "y")),
    signature="near the walls harder on one side and softer on the other; nothing in the middle but a lateral force",
    confused_with=("thickness_gradient", "tilt", "yaw", "grid_scale", "cross_talk"),
    separated_by="indentations close to opposite walls; images, which show where the ball presses",
    **solver("misregistration")
    | {
        "to_study": pair_of(
            "kinematics",
            lambda study: study.mechanics.effects.kinematics.misregistration_mm,
            lambda study, both: {"misregistration_mm": both},
        ),
        "to_forces": first_order("misregistration", "x", "y"),
        "turned": as_vector,
        "across": half_an_element,
    },
)
