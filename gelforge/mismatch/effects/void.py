"""A bubble, or a soft spot, in the gel."""

from gelforge.mismatch.evidence import places
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, solver

EFFECT = Effect(
    name="void",
    family="geometry",
    parameters=(
        amount(
            "void", "emptiness", (0.0, 1.0),
            "width and bounds: none to all of what an empty ball does to all around it", sign=1, whole=True,
        ),
    ),
    signature="softer over a few millimetres, more at depth",
    confused_with=("delamination", "inclusion", "contact_zero"),
    separated_by="indentations 2 mm apart around the place; images, in which the bubble itself is seen",
    shapes=lambda context: places.balls(context.study),
    **solver("void", limit=(0.0, 1.0), directed=True)
    | {"to_forces": places.FirstOrderAt("void", places.balls)},
)  # fmt: skip
