"""The modulus of the body as a smooth function of place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mismatch.evidence.candidates import BOX, LEVELS, WIDTH, box_at
from gelforge.mismatch.evidence.kernels import FreeForm, Module, modes, near, plane_modes, product
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context


def module(context: Context, boxes: Sequence[Candidate]) -> Module | None:
    """Return the map, of linear changes by the modulus of boxes; each box's relative change by itself is WIDTH."""
    if not boxes:
        return None
    at = pd.DataFrame([dict(box.hyperparameters) for box in boxes])
    basis = WIDTH * product(plane_modes(at), modes(at["z_mm"].to_numpy(float), LEVELS))
    return Module(
        words="the body's modulus from place to place",
        directions=np.column_stack([box.columns for box in boxes]) @ basis,
        name="modulus_map",
        says="the body's modulus differs from place to place",
        map=at.assign(quantity="modulus"),
        basis=basis,
        unit="1",
        of_labels=True,
        where=_where,
        form_of=("gel_stiffness", "skin_stiffness", "body_stiffness"),
        to_study=lambda study, change: _with_modulus(study, at, change),
    )


def _where(row: Mapping[str, Any]) -> str:
    return f"{near(row)}, {-row['z_mm']:.3g} mm below the surface"


def _with_modulus(study: Study, at: pd.DataFrame, change: np.ndarray) -> Study:
    """Return the study with the boxes' relative changes (G,) of modulus."""
    geometry = study.mechanics.effects.geometry
    others = [patch.model_dump() for patch in geometry.patches]
    changed = [
        box_at(study, hyperparameters) | {"factor": float(max(1 + a, 0.05))}  # the linear map knows no bound
        for hyperparameters, a in zip(at.to_dict("records"), change)
    ]
    return with_keys(unmirrored(study), geometry={"patches": [*others, *changed]})


FREE_FORM = FreeForm("modulus_map", module, derivatives=(BOX,))
