"""The wall is stiffer or softer than its law."""

from gelforge.mismatch.model.solver_effects import has_wall, solved

EFFECT = solved(
    "wall_stiffness",
    "growth",
    (-0.95, 10.0),
    "width: another batch, or a wall thicker or thinner by half of itself (judgement); bounds: hardly there, or a"
    " harder rubber",
    means=(
        "the wall differs in stiffness",
        "the wall is {share} stiffer than simulated",
        "the wall is {share} softer than simulated",
    ),
    signature="only near the wall, growing with depth; also a lateral force away from it",
    separated_by="indentations at several distances from the wall, on all four sides",
    applies=has_wall,
)
