"""The gel stiffens or softens with its age."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Effect, Shape, where_it_differs
from gelforge.mismatch.model.solver_effects import amount, solver


def present(study: Study) -> float:
    """Return the rate that the base study has."""
    return study.mechanics.effects.material.circumstances.ageing_per_day.get(gel_layers(study)[0], 0.0)


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces to first order; sessions that do not say their age_days stay as they are."""
    (a,) = amounts
    reference = context.study.mechanics.effects.material.circumstances.reference_age_days
    beyond = np.nan_to_num(context.observations.table["age_days"].to_numpy(float) - reference)
    return force + a * beyond[:, None] * context.derivative("gel_stiffness")


EFFECT = Effect(
    name="ageing",
    family="history",
    parameters=(
        amount(
            "ageing", "rate", (-0.1, 0.1),
            "width: a silicone that goes on curing changes by a per cent a day in its first weeks (judgement);"
            " bounds: ten times that",
        ),
    ),
    signature="all forces of a session in proportion, from session to session with the sensor's age",
    confused_with=("gel_stiffness", "force_gain", "force_drift", "mullins", "temperature", "thickness_gradient"),
    separated_by="the same indentation in every session, at one temperature, with dead weights on the force sensor"
        " beside it",
    depends_on=("gel_stiffness",),
    shapes=where_it_differs("age_days"),
    **solver("ageing", present) | {"to_forces": to_forces},
)  # fmt: skip
