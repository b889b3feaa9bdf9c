"""The force sensor lags behind: it reads more on the way up than on the way down at the same force."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.context import Context
from gelforge.mismatch.effect import Effect, Parameter, Shape


def loop(context: Context, force: np.ndarray) -> np.ndarray:
    """Return the opening (R, 3) [N] of the loop per share: 4 s (1 - s) P, s = F / P and P the largest F of the press so far.

    It is zero at the peak and at no force and P at half of it: hysteresis as data sheets define it, by axis.
    """
    opening = np.zeros_like(force)
    for rows in context.observations.table.groupby("press", sort=False).indices.values():
        F = force[rows]
        size = np.abs(F)
        number = np.where(size >= np.maximum.accumulate(size, axis=0), np.arange(len(rows))[:, None], 0)
        P = np.take_along_axis(F, np.maximum.accumulate(number, axis=0), axis=0)
        s = np.clip(np.divide(F, P, out=np.ones_like(F), where=P != 0), 0.0, 1.0)
        opening[rows] = 4 * s * (1 - s) * P
    return opening


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces as a sensor with hysteresis reads them, calibrated on the way down."""
    (share,) = amounts
    return force + share * loop(context, force)


EFFECT = Effect(
    name="force_hysteresis",
    family="force sensor",
    parameters=(
        Parameter(
            "share", "1", 0.02, (0.0, 0.3),
            "width: data sheets of load cells give 0.1 to 1 % of full scale, printed and optical ones several per cent;"
            " bounds: no sensor to measure with", sign=1,
        ),
    ),
    enters="force readings on the way up",
    signature="more force on the way up, most at half of the press's largest force; loading clean",
    confused_with=("viscoelastic", "adhesion", "mullins", "clock_offset"),
    separated_by="dead weights put on and taken off; unloading at two speeds (hysteresis does not know time)",
    to_forces=to_forces,
    unloading=True,
    form_error=0.4,  # of play, whose loop is as wide at any force
)  # fmt: skip
