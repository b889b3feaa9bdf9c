"""Something hard in the gel: a lump of particles, a chip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.indentation.effects.fields import LOST, RIGID
from gelforge.mismatch import places
from gelforge.mismatch.context import Context
from gelforge.mismatch.effect import Effect, Shape
from gelforge.mismatch.effects import void
from gelforge.mismatch.solver_effects import amount, solver


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces to first order (R, 3) [N]: what stiffness that is lost takes away, stiffness that is gained adds."""
    return void.EFFECT.to_forces(context, shape, force, [RIGID / LOST * a for a in amounts])


EFFECT = Effect(
    name="inclusion",
    family="geometry",
    parameters=(
        amount(
            "inclusion", "rigidity", (0.0, 1.02),
            "width and bounds: none to all of what a rigid ball does to all around it, 0.86 of which one 16 times as stiff"
            " does; an amount above 1 is all of it", sign=1,
        ),
    ),
    signature="harder over a few millimetres, more at depth",
    confused_with=("void", "contact_zero", "thickness_gradient"),
    separated_by="presses 2 mm apart around the place; images, in which the lump itself is seen",
    takes=("void",),
    shapes=lambda context: places.balls(context.study),
    **solver("inclusion", limit=(0.0, 1.0), directed=True) | {"to_forces": to_forces},
)  # fmt: skip
