"""How the readings follow friction as a function of pressure: no answers, but what a free form is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mismatch.evidence.places import FirstOrderAt
from gelforge.mismatch.model.effect import Effect, Parameter, Shape

# Of the study's reference pressure: the lowest one makes a power of most pressures, the highest a straight line.
REFERENCES = (0.1, 1.0, 10.0)
WIDTH = 0.2  # of each exponent: together as wide as that of Hertzian asperities, 1/3 (Schallamach 1952)


def shapes(study: Study) -> list[Shape]:
    """Return the reference pressures [MPa] of the factors (1 + p / reference)^-exponent."""
    own = study.mechanics.effects.contact.reference_pressure_MPa
    return [{"reference_pressure_MPa": share * own} for share in REFERENCES]


def with_terms(study: Study, exponents: Mapping[float, float]) -> Study:
    """Return the study with more of some exponents by reference pressure [MPa]."""
    terms = [term.model_dump() for term in study.mechanics.effects.contact.pressure_terms]
    more = [{"reference_pressure_MPa": p, "exponent": float(n)} for p, n in exponents.items() if n]
    return with_keys(study, contact={"pressure_terms": [*terms, *more]})


def _to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    (n,) = amounts
    return with_terms(study, {float(shape["reference_pressure_MPa"]): float(n)}) if n else study


TERM = Effect(
    name="friction_term",
    family="contact",
    parameters=(Parameter("exponent", "1", WIDTH, (-0.99, 0.99), "width: see WIDTH; bounds: the study's"),),
    enters="contact.pressure_terms",
    signature="what a coefficient of friction does that differs where the pressure is another one, and never an answer",
    confused_with=(),
    separated_by="",
    to_study=_to_study,
    to_forces=FirstOrderAt("friction_term", shapes),
    shapes=lambda context: shapes(context.study),
    applies=lambda study: study.mechanics.friction > 0,
)
