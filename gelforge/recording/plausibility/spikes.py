"""Single readings whose force lies beyond what the readings before and after them allow: a lost digit, a glitch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gelforge.indentation.paths.places import DEPTH_MATCH_MM
from gelforge.recording.plausibility.findings import Finding, force_left_out, mostly
from gelforge.recording.plausibility.indentations import isolated_floors
from gelforge.recording.plausibility.streams import FORCE

if TYPE_CHECKING:
    from gelforge.recording.plausibility.session import SessionData

# Of 37 kinds of honest SYNTHETIC sessions each passes, and each seeded fault is found
# (tests/recording/test_plausibility.py):
# of the largest force towards the gel of the indentation's other readings: less is stick and slip
SPIKE_SHARE = 0.2
# as of `mechanics.friction` (docs/configuration.md): sideways over what pushes or pulls where the contact is weak
LARGEST_FRICTION = 2.0


def force_spikes(data: SessionData) -> list[Finding]:
    """Return the single readings whose force lies outside that of the readings before and after, far beyond noise.

    Between two depths of one way the force lies between theirs, and in a wait it falls. Asked are readings of `load`,
    `dwell` and `unload`; while unloading the last one before it counts too, since a gel recovers. Not asked: a reading where
    the way turns or a wait begins, where force may peak and relax; a small force while unloading, where a gel sticks; a fall
    while loading, before anything pushes, where it snaps to the indenter; a sideways force that friction explains where it
    sticks. After the last reading nothing touches. Of an indentation the worst reading is returned.
    """
    names = ["press", "phase", "time_s", "depth_mm", *FORCE]
    known = data.readings.loc[data.readings[FORCE].notna().all(axis=1), names]
    known = known[~known.index.isin(data.repeated_rows)]
    presses = [rows for _, rows in known.groupby("press", sort=False) if len(rows) > 1]
    if not presses:
        return []
    measured = [_beyond(rows, data.floor_N) for rows in presses]
    floors = isolated_floors(np.concatenate([beyond for beyond, _ in measured]) / data.floor_N) * data.floor_N
    findings = []
    for rows, (beyond, share) in zip(presses, measured):
        limit = np.maximum(floors, share)
        k, axis = np.unravel_index((beyond / limit).argmax(), beyond.shape)
        if beyond[k, axis] > limit[k, axis]:
            findings.append(_finding(rows, k + 1, axis, float(beyond[k, axis]), float(limit[k, axis])))
    return mostly(findings, len(data.indentations))


def _beyond(rows: pd.DataFrame, floor_N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (n - 1, 3) [N] of the readings of an indentation after the first: how far each lies outside those next to it

    (0 where it is not asked), and the share of the force that is let pass.
    """
    phase = rows["phase"].to_numpy()[1:]
    # (n + 1, 3), z towards the gel
    push = np.vstack([rows[FORCE].to_numpy() * [1.0, 1.0, -1.0], np.zeros(3)])
    depth = np.append(np.maximum(np.nan_to_num(rows["depth_mm"].to_numpy()), 0.0), 0.0)
    before, here, after = push[:-2], push[1:-1], push[2:]  # (n - 1, 3)
    up = phase == "unload"
    held = np.flatnonzero(rows["phase"].isin(["load", "dwell"]))
    last = push[held[-1]] if len(held) else np.zeros(3)
    neighbours = np.stack([before, after, np.where(up[:, None], last, before)])
    above, below = here - neighbours.max(axis=0), neighbours.min(axis=0) - here
    below[up | (before[:, 2] <= 0), 2] = 0.0
    beyond = np.maximum(np.maximum(above, below), 0.0)

    share = np.repeat(SPIKE_SHARE * _largest_of_others(push[:-1, 2])[1:, None], 3, axis=1)
    weak = here[:, 2:] < share[:, 2:] + floor_N[2]
    rubs = np.abs(here[:, :2]) <= LARGEST_FRICTION * (np.abs(here[:, 2:]) + floor_N[:2])
    beyond[:, :2] = np.where(weak & rubs, 0.0, beyond[:, :2])

    into, out = np.diff(depth)[:-1], np.diff(depth)[1:]
    peak = (into > DEPTH_MATCH_MM) & (out <= DEPTH_MATCH_MM)
    dip = (into < -DEPTH_MATCH_MM) & (out >= -DEPTH_MATCH_MM)
    asked = np.isin(phase, ["load", "dwell", "unload"]) & ~peak & ~dip
    return np.where(asked[:, None], beyond, 0.0), share


def _largest_of_others(push: np.ndarray) -> np.ndarray:
    """Return for each of two or more values (n,) the largest of the others, 0 at least: none vouches for itself."""
    second, first = np.maximum(np.sort(push)[-2:], 0.0)
    return np.where(push == first, second, first)


def _finding(rows: pd.DataFrame, row: int, axis: int, beyond: float, limit: float) -> Finding:
    name, at, forces = FORCE[axis], rows.iloc[row], rows[FORCE[axis]].to_numpy()
    after = forces[row + 1] if row + 1 < len(rows) else 0.0
    return force_left_out(
        test="force_spikes",
        press=str(at["press"]),
        time_s=float(at["time_s"]),
        value=float(beyond),
        limit=float(limit),
        found=(
            f"is {forces[row]:.3g} N ({name.removesuffix('_N')}) in phase {at['phase']} at {at['depth_mm']:g} mm, outside"
            f" the {forces[row - 1]:.3g} and {after:.3g} N before and after it"
        ),
        remedy="correct the reading, or record this indentation again",
        rows=(int(rows.index[row]),),
    )
