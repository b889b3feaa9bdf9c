"""The skin is under a residual stretch: shrunk in curing, or bonded while stretched."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has_none_of, is_block, solver

EFFECT = Effect(
    name="prestretch",
    family="geometry",
    parameters=(
        amount(
            "prestretch", "stretch_less_1", (-0.15, 0.3),
            "width: cure shrinkage and handling of a thin skin, up to 5 % (judgement); bounds: it wrinkles, or is a drum",
        ),
    ),
    signature="a tight skin is harder from the first contact on, in proportion to depth; a slack one softer",
    confused_with=("skin_stiffness", "contact_zero", "toe_region"),
    separated_by="a cut through a spare skin (it opens), small depths, a small ball",
    applies=lambda study: (
        is_block(study) and has_none_of("geometry.prestretch")(study) and study.mechanics.strain == "finite"
    ),
    **solver("prestretch"),
)  # fmt: skip
