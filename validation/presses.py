"""The presses of a recording in time: places, depths, order, and the rows that are read."""

from __future__ import annotations

import numpy as np
import pandas as pd

MIDDLE = np.array([10.0, 10.0])  # of the sensor [mm]
CENTRE = (0.0, 0.0)
AWAY = [(6.0, 0.0), (4.0, 2.0), (6.0, 6.0)]  # with their quarter turns: 13 places from the middle [mm]
DEPTHS = (0.4, 0.8, 1.2, 1.6)  # [mm]
SENTINEL_EVERY = 9  # the centre again, to the deepest
PRESS_S, TOUCH_S, SPEED = 12.0, 1.0, 1.0  # of a press; when it touches; mm/s
ZERO_S, DWELL_S = (0.0, 0.1, 0.2), (0.5, 2.0, 4.0)


def places() -> list[tuple[float, float]]:
    """Return the 13 places from the middle [mm]."""
    turned = [(x, y) for a, b in AWAY for x, y in ((a, b), (-b, a), (-a, -b), (b, -a))]
    return [CENTRE, *[(x + 0.0, y + 0.0) for x, y in turned]]


def plan_table() -> pd.DataFrame:
    """Return the plan of the base study: cell, x_mm, y_mm, depth_mm."""
    rows = [(f"c{k:02d}", *(MIDDLE + place), depth) for k, place in enumerate(places()) for depth in DEPTHS]
    return pd.DataFrame(rows, columns=["cell", "x_mm", "y_mm", "depth_mm"])


def timeline(rng: np.random.Generator, sessions: int = 1) -> pd.DataFrame:
    """Return all rows of a recording: presses in random order, the sentinel every ninth, shared out over sessions.

    Columns: session (its number), press, order, cell, phase, time_s, x_mm, y_mm (from the middle), depth_mm, deepest_mm,
    speed (down positive) and dwell_s. The deepest presses are read on their way down and up as well.
    """
    every = [(k, depth) for k in range(len(places())) for depth in DEPTHS]
    order = [every[i] for i in rng.permutation(len(every))]
    sequence = []
    for k, press in enumerate(order):
        if k % (SENTINEL_EVERY - 1) == 0:
            sequence.append((0, DEPTHS[-1]))
        sequence.append(press)
    rows, first = [], [round(len(sequence) * s / sessions) for s in range(sessions + 1)]
    for session in range(sessions):
        for order_in, (k, depth) in enumerate(sequence[first[session] : first[session + 1]]):
            rows += [(session, f"p{order_in:04d}", order_in, k, *row) for row in _rows_of(depth)]
    names = [
        "session",
        "press",
        "order",
        "cell",
        "phase",
        "at_s",
        "depth_mm",
        "speed",
        "dwell_s",
        "deepest_mm",
    ]
    table = pd.DataFrame(rows, columns=names)
    table["time_s"] = (table["order"] * PRESS_S + table["at_s"]).round(3)
    xy = np.array(places())[table["cell"]]
    table["x_mm"], table["y_mm"] = xy.T
    table["cell"] = [f"c{k:02d}" for k in table["cell"]]
    return table


def _rows_of(depth: float) -> list[tuple]:
    deepest = depth == DEPTHS[-1]
    rows = [("zero", t, -TOUCH_S * SPEED + t * 0, 0.0, np.nan) for t in ZERO_S]
    down = [d for d in DEPTHS if d < depth] if deepest else []
    rows += [("load", TOUCH_S + d / SPEED, d, SPEED, np.nan) for d in [*down, depth]]
    arrived = TOUCH_S + depth / SPEED
    rows += [("dwell", arrived + w, depth, 0.0, w) for w in DWELL_S]
    left = arrived + DWELL_S[-1] + 0.1
    rows += [("unload", left + (depth - d) / SPEED, d, -SPEED, np.nan) for d in down[::-1]]
    return [(*row, depth) for row in rows]


def commanded_depth(at_s: np.ndarray, deepest: np.ndarray) -> np.ndarray:
    """Return the stage's depth (R,) [mm] at times since a press's start (R,) [s]: down, wait, up; 0 before contact."""
    down = (at_s - TOUCH_S) * SPEED
    left = TOUCH_S + deepest / SPEED + DWELL_S[-1] + 0.1
    up = deepest - (at_s - left) * SPEED
    return np.where(at_s < left, np.minimum(down, deepest), up)
