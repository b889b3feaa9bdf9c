"""Contact is taken as frictionless where it is not, or the other way round.

Turned round: a base with friction loses it; one without gets the coefficient that studies have by default.
"""

from gelforge.config import Mechanics
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.mismatch.effect import Effect
from gelforge.mismatch.solver_effects import ON, amount, first_order, turned_round


def changes(mechanics: Mechanics) -> dict:
    """Return the keys of mechanics that turn it round."""
    return {"friction": 0.0 if mechanics.friction else Mechanics.model_fields["friction"].default}


EFFECT = Effect(
    name="frictionless",
    family="simplification",
    parameters=(amount("frictionless", "on", ON, "on or off: a choice of the study, no quantity", sign=1),),
    enters=CATALOGUE["frictionless"].enters,
    signature="lateral force off the middle changes most; force a little at depth",
    confused_with=("friction", "friction_law", "law_exponent"),
    separated_by="a press that shears the surface once it touches, or a lubricated ball",
    to_study=turned_round(changes),
    to_forces=first_order("frictionless"),
    switch=True,
)
