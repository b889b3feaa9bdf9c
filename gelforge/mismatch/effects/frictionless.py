"""Contact is taken as frictionless where it is not, or the other way round.

A base with friction loses it; one without gets a coefficient, of which a few are tried.
"""

from gelforge.config import Mechanics, Study
from gelforge.mismatch.model.effect import Hyperparameters
from gelforge.mismatch.model.places import FirstOrder
from gelforge.mismatch.model.solver_effects import simplification

# Silicone on steel or plastic runs from 0.2, dusted, to above 1, clean; what studies have by default is between.
COEFFICIENTS = (0.2, Mechanics.model_fields["friction"].default, 1.0)


def coefficients(study: Study) -> list[Hyperparameters]:
    """Return what friction is turned into: none, or one of a few coefficients where the study has none."""
    return [{"coefficient": c} for c in ((0.0,) if study.mechanics.friction else COEFFICIENTS)]


EFFECT = simplification(
    "frictionless",
    lambda mechanics, hyperparameters: {
        "friction": float(hyperparameters.get("coefficient", 0.0 if mechanics.friction else COEFFICIENTS[1]))
    },
    means=("friction is there or absent, unlike in the simulation",),
    signature="lateral force off the middle changes most; force a little at depth",
    separated_by="an indentation that shears the surface once it touches, or a lubricated ball",
    grid=lambda context: coefficients(context.study),
    to_forces=FirstOrder("frictionless", scanned=coefficients),
)
