"""The stress that the gel has lost, as a smooth function of the largest energy so far and of the energy now."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.mullins import WIDER, Energies, histories
from gelforge.mismatch.evidence.kernels import FreeForm, Module
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context

OF_PEAK = (0.0, 0.5, 1.0)  # powers of the largest energy over the largest of all
# Powers of the share of it that is gone: an early loss, and one at the end of a return
OF_RETURN = (0.25, 1.0, 2.0)
REACHES = (0.3, 1.0, 3.0)  # of how far an indentation's energy reaches beyond its contact (WIDER)


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return the lost share; none where nothing that remembers could show, or where the gel's stiffness was not solved."""
    effect = CATALOGUE["mullins"]
    if not effect.applies(context.study) or "gel_stiffness" not in context.derivatives:
        return None
    (loss,) = effect.parameters
    stiffness, lost = context.derivative("gel_stiffness"), lost_shares(context)
    if not np.any(lost):
        return None
    width = loss.width / np.sqrt(len(OF_PEAK) * len(REACHES))
    flat = context.observations.flat
    peak, gone = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(1, 5) / 4], indexing="ij"))
    powers = np.column_stack([peak**a * gone**b for a in OF_PEAK for b in OF_RETURN])
    return Module(
        words="what the gel has lost by its largest energy so far",
        directions=-width * flat(stiffness[:, :, None] * lost[:, None, :]),
        name="softening",
        says="the gel has lost stiffness where it was strained more before",
        map=pd.DataFrame({"quantity": "lost share", "peak": peak, "gone": gone}),
        basis=width * np.tile(powers, len(REACHES)),
        unit="1",
        of_labels=False,  # it depends on what was pressed before
        where=lambda row: f"where {row['gone']:.0%} of {row['peak']:.0%} of the largest energy are gone",
        form_of=("mullins",),
    )


def lost_shares(context: Context) -> np.ndarray:
    """Return products of powers (R, q) of the largest energy at each reading and of its share that is gone.

    Means over points about the indentation, for each reach.
    """
    table = context.observations.table
    lost = np.zeros((len(table), len(REACHES), len(OF_PEAK), len(OF_RETURN)))
    for k, reach in enumerate(REACHES):
        energies = Energies(context, reach * WIDER)
        largest = max(energies.largest, np.finfo(float).tiny)
        for rows, W, peak in histories(context, energies):
            gone = np.where(peak > 0, 1 - W / np.where(peak > 0, peak, 1.0), 0.0).clip(0.0, 1.0)
            share = (peak / largest).clip(0.0, 1.0)
            for i, a in enumerate(OF_PEAK):
                for j, b in enumerate(OF_RETURN):
                    lost[rows, k, i, j] = (share**a * gone**b).mean(axis=1)
    return lost.reshape(len(table), -1)


FREE_FORM = FreeForm("softening", module)
