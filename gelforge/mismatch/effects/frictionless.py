"""Contact is taken as frictionless where it is not, or the other way round.

Turned round: a base with friction loses it; one without gets a coefficient, of which a few are tried.
"""

from collections.abc import Sequence

from gelforge.config import Mechanics, Study
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.mismatch.evidence.places import FirstOrderAt
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Effect, Shape
from gelforge.mismatch.model.solver_effects import ON, amount, inverted

# Silicone on steel or plastic runs from 0.2, dusted, to above 1, clean; what studies have by default is between.
COEFFICIENTS = (0.2, Mechanics.model_fields["friction"].default, 1.0)


def coefficients(study: Study) -> list[Shape]:
    """Return what friction is turned into: none, or one of a few coefficients where the study has none."""
    return [{"coefficient": c} for c in ((0.0,) if study.mechanics.friction else COEFFICIENTS)]


def shapes(context: Context) -> list[Shape]:
    """Return the coefficients that are tried."""
    return coefficients(context.study)


def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    """Return the study with another coefficient of friction; without a shape it is none, or the default one."""
    other = 0.0 if study.mechanics.friction else COEFFICIENTS[1]
    return inverted(lambda _: {"friction": float(shape.get("coefficient", other))})(study, shape, amounts)


EFFECT = Effect(
    name="frictionless",
    family="simplification",
    parameters=(amount("frictionless", "on", ON, "on or off: a choice of the study, no quantity", sign=1),),
    enters=CATALOGUE["frictionless"].enters,
    signature="lateral force off the middle changes most; force a little at depth",
    confused_with=("friction", "friction_law", "law_exponent"),
    separated_by="an indentation that shears the surface once it touches, or a lubricated ball",
    shapes=shapes,
    to_study=to_study,
    to_forces=FirstOrderAt("frictionless", coefficients),
    binary=True,
)
