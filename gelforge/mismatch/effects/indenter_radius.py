"""The ball is larger or smaller than described."""

from gelforge.mismatch.model.solver_effects import has, pressed_by_balls, solved

EFFECT = solved(
    "indenter_radius",
    "change",
    (-1.0, 1.0),
    "width: a printed or cast ball, 5 % of 5 mm (judgement; a bearing's ball is good to 1e-3 mm);"
    " bounds: a wrong ball",
    present=has("geometry.indenter_radius_change_mm"),
    means=(
        "the indenter's radius differs",
        "the indenter's radius is {size} larger than assumed",
        "the indenter's radius is {size} smaller than assumed",
    ),
    signature="harder with a larger ball, nearly in proportion, a little less at depth",
    separated_by="a calliper on the ball, or a second ball",
    applies=pressed_by_balls,
)
