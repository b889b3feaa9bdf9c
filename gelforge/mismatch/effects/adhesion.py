"""Surfaces that have touched hold together: the indenter is pulled on its way up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.context import Context
from gelforge.mismatch.effect import Effect, Shape
from gelforge.mismatch.solver_effects import amount, has, solver


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces to first order: on the way up 2 pi R w pulls the sensor up, while there is contact (R, 3) [N].

    The traction over the ring beside a ball, whose area grows by 2 pi R with the gap, whatever its law (Derjaguin 1934). A
    derivative by the solver is none: on elements larger than the ring it jumps from 0 to several times this.
    """
    (w,) = amounts
    table = context.observations.table
    up = (table["phase"] == "unload") & (table["depth_mm"] > 0)
    pull = sum(2 * np.pi * part.radius_mm for part in context.study.indenter.shapes)
    return force + w * pull * np.outer(up, [0.0, 0.0, 1.0])


EFFECT = Effect(
    name="adhesion",
    family="contact",
    parameters=(
        amount(
            "adhesion", "work", (0.0, 2e-3),
            "width: 0.1 J/m2, twice silicone's surface energy of 0.02 J/m2 with some dissipation; bounds: 2 J/m2, a sticky"
            " gel torn off fast (judgement)", sign=1,
        ),
    ),
    signature="less force on the way up, down to a pull before the indenter lets go; loading clean within millinewtons",
    confused_with=("force_hysteresis", "viscoelastic", "mullins"),
    separated_by="slow unloading with readings up to where the indenter lets go; a dusted surface",
    form_error=0.4,  # of the pull of Johnson, Kendall and Roberts, which grows with the contact
    applies=lambda study: all(part.kind == "sphere" for part in study.indenter.shapes),
    **solver("adhesion", has("contact.adhesion.work_N_per_mm")) | {"to_forces": to_forces},
)  # fmt: skip
