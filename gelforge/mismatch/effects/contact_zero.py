"""Depth zero was found too late or too early in all indentations alike."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has, solver

EFFECT = Effect(
    name="contact_zero",
    family="kinematics",
    parameters=(
        amount(
            "contact_zero", "deeper", (-0.5, 0.5),
            "width: touch found by a force threshold on a soft surface (judgement); bounds: seen by eye",
        ),
    ),
    signature="slope of the force over depth: a larger share of the force the smaller the depth, alike everywhere",
    confused_with=("toe_region", "tilt", "indenter_radius", "force_offset"),
    separated_by="many small depths, with touch found anew by another threshold",
    **solver("contact_zero", has("kinematics.contact_zero_mm")),
)  # fmt: skip
