"""The law stiffens otherwise beyond the stretches of its fit: Ogden's exponents, the limiting chain."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has_none_of, solver

EFFECT = Effect(
    name="law_exponent",
    family="material",
    parameters=(
        amount(
            "law_exponent", "growth", (-0.9, 2.0),
            "width: exponents of fits to one material's different tests differ by tens of per cent (judgement); bounds: the"
            " exponents keep their sign",
        ),
    ),
    signature="nothing at small depth, growing faster than the force at the deepest indentations",
    confused_with=("frame_compliance", "compressibility", "friction", "linear_elasticity", "small_strain"),
    separated_by="deeper indentations, a smaller ball (more stretch at less force), a material test to larger stretches",
    applies=has_none_of("material.exponent_factor", "material.linear_law"),
    **solver("law_exponent"),
)  # fmt: skip
