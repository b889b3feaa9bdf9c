"""Something hard in the gel: a lump of particles, a chip."""

from gelforge.mismatch.model.places import balls
from gelforge.mismatch.model.solver_effects import solved

EFFECT = solved(
    "inclusion",
    "rigidity",
    (0.0, 1.0),
    "width and bounds: none to all of what a rigid ball does to all around it, 0.86 of which one 16 times as stiff"
    " does",
    closed=True,
    directed=True,
    scanned=balls,
    means=("something hard is in the gel",),
    signature="harder over a few millimetres, more at depth",
    separated_by="indentations 2 mm apart around the place; images, in which the lump itself is seen",
)
