"""Readings that jump out of the course of their indentation: they are left out before anything is judged."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.mismatch.readings.observations import SetAside
from gelforge.recording.readings import FORCE, Recording

# Standard deviations of a held reading from the course of the others of its indentation at that depth
OUTLIER = 8.0


def without_outliers(recording: Recording, noise: np.ndarray) -> tuple[pd.DataFrame, list[SetAside]]:
    """Return the readings without held ones that jump away from others of their press at that depth, and a list of those."""
    readings = recording.readings
    held = readings[readings["phase"].isin(["load", "dwell"])]
    force, time, size = held[FORCE].to_numpy() / noise, held["time_s"].to_numpy(), np.zeros(len(held))
    for rows in held.groupby(["press", "depth_mm"], sort=False).indices.values():
        # Beside a jump others seem to jump: one after the other.
        while (jumps := _jumps(force[rows], time[rows])).max() > OUTLIER:
            worst = int(np.argmax(jumps))
            size[rows[worst]] = jumps[worst]
            rows = np.delete(rows, worst)
    far = size > OUTLIER
    said = [
        SetAside(
            session=recording.session.session,
            press=str(row.press),
            time_s=row.time_s,
            depth_mm=row.depth_mm,
            size=round(value, 1),
            reason="far from the other readings of its indentation at that depth",
        )
        for row, value in zip(held[far].itertuples(), size[far])
    ]
    return readings.drop(index=held.index[far]).reset_index(drop=True), said


def _jumps(force: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return by how much each of some readings (k, 3), in order of time (k,), jumps out of their course.

    Relaxation falls on, slower and slower: one inside jumps if it lies to one side of both neighbours, the last one if it
    falls further than all before it did, and faster. The first is never blamed: most of what relaxes may be gone after it.
    """
    size, step = np.zeros(len(force)), np.diff(force, axis=0)
    to_one_side = step[:-1] * step[1:] < 0
    nearer = np.minimum(np.abs(step[:-1]), np.abs(step[1:]))
    size[1:-1] = np.where(to_one_side, nearer, 0.0).max(axis=1, initial=0)
    if len(force) >= 4:
        longer = (time[-1] - time[-2]) / max(time[-2] - time[0], 1e-9)  # a wait than all before it
        size[-1] = (np.abs(step[-1]) - max(1.0, longer) * np.ptp(force[:-1], axis=0)).max()
    return size
