"""The skin is under a residual stretch: shrunk in curing, or bonded while stretched."""

from gelforge.mismatch.model.solver_effects import has_none_of, is_block, solved

EFFECT = solved(
    "prestretch",
    "stretch_less_1",
    (-0.15, 0.3),
    "width: cure shrinkage and handling of a thin skin, up to 5 % (judgement); bounds: it wrinkles, or is a drum",
    means=("the gel is stretched before it is pressed",),
    signature="a tight skin is harder from the first contact on, in proportion to depth; a slack one softer",
    separated_by="a cut through a spare skin (it opens), small depths, a small ball",
    applies=lambda study: (
        is_block(study) and has_none_of("geometry.prestretch")(study) and study.mechanics.strain == "finite"
    ),
)
