"""Surfaces that have touched hold together: the indenter is pulled during unloading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Effect, Shape
from gelforge.mismatch.model.solver_effects import amount, has, solver

GROWTH = 1.5  # d area / d depth, in pi times the radius


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces with adhesion: during unloading w dA/dd pulls the sensor up, while there is contact (R, 3) [N].

    To first order in the work w, at a held depth d, whatever the law: the energy of the surfaces that stick. The contact
    area A grows by pi R d on a half space and by 2 pi R d on a layer that is thin beside it; between them 1.5 is taken.
    """
    (w,) = amounts
    table = context.observations.table
    up = (table["phase"] == "unload") & (table["depth_mm"] > 0)
    pull = sum(GROWTH * np.pi * part.radius_mm for part in context.study.indenter.shapes)
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
    signature="less force during unloading, down to a pull before the indenter lets go; loading clean within millinewtons",
    confused_with=("force_hysteresis", "viscoelastic", "mullins"),
    separated_by="slow unloading with readings up to where the indenter lets go; a dusted surface",
    applies=lambda study: all(part.kind == "sphere" for part in study.indenter.shapes),
    **solver("adhesion", has("contact.adhesion.work_N_per_mm")) | {"to_forces": to_forces, "by_formula": True},
)  # fmt: skip
