"""The skin, with the wall of its material, is stiffer or softer than its law."""

from gelforge.mismatch.model.solver_effects import solved

EFFECT = solved(
    "skin_stiffness",
    "growth",
    (-0.8, 4.0),
    "width: scatter of silicone rubbers by batch and cure (judgement); bounds: still a rubber",
    means=(
        "the skin differs in stiffness",
        "the skin is {share} stiffer than simulated",
        "the skin is {share} softer than simulated",
    ),
    signature="force in proportion, more at small depth, where the skin bends and stretches, and near the wall",
    separated_by="indentations next to the wall against the middle, from small depths on; a material test of the skin",
    applies=lambda study: len(study.sensor.layers) > 1,
)
