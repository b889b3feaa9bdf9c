"""What carries the layers is elastic and not rigid."""

from gelforge.config import Study
from gelforge.mismatch.model.solver_effects import solved


def present(study: Study) -> float:
    """Return 1/E [1/MPa] of the slab that the base study has, 0 without."""
    base = study.mechanics.effects.geometry.base
    return 1 / base.youngs_modulus_MPa if base and base.youngs_modulus_MPa else 0.0


EFFECT = solved(
    "elastic_base",
    "yielding",
    (0.0, 10.0),
    "width: a slab of 1 MPa, a silicone rubber; bounds: 0.1 MPa is as soft as a skin",
    present=present,
    means=("the base under the gel is compliant",),
    signature="softer everywhere in proportion to the force per area, more at depth, more in the middle than near the wall",
    separated_by="an indentation with a wide flat indenter, or a displacement sensor on the base",
    applies=lambda study: not study.tetrahedra,
)
