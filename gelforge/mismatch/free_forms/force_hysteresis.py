"""Hysteresis of the force sensor in any form: bands of play of several widths, and openings over the largest force so far.

Bands side by side make what a mount with friction does (Prandtl and Ishlinskii's model); an opening that grows with the
largest force so far and closes towards it is that of a material that damps, as data sheets draw it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.linalg import block_diag

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.force_hysteresis import largest_so_far, play
from gelforge.mismatch.evidence.kernels import AXES, FreeForm, Module
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context

BANDS = (0.25, 1.0, 4.0)  # of a plausible hysteresis, half a band's share of the largest force
OF_PEAK = (1.0, 2.0)  # powers of the largest force so far over the largest of all
OF_RETURN = (0.5, 1.0, 2.0)  # powers of the share of it that is gone
COUNT = len(BANDS) + len(OF_PEAK) * len(OF_RETURN)


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return the openings by axis; none without readings during unloading, where alone they show."""
    if not (context.observations.table["phase"] == "unload").any():
        return None
    width = CATALOGUE["force_hysteresis"].parameters[0].width
    openings, flat = _openings(context, width), context.observations.flat
    # by axis (n, q)
    directions = [flat(np.where(np.arange(3)[:, None] == k, openings, 0.0)) for k in range(3)]
    # of the map: the largest force so far, and the share of it that still presses
    grids = np.meshgrid((0.25, 0.5, 1.0), (0.25, 0.5, 0.75), indexing="ij")
    peak, left = (grid.ravel() for grid in grids)
    loops = _of_map(peak, left, width)
    at = pd.DataFrame({"largest_force_share": peak, "left_share": left})
    return Module(
        words="a lag of the force sensor",
        directions=np.column_stack(directions),
        name="force_hysteresis",
        says="the force sensor reads differently during unloading",
        map=pd.concat([at.assign(quantity=f"opening of {axis}") for axis in AXES], ignore_index=True),
        basis=block_diag(*[loops] * 3),
        unit="of the largest force",
        of_labels=False,  # it is the sensor's, not the gel's
        where=lambda row: (
            f"at {row['left_share']:.0%} of a largest force of {row['largest_force_share']:.0%}"
        ),
        form_of=("force_hysteresis",),
    )


def _openings(context: Context, width: float) -> np.ndarray:
    """Return changes (R, 3, q) [N] of the readings by each band and opening, a standard deviation of width together."""
    force = context.force
    largest = np.abs(force).max(axis=0)
    peak = largest_so_far(context, force)
    share = np.divide(np.abs(peak), largest, out=np.zeros_like(force), where=largest > 0)
    gone = 1 - np.clip(np.divide(force, peak, out=np.ones_like(force), where=peak != 0), 0.0, 1.0)
    bands = [play(context, force, np.full(3, width * band)) for band in BANDS]
    powers = [width * np.sign(peak) * largest * share**a * gone**b for a in OF_PEAK for b in OF_RETURN]
    return np.stack([*bands, *powers], axis=-1) / np.sqrt(COUNT)


def _of_map(peak: np.ndarray, left: np.ndarray, width: float) -> np.ndarray:
    """Return the openings (G, q), shares of the largest force of all, where a share `left` of the peak (G,) is left."""
    force, openings = left * peak, []
    for half in (width * band for band in BANDS):
        openings.append(np.minimum(force + half, peak - half) - np.maximum(force - half, 0.0))
    openings += [width * peak**a * (1 - left) ** b for a in OF_PEAK for b in OF_RETURN]
    return np.column_stack(openings) / np.sqrt(COUNT)


FREE_FORM = FreeForm("force_hysteresis", module)
