"""A bubble, or a soft spot, in the gel."""

from gelforge.mismatch.model.places import balls
from gelforge.mismatch.model.solver_effects import solved

EFFECT = solved(
    "void",
    "emptiness",
    (0.0, 1.0),
    "width and bounds: none to all of what an empty ball does to all around it",
    closed=True,
    directed=True,
    scanned=balls,
    means=("there is a void in the gel",),
    signature="softer over a few millimetres, more at depth",
    separated_by="indentations 2 mm apart around the place; images, in which the bubble itself is seen",
)
