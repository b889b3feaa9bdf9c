"""The wall is stiffer or softer than its law."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, solver

EFFECT = Effect(
    name="wall_stiffness",
    family="geometry",
    parameters=(
        amount(
            "wall_stiffness", "growth", (-0.95, 10.0),
            "width: another batch, or a wall thicker or thinner by half of itself (judgement); bounds: hardly there, or a"
            " harder rubber",
        ),
    ),
    signature="only near the wall, growing with depth; also a lateral force away from it",
    confused_with=("wall_gap", "skin_stiffness", "grid_scale"),
    separated_by="indentations at several distances from the wall, on all four sides",
    applies=lambda study: study.sensor.wall_mm > 0 and study.sensor.shape.kind == "block",
    **solver("wall_stiffness"),
)  # fmt: skip
