"""The force sensor's gain over each session's time: a part that all axes share, and their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.linalg import block_diag

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.kernels import AXES, MODES, FreeForm, Module, modes_by_group
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context

OWN = 0.5  # of what all axes' gains share, by which each departs from it: wiring and amplifier are common (judgement)


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return the gain by axis and press; none where each session has one press."""
    table = context.observations.table
    if not any(len(rows["order"].unique()) > 1 for _, rows in table.groupby("session")):
        return None
    width = CATALOGUE["force_gain"].parameters[0].width
    time = width * modes_by_group(table["session"].to_numpy(), table["order"].to_numpy(float), MODES["time"])
    presses = table.drop_duplicates("press")
    flat, shared = context.observations.flat, context.force[:, :, None] * time[:, None, :]
    by_axis = [flat(shared * OWN * (np.arange(3) == k)[None, :, None]) for k in range(3)]
    at = presses[["session", "order", "time_s"]].reset_index(drop=True)
    basis = time[presses.index]
    return Module(
        words="the force sensor's gain over the session's time",
        directions=np.column_stack([flat(shared), *by_axis]),
        name="gain_in_time",
        says="the force sensor's gain, or the stiffness of all layers (forces alone do not distinguish them), changes"
        " over the session",
        map=pd.concat([at.assign(quantity=f"gain {axis}") for axis in AXES], ignore_index=True),
        basis=np.column_stack([np.tile(basis, (3, 1)), OWN * block_diag(*[basis] * 3)]),
        unit="1",
        of_labels=False,
        where=lambda row: f"{row['time_s']:.4g} s into {row['session']}",
        form_of=("force_gain",),
        replaces="all forces in proportion over the session's time",
    )


FREE_FORM = FreeForm("gain_in_time", module)
