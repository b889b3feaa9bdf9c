"""How well predictions meet readings, all of them or those held out, as verdict.json says it."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from gelforge.config import NonNegative, Section
from gelforge.mismatch.thresholds import HELD_OUT_ERRORS, HELD_OUT_ODDS

Probability = Annotated[float, Field(ge=0, le=1)]
ThreeAxes = Annotated[list[float | None], Field(min_length=3, max_length=3)]


class Score(Section):
    """How well predictions meet readings."""

    readings: int = Field(ge=0, description="Readings times axes that were compared [-]")
    rmse_N: ThreeAxes = Field(description="Root mean square of measured minus predicted, x, y, z [N]")


def by_axis(labels: pd.DataFrame, values: np.ndarray) -> list[float | None]:
    """Return the root mean square of entries (n,) with these labels, by axis x, y, z; None of an axis without any."""
    per_axis = [values[labels["axis"] == k] for k in range(3)]
    return [float(np.sqrt(np.mean(one**2))) if len(one) else None for one in per_axis]


def score(labels: pd.DataFrame, left: np.ndarray, mask: np.ndarray | None = None) -> Score:
    """Return how well a prediction that leaves (n,) [N] meets entries with these labels: all, or some (n,) bool."""
    mask = np.ones(len(left), bool) if mask is None else mask
    return Score(readings=int(mask.sum()), rmse_N=by_axis(labels[mask], left[mask]))


def shown(gain: float, standard_error: float) -> bool:
    """Return whether a gain in log score of what was held out, with its standard error, is more than chance."""
    return gain > min(HELD_OUT_ERRORS * standard_error, math.log(HELD_OUT_ODDS))


class HeldOut(Section):
    """Readings held out, of one block or of all together: predicted by values that follow the others."""

    block: str = Field(description="positions, deepest, a channel, or all")
    before: Score = Field(description="Of the nominal model")
    after: Score = Field(description="With the effect in it")
    gain: float = Field(description="Log score after minus before [-]")
    standard_error: NonNegative = Field(description="Of the gain [-]")
    selection_penalty: float = Field(
        0.0, le=0, description="Of the gain, as these readings helped to choose the answer [-]"
    )

    @property
    def shown(self) -> bool:
        """Return whether the gain is more than chance."""
        return shown(self.gain + self.selection_penalty, self.standard_error)
