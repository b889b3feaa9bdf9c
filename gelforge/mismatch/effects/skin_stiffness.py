"""The skin, with the wall of its material, is stiffer or softer than its law."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, solver

EFFECT = Effect(
    name="skin_stiffness",
    family="material",
    parameters=(
        amount(
            "skin_stiffness", "growth", (-0.8, 4.0),
            "width: scatter of silicone rubbers by batch and cure (judgement); bounds: still a rubber",
        ),
    ),
    signature="force in proportion, more at small depth, where the skin bends and stretches, and near the wall",
    confused_with=("gel_stiffness", "force_gain", "wall_stiffness", "prestretch", "toe_region"),
    separated_by="indentations beside the wall against the middle, from small depths on; a material test of the skin",
    applies=lambda study: len(study.sensor.layers) > 1,
    **solver("skin_stiffness"),
)  # fmt: skip
