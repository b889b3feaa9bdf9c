"""Gain and cross-talk of the force sensor, each as a smooth function of the place that is loaded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.linalg import block_diag

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.kernels import (
    AXES,
    FreeForm,
    Module,
    near,
    plane_modes,
    several_places,
    sites,
)
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return the map; none of one place. It is never a claim.

    A moved grid, or layers of other thickness, do the same: a gain that depends on the place is none.
    """
    table, force = context.observations.table, context.force
    if not several_places(table):
        return None
    at, rows = sites(table)
    plane = plane_modes(table)
    directions, basis, maps = [], [], []
    for i in range(3):
        for j in range(3):
            scaled = CATALOGUE["force_gain" if i == j else "cross_talk"].parameters[0].width * plane
            change = np.zeros((len(table), 3, plane.shape[1]))
            change[:, i] = force[:, [j]] * scaled
            directions.append(context.observations.flat(change))
            basis.append(scaled[rows])
            maps.append(at.assign(quantity=f"gain {AXES[i]}" if i == j else f"{AXES[i]} of {AXES[j]}"))
    return Module(
        words="what the force sensor reads from place to place",
        directions=np.column_stack(directions),
        name="force_map",
        says="the force sensor's gain and cross-talk depend on where it is loaded",
        map=pd.concat(maps, ignore_index=True),
        basis=block_diag(*basis),
        unit="1",
        of_labels=False,
        where=near,
        named=False,
    )


FREE_FORM = FreeForm("force_map", module)
