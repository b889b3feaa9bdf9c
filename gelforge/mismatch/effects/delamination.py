"""A patch between gel and skin has let go and slides."""

from gelforge.mismatch.model.places import patches
from gelforge.mismatch.model.solver_effects import has_none_of, is_block, solved

EFFECT = solved(
    "delamination",
    "lost_share",
    (0.0, 1.0),
    "width and bounds: none to all of the shear stiffness of the patch",
    closed=True,
    directed=True,
    scanned=patches,
    means=("the skin has come off the gel in one place",),
    signature="softer over a patch of a few millimetres, with lateral forces of opposite sign on its two sides",
    separated_by="indentations 2 mm apart across the patch; images: particles under it stay behind the skin",
    applies=lambda study: is_block(study) and has_none_of("geometry.delaminations")(study),
)
