"""Effects as linear changes of what was read, and the map of the body: where in it the modulus would have to change.

For the map the layers are divided into boxes, as wide as located effects lie apart and three levels deep; by the derivatives
along the modulus of each, all are fitted to the readings of force at once, before any effect is named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pandas as pd

from gelforge.config import ConfigError, Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters, Parameter
from gelforge.mismatch.model.places import SPACING, FirstOrder, lines

UNIT = 1e-3  # of a width: a step at which every first-order change is a straight line
LEVELS = 3  # at least: the thickest part of the layers is halved until there are as many
WIDTH = 0.3  # standard deviation of a box's relative change of modulus before anything is known


def effects_of_forces(study: Study) -> dict[str, Effect]:
    """Return the effects that forces can show on a study's sensor, but for those that it leaves out.

    Raises ConfigError where it leaves out what there is not.
    """
    left_out = set(study.mismatch.leave_out)
    unknown = left_out - set(CATALOGUE)
    if unknown:
        raise ConfigError(
            f"mismatch.leave_out: no effect {sorted(unknown)}; the catalogue has {sorted(CATALOGUE)}"
        )
    tried = {name: effect for name, effect in CATALOGUE.items() if name not in left_out}
    return {name: e for name, e in tried.items() if e.to_forces is not None and e.applies(study)}


def candidates_of(context: Context, effects: Mapping[str, Effect], failed: dict[str, str]) -> list[Candidate]:
    """Return every effect at every point of its grid as a linear change of what was read; failures go to failed."""
    candidates = []
    for name, effect in effects.items():
        for hyperparameters in effect.grid(context):
            try:
                columns = columns_of(context, effect, hyperparameters)
            except KeyError as missing:  # its derivative could not be had
                why = failed.setdefault(str(missing.args[0]), "no derivative of this sensor's nominal model")
                failed.setdefault(name, why)
                continue
            if not np.any(columns):
                continue
            candidates.append(
                Candidate(name, hyperparameters, columns, effect.prior_sd, effect.signs, effect.binary)
            )
    return candidates


def columns_of(context: Context, effect: Effect, hyperparameters: Mapping) -> np.ndarray:
    """Return the change of what was read per unit of each parameter of an effect.

    Parameters
    ----------
    context : Context
        Base forces at the readings.
    effect : Effect
        With P parameters.
    hyperparameters : mapping
        Hyperparameters by name.

    Returns
    -------
    numpy.ndarray
        (n, P) [N per unit].

    Raises
    ------
    ValueError
        For an effect that changes no forces.
    """
    if effect.to_forces is None:
        raise ValueError(f"{effect.name} changes no forces; it has no columns among them")
    columns = []
    for k in range(len(effect.parameters)):
        step = effect.unit_step(k, UNIT)
        change = effect.to_forces(context, hyperparameters, context.force, step) - context.force
        columns.append(context.observations.flat(change) / step[k])
    return np.column_stack(columns)


def boxes(study: Study) -> list[Hyperparameters]:
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


def box_at(study: Study, hyperparameters: Hyperparameters) -> dict[str, list[float]]:
    """Return the lowest and highest point [mm] of the box with a middle; those at the rim reach beyond it."""
    low: list[float] = []
    high: list[float] = []
    for axis, middles in zip(("x_mm", "y_mm"), lines(study)):
        beyond = middles[-1] + SPACING + study.sensor.wall_mm
        between = [-SPACING, *((a + b) / 2 for a, b in pairwise(middles)), beyond]
        k = middles.index(float(hyperparameters[axis]))
        low, high = [*low, between[k]], [*high, between[k + 1]]
    level = next((a, b) for a, b in pairwise(_faces(study)) if a < float(hyperparameters["z_mm"]) < b)
    return {"low_mm": [*low, level[0]], "high_mm": [*high, level[1]]}


def _to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
    (a,) = theta
    others = [patch.model_dump() for patch in study.mechanics.effects.geometry.patches]
    here = box_at(study, hyperparameters) | {"factor": 1 + a}
    return with_keys(study, geometry={"patches": [*others, here]}) if a else study


BOX = Effect(
    name="box_modulus",
    family="material",
    parameters=(Parameter("growth", "1", WIDTH, (-1.0, np.inf), "width and bounds: judgement"),),
    to_study=_to_study,
    to_forces=FirstOrder("box_modulus", scanned=boxes),
    grid=lambda context: boxes(context.study),
)


def body_map(problem: Problem) -> pd.DataFrame | None:
    """Return the rows of body_map.csv: relative changes of the boxes' modulus that fit the residual best, and their sigma.

    Of the readings of force; each box has the prior N(0, WIDTH^2). None where nothing is known of any.
    """
    if not problem.boxes:
        return None
    J = problem.covariance.whiten(np.column_stack([box.columns for box in problem.boxes])) * WIDTH
    S = np.linalg.inv(np.eye(J.shape[1]) + J.T @ J)
    change = WIDTH * (S @ (J.T @ problem.covariance.whiten(problem.residual)))
    sigma = WIDTH * np.sqrt(np.diag(S))
    places = pd.DataFrame([dict(box.hyperparameters) for box in problem.boxes])
    return places.assign(change=change, sigma=sigma)
