"""A patch between gel and skin has let go and slides."""

from gelforge.mismatch.evidence import places
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has_none_of, is_block, solver

EFFECT = Effect(
    name="delamination",
    family="geometry",
    parameters=(
        amount(
            "delamination", "lost_share", (0.0, 1.0),
            "width and bounds: none to all of the shear stiffness of the patch", sign=1, whole=True,
        ),
    ),
    signature="softer over a patch of a few millimetres, with lateral forces of opposite sign on its two sides",
    confused_with=("void", "wall_gap", "misregistration"),
    separated_by="indentations 2 mm apart across the patch; images: particles under it stay behind the skin",
    shapes=lambda context: places.patches(context.study),
    applies=lambda study: is_block(study) and has_none_of("geometry.delaminations")(study),
    **solver("delamination", limit=(0.0, 1.0), directed=True)
    | {"to_forces": places.FirstOrderAt("delamination", places.patches)},
)  # fmt: skip
