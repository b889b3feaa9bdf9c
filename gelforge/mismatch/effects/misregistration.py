"""The stage's origin lies elsewhere on the sensor than described."""

from gelforge.mismatch.model.solver_effects import as_vector, half_an_element, has, solved

EFFECT = solved(
    "misregistration",
    ("x", "y"),
    (-3.0, 3.0),
    "width: an edge found by eye (judgement); bounds: a tenth of a usual sensor",
    has("kinematics.misregistration_mm"),
    keys=lambda study, both: {"kinematics": {"misregistration_mm": both}},
    means=("the sensor lies elsewhere on the stage than assumed",),
    signature="near the walls harder on one side and softer on the other; nothing in the middle but a lateral force",
    separated_by="indentations close to opposite walls; images, which show where the ball presses",
    turned=as_vector,
    across=half_an_element,
)
