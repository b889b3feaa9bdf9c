"""The gel has let go of the wall along its inner face."""

from gelforge.mismatch.model.solver_effects import has, has_wall, solved

EFFECT = solved(
    "wall_gap",
    "lost_share",
    (0.0, 1.0),
    "width and bounds: none to all of the bond of a strip of 0.5 mm",
    closed=True,
    present=has("geometry.wall_gap.loss"),
    means=("the gel has come off its wall",),
    signature="softer near the wall only, from small depths on",
    separated_by="indentations at several distances from the wall; a look from the side under an oblique light",
    applies=has_wall,
)
