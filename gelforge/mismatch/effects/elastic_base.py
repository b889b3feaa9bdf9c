"""What carries the layers is elastic and not rigid."""

from gelforge.config import Study
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, solver


def present(study: Study) -> float:
    """Return 1/E [1/MPa] of the slab that the base study has, 0 without."""
    base = study.mechanics.effects.geometry.base
    return 1 / base.youngs_modulus_MPa if base and base.youngs_modulus_MPa else 0.0


EFFECT = Effect(
    name="elastic_base",
    family="material",
    parameters=(
        amount(
            "elastic_base", "yielding", (0.0, 10.0),
            "width: a slab of 1 MPa, a silicone rubber; bounds: 0.1 MPa is as soft as a skin", sign=1,
        ),
    ),
    signature="softer everywhere in proportion to the force per area, more at depth, more in the middle than near the wall",
    confused_with=("frame_compliance", "base_bending", "compressibility", "law_exponent"),
    separated_by="an indentation with a wide flat indenter, or a displacement sensor on the base",
    applies=lambda study: not study.tetrahedra,
    **solver("elastic_base", present),
)  # fmt: skip
