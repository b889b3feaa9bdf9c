"""Something hard in the gel: a lump of particles, a chip."""

from __future__ import annotations

from gelforge.mismatch.evidence import places
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, solver

EFFECT = Effect(
    name="inclusion",
    family="geometry",
    parameters=(
        amount(
            "inclusion", "rigidity", (0.0, 1.0),
            "width and bounds: none to all of what a rigid ball does to all around it, 0.86 of which one 16 times as stiff"
            " does", sign=1, whole=True,
        ),
    ),
    signature="harder over a few millimetres, more at depth",
    confused_with=("void", "contact_zero", "thickness_gradient"),
    separated_by="indentations 2 mm apart around the place; images, in which the lump itself is seen",
    shapes=lambda context: places.balls(context.study),
    **solver("inclusion", limit=(0.0, 1.0), directed=True)
    | {"to_forces": places.FirstOrderAt("inclusion", places.balls)},
)  # fmt: skip
