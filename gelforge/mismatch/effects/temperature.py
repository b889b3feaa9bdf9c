"""The gel stiffens or softens with temperature."""

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
    return study.mechanics.effects.material.circumstances.stiffening_per_K.get(gel_layers(study)[0], 0.0)


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces to first order; sessions that do not say their temperature_C stay as they are."""
    (a,) = amounts
    reference = context.study.mechanics.effects.material.circumstances.reference_temperature_C
    beyond = np.nan_to_num(context.observations.table["temperature_C"].to_numpy(float) - reference)
    return force + a * beyond[:, None] * context.derivative("gel_stiffness")


EFFECT = Effect(
    name="temperature",
    family="history",
    parameters=(
        amount(
            "temperature", "rate", (-0.1, 0.1),
            "width: rubber elasticity gives 1/296 per kelvin (entropy), crosslinks that relax more (judgement);"
            " bounds: ten times it",
        ),
    ),
    signature="all forces of a session in proportion, from session to session with the room's temperature",
    confused_with=("gel_stiffness", "force_gain", "force_drift", "ageing"),
    separated_by="the same presses on one day at two temperatures ten kelvin apart",
    depends_on=("gel_stiffness",),
    shapes=where_it_differs("temperature_C"),
    **solver("temperature", present) | {"to_forces": to_forces},
)  # fmt: skip
