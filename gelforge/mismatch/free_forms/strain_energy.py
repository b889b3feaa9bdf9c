"""The strain energy of the gel, and of the skin, in another form than the constitutive model's: more terms of I1 - 3."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers, skin_layer, with_keys
from gelforge.mismatch.evidence.kernels import FreeForm, Module
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters, Parameter
from gelforge.mismatch.model.places import FirstOrder
from gelforge.mismatch.model.solver_effects import has_none_of

TERMS = ("c2", "c3")
WIDTH = 0.5  # of each: the stress per strain at I1 - 3 = 0.5, a stretch of 1.4, differs by half (judgement)


def grid(study: Study) -> list[Hyperparameters]:
    """Return the terms of the layers under the skin, and of the skin."""
    parts = ["gel", "skin"] if len(study.sensor.layers) > 1 else ["gel"]
    return [{"part": part, "term": term} for part in parts for term in TERMS]


def with_terms(study: Study, part: str, terms: dict[str, float]) -> Study:
    """Return the study with more of some terms in a part."""
    present = study.mechanics.effects.material.energy_correction
    names = gel_layers(study) if part == "gel" else [skin_layer(study)]
    now = {
        name: present[name].model_dump() if name in present else dict.fromkeys(TERMS, 0.0) for name in names
    }
    more = {name: {term: now[name][term] + float(terms.get(term, 0.0)) for term in TERMS} for name in names}
    return with_keys(study, material={"energy_correction": more})


def _to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
    (a,) = theta
    return (
        with_terms(study, str(hyperparameters["part"]), {str(hyperparameters["term"]): float(a)})
        if a
        else study
    )


TERM = Effect(
    name="energy_term",
    family="material",
    parameters=(Parameter("coefficient", "1", WIDTH, (-5.0, 5.0), "width and bounds: judgement"),),
    to_study=_to_study,
    to_forces=FirstOrder("energy_term", scanned=grid),
    grid=lambda context: grid(context.study),
    applies=lambda study: has_none_of("material.linear_law")(study) and study.mechanics.strain == "finite",
)


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return the change of dW/dI1 over that of the undeformed state, by part; changes: by each term."""
    parts = list(dict.fromkeys(str(one.hyperparameters["part"]) for one in changes))
    by_term = {
        (str(one.hyperparameters["part"]), str(one.hyperparameters["term"])): one.columns[:, 0]
        for one in changes
    }
    if not parts or len(by_term) < len(parts) * len(TERMS):
        return None
    keys = [(part, term) for part in parts for term in TERMS]
    at = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8)  # I1 - 3 of the map: stretches of 1.1 to 1.5
    maps, basis = [], []
    for part in parts:
        maps.append(pd.DataFrame({"quantity": f"{part}'s dW/dI1", "I1_less_3": at}))
        basis.append([[_slope(x, term) if of_term == part else 0.0 for of_term, term in keys] for x in at])
    basis_of_terms = np.concatenate([np.array(rows) for rows in basis])
    return Module(
        words="the strain energy at larger strain",
        directions=WIDTH * np.column_stack([by_term[key] for key in keys]),
        name="strain_energy",
        says="the layers stiffen differently at large strain than their constitutive models",
        map=pd.concat(maps, ignore_index=True),
        basis=WIDTH * basis_of_terms,
        unit="1",
        of_labels=True,
        where=lambda row: f"at I1 - 3 = {row['I1_less_3']:g}",
        form_of=("law_exponent", "linear_elasticity"),
        to_study=lambda study, map_: _with_energy(study, parts, keys, basis_of_terms, map_),
    )


def _slope(x: float, term: str) -> float:
    """Return the change of dW/dI1 at I1 - 3 = x per unit of a term, over mu/2."""
    return 2 * x if term == "c2" else 3 * x**2


def _with_energy(
    study: Study, parts: Sequence[str], keys: Sequence[tuple[str, str]], basis: np.ndarray, map_: np.ndarray
) -> Study:
    """Return the study with the terms that make a map (G,)."""
    terms, *_ = np.linalg.lstsq(basis, map_, rcond=None)  # exact: the map is made of them
    for part in parts:
        study = with_terms(
            study, part, {term: a for (of_term, term), a in zip(keys, terms) if of_term == part}
        )
    return study


FREE_FORM = FreeForm("strain_energy", module, derivatives=(TERM,))
