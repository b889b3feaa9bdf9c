"""The gel has let go of the wall along its inner face."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has, solver

EFFECT = Effect(
    name="wall_gap",
    family="geometry",
    parameters=(
        amount(
            "wall_gap", "lost_share", (0.0, 1.0),
            "width and bounds: none to all of the bond of a strip of 0.5 mm", sign=1, whole=True,
        ),
    ),
    signature="softer near the wall only, from small depths on",
    confused_with=("wall_stiffness", "wall_side", "delamination", "grid_scale"),
    separated_by="indentations at several distances from the wall; a look from the side under an oblique light",
    applies=lambda study: study.sensor.wall_mm > 0 and study.sensor.shape.kind == "block",
    **solver("wall_gap", has("geometry.wall_gap.loss"), limit=(0.0, 1.0)),
)  # fmt: skip
