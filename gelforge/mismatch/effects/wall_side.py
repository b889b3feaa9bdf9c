"""The wall is broken along one side of the sensor, or the gel has let go of it there."""

from collections.abc import Sequence
from typing import get_args

import numpy as np

from gelforge.config import Study
from gelforge.config.parts.effects import Side
from gelforge.indentation.effects.catalogue import with_wall_side
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mismatch.model.effect import Hyperparameters
from gelforge.mismatch.model.solver_effects import has_wall, solved

GRID: list[Hyperparameters] = [
    {"part": part, "side": side} for part in ("wall", "bond") for side in get_args(Side)
]


def to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
    """Return the study with a lost share of the wall, or of the bond to it, along one side."""
    (a,) = theta
    if a == 0:
        return study
    hyperparameters = hyperparameters or GRID[0]
    lost = {f"{hyperparameters['part']}_loss": float(np.clip(a, 0.0, 1.0))}
    return with_wall_side(unmirrored(study), str(hyperparameters["side"]), **lost)


EFFECT = solved(
    "wall_side",
    "lost_share",
    (0.0, 1.0),
    "width and bounds: none to all of the stiffness of the wall along a side, or of the bond to it",
    closed=True,
    scanned=lambda study: GRID,
    means=("the wall is broken, or the gel has come off it, on one side",),
    signature="softer near one wall only, with a lateral force of its own; the other three sides clean",
    separated_by="indentations close to all four walls; a look from the side",
    applies=has_wall,
    turned=lambda turn: np.eye(1),  # its side turns, not its value: no site stands for its images
    to_study=to_study,
)
