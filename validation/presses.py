"""The presses of a recording in time: places, depths, order, and the rows that are read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

Place = tuple[float, float]
TOUCH_S = 1.0  # of a press: when it touches
ZERO_S = (0.0, 0.1, 0.2)
LEAVE_S = 0.1  # from the last reading at rest to unloading
COLUMNS = ["session", "press", "order", "cell", "phase", "at_s", "depth_mm", "speed", "dwell_s", "deepest_mm"]


@dataclass(frozen=True)
class Plan:
    """What a session presses: the middle, `away` with its quarter turns [mm], depths [mm], the stage's course in time."""

    away: tuple[Place, ...]
    depths: tuple[float, ...]
    sentinel_every: int = 0  # the middle again, to the deepest; 0: never
    random_order: bool = True  # else place after place, each from the shallowest depth on
    press_s: float = 12.0
    speed: float = 1.0  # mm/s
    dwell_s: tuple[float, ...] = (0.5, 2.0, 4.0)
    unloading: bool = True  # whether the deepest presses are read during unloading too

    @property
    def places(self) -> list[Place]:
        """Return the places from the middle [mm], the middle first."""
        turned = [(x, y) for a, b in self.away for x, y in ((a, b), (-b, a), (-a, -b), (b, -a))]
        return [(0.0, 0.0), *[(x + 0.0, y + 0.0) for x, y in turned]]

    def table(self, middle: np.ndarray) -> pd.DataFrame:
        """Return the plan of the base study: cell, x_mm, y_mm, depth_mm; middle (2,) of the sensor [mm]."""
        rows = [(f"c{k:02d}", *(middle + p), d) for k, p in enumerate(self.places) for d in self.depths]
        return pd.DataFrame(rows, columns=["cell", "x_mm", "y_mm", "depth_mm"])

    def commanded_depth(self, at_s: np.ndarray, deepest: np.ndarray) -> np.ndarray:
        """Return the stage's depth (R,) [mm] at times since a press's start (R,) [s]: down, wait, up; 0 before contact."""
        down = (at_s - TOUCH_S) * self.speed
        left = TOUCH_S + deepest / self.speed + self.dwell_s[-1] + LEAVE_S
        up = deepest - (at_s - left) * self.speed
        return np.where(at_s < left, np.minimum(down, deepest), up)

    def rows_of(self, depth: float) -> list[tuple]:
        """Return phase, time, depth, speed, time at rest and deepest depth of the readings of one press."""
        deepest = depth == self.depths[-1]
        rows = [("zero", t, -TOUCH_S, 0.0, np.nan) for t in ZERO_S]
        down = [d for d in self.depths if d < depth] if deepest else []
        rows += [("load", TOUCH_S + d / self.speed, d, self.speed, np.nan) for d in [*down, depth]]
        arrived = TOUCH_S + depth / self.speed
        rows += [("dwell", arrived + w, depth, 0.0, w) for w in self.dwell_s]
        left = arrived + self.dwell_s[-1] + LEAVE_S
        up = down[::-1] if self.unloading else []
        rows += [("unload", left + (depth - d) / self.speed, d, -self.speed, np.nan) for d in up]
        return [(*row, depth) for row in rows]


def timeline(rng: np.random.Generator, plan: Plan, sessions: int = 1) -> pd.DataFrame:
    """Return all rows of a recording: presses in the plan's order, its sentinel between, shared out over sessions.

    Columns: COLUMNS, time_s, and x_mm, y_mm from the middle; session is its number, speed is positive downward. The
    deepest presses are read at all depths of loading, and of unloading where the plan has it.
    """
    every = [(k, depth) for k in range(len(plan.places)) for depth in plan.depths]
    order = [every[i] for i in rng.permutation(len(every))] if plan.random_order else every
    sequence = []
    for k, press in enumerate(order):
        if plan.sentinel_every and k % (plan.sentinel_every - 1) == 0:
            sequence.append((0, plan.depths[-1]))
        sequence.append(press)
    rows, first = [], [round(len(sequence) * s / sessions) for s in range(sessions + 1)]
    for session in range(sessions):
        for order_in, (k, depth) in enumerate(sequence[first[session] : first[session + 1]]):
            rows += [(session, f"p{order_in:04d}", order_in, k, *row) for row in plan.rows_of(depth)]
    table = pd.DataFrame(rows, columns=COLUMNS)
    table["time_s"] = (table["order"] * plan.press_s + table["at_s"]).round(3)
    table["x_mm"], table["y_mm"] = np.array(plan.places)[table["cell"]].T
    table["cell"] = [f"c{k:02d}" for k in table["cell"]]
    return table
