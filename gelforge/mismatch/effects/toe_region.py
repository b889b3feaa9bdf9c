"""A film that gives way and is used up: dust, powder, a rough or uncured surface."""

from collections.abc import Sequence

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mismatch.model.effect import Hyperparameters
from gelforge.mismatch.model.solver_effects import solved


def to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
    """Return the study with a thicker film, that of the pressure."""
    (a,) = theta
    if a == 0:
        return study
    present = study.mechanics.effects.contact.film
    pressure = hyperparameters.get("pressure_MPa", present.pressure_MPa)
    film = {"thickness_mm": present.thickness_mm + float(a), "pressure_MPa": pressure}
    return with_keys(study, contact={"film": film})


def films(study: Study) -> list[Hyperparameters]:
    """Return films half of which is used up soon and late; of a base that has one, that one."""
    film = study.mechanics.effects.contact.film
    # an indentation of a soft gel has 5 to 50 kPa
    pressures = (film.pressure_MPa,) if film.thickness_mm else (1e-2, 3e-3, 3e-2)
    return [{"pressure_MPa": pressure} for pressure in pressures]


EFFECT = solved(
    "toe_region",
    "thickness",
    (0.0, 0.5),
    "width: a dusting of powder, or a cast surface's roughness, of some 0.05 mm (judgement); bounds: ten times it",
    scanned=films,
    means=("a soft film lies on the surface",),
    signature="as if touched later, by a depth that soon stays the same: the more of the force the smaller the depth",
    separated_by="many small depths below 0.3 mm, before and after the surface is cleaned",
    to_study=to_study,
)
