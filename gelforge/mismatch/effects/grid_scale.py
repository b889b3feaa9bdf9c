"""The grid of positions is larger or smaller than commanded: a stage's pitch, a wrong unit of steps."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, half_an_element_far_out, has, solver

EFFECT = Effect(
    name="grid_scale",
    family="kinematics",
    parameters=(
        amount(
            "grid_scale", "growth", (-0.2, 0.2),
            "width: pitch of a belt stage (judgement; a screw's is good to 1e-3); bounds: off the sensor",
        ),
    ),
    signature="harder near all walls alike if larger; nothing in the middle",
    confused_with=("wall_stiffness", "lateral_play", "wall_gap", "yaw", "misregistration", "skin_stiffness"),
    separated_by="a dial gauge over the stage's range; images, which show where the ball presses",
    **solver("grid_scale", has("kinematics.grid_scale"))
    | {"across": half_an_element_far_out},
)  # fmt: skip
