"""The law is linear where it is not: neo-Hookean moduli in place of the fitted law.

A base with neo-Hookean laws gets the fitted ones of the same moduli. A base of small strain is linear in both senses: it
gets the fitted laws, at finite strain, without which they have no meaning. A base with fitted laws has nothing to be put
right; that another law holds is `law_exponent`.
"""

from gelforge.config import Mechanics
from gelforge.mismatch.model.solver_effects import simplification


def changes(mechanics: Mechanics, linear_law: bool = False) -> dict:
    """Return the keys of mechanics that bring the fitted laws, or linear ones, at finite strain."""
    finite = {"strain": "finite", "contact_normals": "current"} if mechanics.strain == "small" else {}
    return finite | {"effects": {"material": {"linear_law": linear_law}}}


EFFECT = simplification(
    "linear_elasticity",
    lambda mechanics, hyperparameters: changes(mechanics),
    means=("the gel is not linear elastic as simulated",),
    signature="nothing at small depth, growing with depth, most at the deepest indentations and near the wall",
    separated_by="a material test to the stretches under the ball; the nominal model solved with both constitutive models",
    applies=lambda study: study.mechanics.strain == "small" or study.mechanics.effects.material.linear_law,
)
