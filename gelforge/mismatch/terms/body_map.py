"""Where in the body the modulus would have to change to explain the readings, before any effect is named.

The layers are divided into boxes, as wide as located effects lie apart and three levels deep; by the derivatives along
the modulus of each, all are fitted to the readings of force at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mismatch.model.effect import Effect, Parameter, Shape
from gelforge.mismatch.model.places import SPACING, FirstOrder, lines
from gelforge.mismatch.terms.problem import Problem

LEVELS = 3  # at least: the thickest part of the layers is halved until there are as many
WIDTH = 0.3  # standard deviation of a box's relative change of modulus before anything is known


def boxes(study: Study) -> list[Shape]:
    """Return the middles (x_mm, y_mm, z_mm) of the boxes."""
    x, y = lines(study)
    z = [(low + high) / 2 for low, high in pairwise(_faces(study))]
    return [{"x_mm": a, "y_mm": b, "z_mm": c} for c in z for b in y for a in x]


def _faces(study: Study) -> list[float]:
    """Return the heights [mm] of the faces between levels, lowest first: those of the layers, and between the thickest."""
    faces = list(np.cumsum([-study.sensor.height_mm, *(layer.thickness_mm for layer in study.sensor.layers)]))
    while len(faces) <= LEVELS:
        k = int(np.argmax(np.diff(faces)))
        faces.insert(k + 1, (faces[k] + faces[k + 1]) / 2)
    return [float(z) for z in faces]


def box_at(study: Study, shape: Shape) -> dict[str, list[float]]:
    """Return the lowest and highest point [mm] of the box with a middle; those at the rim reach beyond it."""
    low: list[float] = []
    high: list[float] = []
    for axis, middles in zip(("x_mm", "y_mm"), lines(study)):
        beyond = middles[-1] + SPACING + study.sensor.wall_mm
        between = [-SPACING, *((a + b) / 2 for a, b in pairwise(middles)), beyond]
        k = middles.index(float(shape[axis]))
        low, high = [*low, between[k]], [*high, between[k + 1]]
    level = next((a, b) for a, b in pairwise(_faces(study)) if a < float(shape["z_mm"]) < b)
    return {"low_mm": [*low, level[0]], "high_mm": [*high, level[1]]}


def _to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    (a,) = amounts
    others = [patch.model_dump() for patch in study.mechanics.effects.geometry.patches]
    here = box_at(study, shape) | {"factor": 1 + a}
    return with_keys(study, geometry={"patches": [*others, here]}) if a else study


BOX = Effect(
    name="box_modulus",
    family="material",
    parameters=(Parameter("growth", "1", WIDTH, (-1.0, np.inf), "width and bounds: judgement"),),
    to_study=_to_study,
    to_forces=FirstOrder("box_modulus", scanned=boxes),
    shapes=lambda context: boxes(context.study),
)


def body_map(problem: Problem) -> pd.DataFrame | None:
    """Return the rows of body_map.csv: relative changes of the boxes' modulus that fit the residual best, and their sigma.

    Of the readings of force; each box has the prior N(0, WIDTH^2). None where nothing is known of any.
    """
    if not problem.boxes:
        return None
    J = problem.covariance.whiten(np.column_stack([box.columns for box in problem.boxes])) * WIDTH
    S = np.linalg.inv(np.eye(J.shape[1]) + J.T @ J)
    change, sigma = (
        WIDTH * (S @ (J.T @ problem.covariance.whiten(problem.residual))),
        WIDTH * np.sqrt(np.diag(S)),
    )
    return pd.DataFrame([dict(box.shape) for box in problem.boxes]).assign(change=change, sigma=sigma)
