"""The strain energy of the gel, and of the skin, in another form than the constitutive model's: more terms of I1 - 3."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.terms.energy_terms import TERM, TERMS, WIDTH, with_terms
from gelforge.mismatch.terms.module import FreeForm, Module

AT = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8)  # I1 - 3 of the map: stretches of 1.1 to 1.5


def modules(context: Context, changes: Sequence[Candidate]) -> list[Module]:
    """Return the change of dW/dI1 over that of the undeformed state, by part; changes: by each term."""
    parts = list(dict.fromkeys(str(one.shape["part"]) for one in changes))
    by_term = {(str(one.shape["part"]), str(one.shape["term"])): one.columns[:, 0] for one in changes}
    if not parts or len(by_term) < len(parts) * len(TERMS):
        return []
    keys = [(part, term) for part in parts for term in TERMS]
    maps, basis = [], []
    for part in parts:
        maps.append(pd.DataFrame({"quantity": f"{part}'s dW/dI1", "I1_less_3": AT}))
        basis.append([[_slope(x, term) if own == part else 0.0 for own, term in keys] for x in AT])
    basis_of_terms = np.concatenate([np.array(rows) for rows in basis])
    return [
        Module(
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
    ]


def _slope(x: float, term: str) -> float:
    """Return the change of dW/dI1 at I1 - 3 = x per unit of a term, over mu/2."""
    return 2 * x if term == "c2" else 3 * x**2


def _with_energy(
    study: Study, parts: Sequence[str], keys: Sequence[tuple[str, str]], basis: np.ndarray, map_: np.ndarray
) -> Study:
    """Return the study with the terms that make a map (G,)."""
    terms, *_ = np.linalg.lstsq(basis, map_, rcond=None)  # exact: the map is made of them
    for part in parts:
        study = with_terms(study, part, {term: a for (own, term), a in zip(keys, terms) if own == part})
    return study


FREE_FORM = FreeForm("strain_energy", modules, derivatives=(TERM,))
