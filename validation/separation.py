"""How far a hidden effect is from the best fit of every other one: what no judge can do better than.

An effect of another name may take any value, positive or negative, and any combination of a few drawn directions and
places. So separations are small rather than large.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
import pandas as pd

from .kinds import KINDS, Kind
from .recording import Instrument, change_of, products
from .world import World

DRAWS = 6  # directions, times and places of each other effect
SMALLEST = 1e-9  # share of the largest eigenvalue, below which directions are the same


def separation(
    plain: World,
    known: Sequence[str],
    hidden: Kind,
    change: np.ndarray,
    rows: pd.DataFrame,
    instrument: Instrument,
    doubts: Sequence[np.ndarray],
) -> dict[str, float | str]:
    """Return the signal-to-noise ratio that the best fit of any other effect leaves of a change, and that effect.

    known: forms that can be hidden on this base. change (R, 3) [N]: of the zeroed forces of all rows.
    """
    others: dict[str, list[np.ndarray]] = {}
    for form in known:
        kind = KINDS[form]
        fits = all(
            needs in (None, has)
            for needs, has in ((kind.zero_by, instrument.zero_by), (kind.tared, instrument.tared))
        )
        if kind.name != hidden.name and fits and kind.sessions <= rows["session"].nunique():
            rng = np.random.default_rng(zlib.crc32(form.encode()))
            others.setdefault(kind.name, []).extend(
                _change(plain, kind, kind.draw(rng), rows, instrument) for _ in range(DRAWS)
            )
    left = {
        name: _left(products(plain, rows, instrument, [change, *changes], True, doubts))
        for name, changes in others.items()
    }
    nearest = min(left, key=left.__getitem__)
    return {"snr": round(left[nearest], 3), "nearest": nearest}


def _change(plain: World, kind: Kind, drawn: dict, rows: pd.DataFrame, instrument: Instrument) -> np.ndarray:
    world = World(plain.library)
    world.changes.extend(plain.changes)
    kind.put(world, 1.0, drawn)
    return change_of(plain, world, rows, instrument.tared)


def _left(gram: np.ndarray) -> float:
    """Return the norm that is left of the first of some vectors by the span of the others, from their products."""
    size = np.sqrt(np.maximum(np.diag(gram)[1:], np.finfo(float).tiny))
    among, along = gram[1:, 1:] / np.outer(size, size), gram[1:, 0] / size
    values, vectors = np.linalg.eigh(among)
    on = values > SMALLEST * values[-1]
    fitted = np.sum((vectors[:, on].T @ along) ** 2 / values[on])
    return float(np.sqrt(max(gram[0, 0] - fitted, 0.0)))
