"""The law is linear where it is not, or the other way round: neo-Hookean moduli against the fitted law.

Turned round: a base with fitted laws gets neo-Hookean ones of the same moduli, one with these the fitted laws. A base of
small strain is linear in both senses: it gets the fitted laws, at finite strain, without which they have no meaning.
"""

from gelforge.config import Mechanics
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.mismatch.effect import Effect
from gelforge.mismatch.solver_effects import ON, amount, first_order, turned_round


def changes(mechanics: Mechanics) -> dict:
    """Return the keys of mechanics that turn it round."""
    if mechanics.strain == "small":
        linear = {"effects": {"material": {"linear_law": False}}}
        return {"strain": "finite", "contact_normals": "current"} | linear
    return {"effects": {"material": {"linear_law": not mechanics.effects.material.linear_law}}}


EFFECT = Effect(
    name="linear_elasticity",
    family="simplification",
    parameters=(
        amount("linear_elasticity", "on", ON, "on or off: a choice of the study, no quantity", sign=1),
    ),
    enters=CATALOGUE["linear_elasticity"].enters,
    signature="nothing at small depth, growing with depth, most at the deepest presses and near the wall",
    confused_with=("small_strain", "law_exponent", "frame_compliance", "compressibility"),
    separated_by="a material test to the stretches under the ball; the base solved with both laws",
    to_study=turned_round(changes),
    to_forces=first_order("linear_elasticity"),
    switch=True,
)
