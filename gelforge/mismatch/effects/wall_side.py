"""The wall is broken along one side of the sensor, or the gel has let go of it there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from gelforge.config import Study
from gelforge.config.parts.effects import Side
from gelforge.indentation.effects.catalogue import with_wall_side
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mismatch.evidence.places import FirstOrderAt
from gelforge.mismatch.model.effect import Effect, Shape
from gelforge.mismatch.model.solver_effects import amount, solver

SHAPES: list[Shape] = [{"part": part, "side": side} for part in ("wall", "bond") for side in get_args(Side)]


def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
    """Return the study with a lost share of the wall, or of the bond to it, along one side."""
    (a,) = amounts
    if a == 0:
        return study
    shape = shape or SHAPES[0]
    lost = {f"{shape['part']}_loss": float(np.clip(a, 0.0, 1.0))}
    return with_wall_side(unmirrored(study), str(shape["side"]), **lost)


def with_its_side(turn: np.ndarray) -> np.ndarray:
    """Return how the value turns with the sensor: not at all, its side does, so that no site stands for its images."""
    return np.eye(1)


EFFECT = Effect(
    name="wall_side",
    family="geometry",
    parameters=(
        amount(
            "wall_side", "lost_share", (0.0, 1.0),
            "width and bounds: none to all of the stiffness of the wall along a side, or of the bond to it", sign=1,
            whole=True,
        ),
    ),
    signature="softer near one wall only, with a lateral force of its own; the other three sides clean",
    confused_with=("misregistration", "thickness_gradient", "wall_gap", "lateral_play"),
    separated_by="indentations close to all four walls; a look from the side",
    applies=lambda study: study.sensor.wall_mm > 0 and study.sensor.shape.kind == "block",
    shapes=lambda context: SHAPES,
    turned=with_its_side,
    **solver("wall_side") | {"to_study": to_study, "to_forces": FirstOrderAt("wall_side", lambda study: SHAPES)},
)  # fmt: skip
