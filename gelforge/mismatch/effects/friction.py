"""The coefficient of friction is another one than the study's."""

from __future__ import annotations

from collections.abc import Sequence

from gelforge.config import Study
from gelforge.mismatch.model.effect import Effect, Shape
from gelforge.mismatch.model.solver_effects import amount, solver

FIELDS = solver("friction")


def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    """Return the study with a larger coefficient, or a smaller one down to none."""
    (a,) = amounts
    return FIELDS["to_study"](study, shape, [max(float(a), -study.mechanics.friction)])


EFFECT = Effect(
    name="friction",
    family="contact",
    parameters=(
        amount(
            "friction", "excess", (-1.0, 1.5),
            "width: coefficients of silicone on steel or plastic, dusted or clean, run from 0.2 to above 1 (judgement);"
            " bounds: mechanics.friction itself lies within 0 and 2",
        ),
    ),
    signature="lateral force off the middle; a little more force at depth; saturates where everything sticks",
    confused_with=("frictionless", "friction_law", "law_exponent", "misregistration"),
    separated_by="an indentation that shears the surface once it touches, or a lubricated ball",
    applies=lambda study: study.mechanics.friction > 0,  # a base without any: frictionless
    **FIELDS | {"to_study": to_study},
)  # fmt: skip
