"""A film that gives way and is used up: dust, powder, a rough or uncured surface."""

from __future__ import annotations

from collections.abc import Sequence

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mismatch.evidence import places
from gelforge.mismatch.model.effect import Effect, Shape
from gelforge.mismatch.model.solver_effects import amount, solver

PRESSURES_MPA = (
    1e-2,
    3e-3,
    3e-2,
)  # at which half of it is used up: an indentation of a soft gel has 5 to 50 kPa


def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    (a,) = amounts
    if a == 0:
        return study
    present = study.mechanics.effects.contact.film
    pressure = shape.get("pressure_MPa", present.pressure_MPa)
    film = {"thickness_mm": present.thickness_mm + float(a), "pressure_MPa": pressure}
    return with_keys(study, contact={"film": film})


def shapes(study: Study) -> list[Shape]:
    """Return films that are used up soon and late; of a base that has one, that one."""
    film = study.mechanics.effects.contact.film
    pressures = (film.pressure_MPa,) if film.thickness_mm else PRESSURES_MPA
    return [{"pressure_MPa": pressure} for pressure in pressures]


EFFECT = Effect(
    name="toe_region",
    family="contact",
    parameters=(
        amount(
            "toe_region", "thickness", (0.0, 0.5),
            "width: a dusting of powder, or a cast surface's roughness, of some 0.05 mm (judgement); bounds: ten times it",
            sign=1,
        ),
    ),
    signature="as if touched later, by a depth that soon stays the same: the more of the force the smaller the depth",
    confused_with=("contact_zero", "skin_stiffness"),
    separated_by="many small depths below 0.3 mm, before and after the surface is cleaned",
    shapes=lambda context: shapes(context.study),
    **solver("toe_region")
    | {"to_study": to_study, "to_forces": places.FirstOrderAt("toe_region", shapes)},
)  # fmt: skip
