"""The grid of positions is larger or smaller than commanded: a stage's pitch, a wrong unit of steps."""

from gelforge.mismatch.model.solver_effects import half_an_element_far_out, has, solved

EFFECT = solved(
    "grid_scale",
    "growth",
    (-0.2, 0.2),
    "width: pitch of a belt stage (judgement; a screw's is good to 1e-3); bounds: off the sensor",
    present=has("kinematics.grid_scale"),
    means=("the stage's grid is scaled",),
    signature="harder near all walls alike if larger; nothing in the middle",
    separated_by="a dial gauge over the stage's range; images, which show where the ball presses",
    across=half_an_element_far_out,
)
