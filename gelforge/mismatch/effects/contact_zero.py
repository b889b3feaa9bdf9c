"""Depth zero was found too late or too early in all indentations alike."""

from gelforge.mismatch.model.solver_effects import has, solved

EFFECT = solved(
    "contact_zero",
    "deeper",
    (-0.5, 0.5),
    "width: touch found by a force threshold on a soft surface (judgement); bounds: seen by eye",
    present=has("kinematics.contact_zero_mm"),
    means=(
        "the contact point is off",
        "the indenter goes {size} deeper than recorded",
        "the indenter goes {size} less deep than recorded",
    ),
    signature="slope of the force over depth: a larger share of the force the smaller the depth, alike everywhere",
    separated_by="many small depths, with touch found anew by another threshold",
)
