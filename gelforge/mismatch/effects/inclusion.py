"""Something hard in the gel: a lump of particles, a chip."""

from gelforge.mismatch import places
from gelforge.mismatch.effect import Effect
from gelforge.mismatch.solver_effects import amount, solver

EFFECT = Effect(
    name="inclusion",
    family="geometry",
    parameters=(
        amount(
            "inclusion", "growth", (0.0, 9e3),
            "width: a ball of 2 mm ten times as stiff, which is nearly rigid (judgement); bounds: rigid", sign=1,
        ),
    ),
    signature="harder over a few millimetres, more at depth",
    confused_with=("void", "contact_zero", "thickness_gradient"),
    separated_by="presses 2 mm apart around the place; images, in which the lump itself is seen",
    shapes=lambda context: places.balls(context.study),
    **solver("inclusion", limit=(0.0, 9e3), directed=True)
    | {"to_forces": places.FirstOrderAt("inclusion", places.balls)},
)  # fmt: skip
