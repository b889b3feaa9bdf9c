"""How the readings follow more terms of the strain energy of gel and skin: no answers, but what a free form is made of."""

from __future__ import annotations

from collections.abc import Sequence

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers, skin_layer, with_keys
from gelforge.mismatch.evidence.places import FirstOrderAt
from gelforge.mismatch.model.effect import Effect, Parameter, Shape
from gelforge.mismatch.model.solver_effects import has_none_of

TERMS = ("c2", "c3")
WIDTH = 0.5  # of each: the stress per strain at I1 - 3 = 0.5, a stretch of 1.4, differs by half (judgement)


def shapes(study: Study) -> list[Shape]:
    """Return the terms of the layers under the skin, and of the skin."""
    parts = ["gel", "skin"] if len(study.sensor.layers) > 1 else ["gel"]
    return [{"part": part, "term": term} for part in parts for term in TERMS]


def layers_of(study: Study, part: str) -> list[str]:
    """Return the layers of a part."""
    return gel_layers(study) if part == "gel" else [skin_layer(study)]


def with_terms(study: Study, part: str, terms: dict[str, float]) -> Study:
    """Return the study with more of some terms in a part."""
    present = study.mechanics.effects.material.energy_correction
    names = layers_of(study, part)
    now = {
        name: present[name].model_dump() if name in present else dict.fromkeys(TERMS, 0.0) for name in names
    }
    more = {name: {term: now[name][term] + float(terms.get(term, 0.0)) for term in TERMS} for name in names}
    return with_keys(study, material={"energy_correction": more})


def _to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    (a,) = amounts
    return with_terms(study, str(shape["part"]), {str(shape["term"]): float(a)}) if a else study


TERM = Effect(
    name="energy_term",
    family="material",
    parameters=(Parameter("coefficient", "1", WIDTH, (-5.0, 5.0), "width and bounds: judgement"),),
    enters="material.energy_correction",
    signature="nothing at small strain, growing with it: what another strain energy does, and never an answer by itself",
    confused_with=(),
    separated_by="",
    to_study=_to_study,
    to_forces=FirstOrderAt("energy_term", shapes),
    shapes=lambda context: shapes(context.study),
    applies=lambda study: has_none_of("material.linear_law")(study) and study.mechanics.strain == "finite",
)
