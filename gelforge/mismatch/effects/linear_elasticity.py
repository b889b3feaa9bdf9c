"""The law is linear where it is not: neo-Hookean moduli in place of the fitted law.

A base with neo-Hookean laws gets the fitted ones of the same moduli. A base of small strain is linear in both senses: it
gets the fitted laws, at finite strain, without which they have no meaning. A base with fitted laws has nothing to be put
right; that another law holds is `law_exponent`.
"""

from gelforge.config import Mechanics, Study
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import ON, amount, first_order, inverted


def changes(mechanics: Mechanics) -> dict:
    """Return the keys of mechanics that bring the fitted laws."""
    fitted = {"effects": {"material": {"linear_law": False}}}
    return (
        {"strain": "finite", "contact_normals": "current"} | fitted if mechanics.strain == "small" else fitted
    )


def applies(study: Study) -> bool:
    """Whether the base takes the law as linear."""
    return study.mechanics.strain == "small" or study.mechanics.effects.material.linear_law


EFFECT = Effect(
    name="linear_elasticity",
    family="simplification",
    parameters=(
        amount("linear_elasticity", "on", ON, "on or off: a choice of the study, no quantity", sign=1),
    ),
    enters=CATALOGUE["linear_elasticity"].enters,
    signature="nothing at small depth, growing with depth, most at the deepest indentations and near the wall",
    confused_with=("small_strain", "law_exponent", "frame_compliance", "compressibility"),
    separated_by="a material test to the stretches under the ball; the nominal model solved with both constitutive models",
    to_study=inverted(changes),
    to_forces=first_order("linear_elasticity"),
    applies=applies,
    binary=True,
)
