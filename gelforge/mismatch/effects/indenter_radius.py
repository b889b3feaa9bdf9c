"""The ball is larger or smaller than described."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has, solver

EFFECT = Effect(
    name="indenter_radius",
    family="geometry",
    parameters=(
        amount(
            "indenter_radius", "change", (-1.0, 1.0),
            "width: a printed or cast ball, 5 % of 5 mm (judgement; a bearing's ball is good to 1e-3 mm);"
            " bounds: a wrong ball",
        ),
    ),
    signature="harder with a larger ball, nearly in proportion, a little less at depth",
    confused_with=("gel_stiffness", "force_gain", "layer_thickness"),
    separated_by="a calliper on the ball, or a second ball",
    applies=lambda study: all(part.kind == "sphere" for part in study.indenter.shapes),
    **solver("indenter_radius", has("geometry.indenter_radius_change_mm")),
)  # fmt: skip
