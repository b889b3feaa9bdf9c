"""Data-entry errors of the analyst: they are there or not, and turn the readings into others by one of a few ways."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Parameter, Shape
from gelforge.mismatch.model.solver_effects import ON


def data_entry_error(
    key: str, ways: Iterable[str], default: str, read: Callable[[np.ndarray, str], np.ndarray]
) -> dict:
    """Return the fields of an Effect that is on or off; each way is a shape {key: way}.

    read gives what is read (R, 3) [N] of forces on the sensor (R, 3) by one way.
    """
    shapes: list[Shape] = [{key: way} for way in ways]

    def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
        (a,) = amounts
        return force + a * (read(force, str(shape.get(key, default))) - force)

    return {
        "family": "analyst",
        "parameters": (
            Parameter(
                "on", "1", 1.0, ON, "on or off: a data-entry error of the session, no quantity", sign=1
            ),
        ),
        "to_forces": to_forces,
        "shapes": lambda context: shapes,
        "binary": True,
    }
