"""The law stiffens otherwise beyond the stretches of its fit: Ogden's exponents, the limiting chain."""

from gelforge.mismatch.model.solver_effects import has_none_of, solved

EFFECT = solved(
    "law_exponent",
    "growth",
    (-0.9, 2.0),
    "width: exponents of fits to one material's different tests differ by tens of per cent (judgement); bounds: the"
    " exponents keep their sign",
    means=("the gel stiffens differently at large strain than its model",),
    signature="nothing at small depth, growing faster than the force at the deepest indentations",
    separated_by="deeper indentations, a smaller ball (more stretch at less force), a material test to larger stretches",
    applies=has_none_of("material.exponent_factor", "material.linear_law"),
)
