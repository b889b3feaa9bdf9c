"""The coefficient of friction is another one than the study's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gelforge.config import Study
from gelforge.mismatch.effect import Effect, Parameter, Shape
from gelforge.mismatch.solver_effects import amount, solver

FIELDS = solver("friction")
EXCESS = amount(
    "friction", "excess", (-1.0, 1.5),
    "width: coefficients of silicone on steel or plastic, dusted or clean, run from 0.2 to above 1 (judgement); bounds:"
    " mechanics.friction itself lies within 0 and 2",
)  # fmt: skip


def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    """Return the study with a larger coefficient, or a smaller one down to none."""
    (a,) = amounts
    return FIELDS["to_study"](study, shape, [max(float(a), -study.mechanics.friction)])


def allowed(study: Study) -> tuple[Parameter, ...]:
    """Return the coefficient's excess: of a frictionless base it is above 0."""
    return (EXCESS,) if study.mechanics.friction > 0 else (replace(EXCESS, bounds=(0.0, 1.5), sign=1),)


EFFECT = Effect(
    name="friction",
    family="contact",
    parameters=(EXCESS,),
    signature="lateral force off the middle; a little more force at depth; saturates where everything sticks",
    confused_with=("frictionless", "friction_law", "law_exponent", "misregistration"),
    separated_by="a press that shears the surface once it touches, or a lubricated ball",
    allowed=allowed,
    **FIELDS | {"to_study": to_study},
)  # fmt: skip
