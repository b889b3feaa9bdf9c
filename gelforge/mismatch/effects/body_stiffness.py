"""All layers, skin and wall with them, are stiffer or softer than their laws by one share.

Under a given displacement that scales every force and moves no particle: exactly what a gain of the force sensor does.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.mismatch.effects import gel_stiffness
from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters

PARTS = ("gel_stiffness", "skin_stiffness")


def to_study(study: Study, _: Hyperparameters, theta: Sequence[float]) -> Study:
    """Return the study with all moduli grown by the same share."""
    (a,) = theta
    for part in PARTS if a else ():
        study = CATALOGUE[part](study, float(a))
    return study


def to_forces(context: Context, _: Hyperparameters, force: np.ndarray, theta: Sequence[float]) -> np.ndarray:
    """Return the forces with all layers grown, to first order."""
    (a,) = theta
    return force + a * sum(context.derivative(part) for part in PARTS)


EFFECT = Effect(
    name="body_stiffness",
    family="material",
    parameters=(
        replace(
            gel_stiffness.EFFECT.parameters[0],
            source="width: scatter of silicones that were mixed and cured together (judgement); bounds: still a gel",
        ),
    ),
    means=(
        "all layers differ in stiffness",
        "all layers are {share} stiffer than simulated",
        "all layers are {share} softer than simulated",
    ),
    signature="every force in proportion, the same at every place and depth; no particle moves otherwise",
    separated_by="dead weights on the force sensor; a material test of the batch; no image does",
    depends_on=PARTS,
    to_study=to_study,
    to_forces=to_forces,
    applies=lambda study: len(study.sensor.layers) > 1,
)
