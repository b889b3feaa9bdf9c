"""What is done to a press between command and reading: a recording's hidden physics, put together from parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from .library import Library
from .presses import Plan

Rows = pd.DataFrame


@dataclass
class World:
    """Each list holds what acts at that stage, in turn; an empty world is the base.

    Places are from the sensor's middle [mm], forces act on the sensor [N].
    """

    library: Library
    clock: list[Callable[[Rows], np.ndarray]] = field(
        default_factory=list
    )  # depth in place of that commanded
    places: list[Callable[[Rows, np.ndarray], np.ndarray]] = field(default_factory=list)  # rows, xy -> xy
    depths: list[Callable[[Rows, np.ndarray], np.ndarray]] = field(
        default_factory=list
    )  # rows, xy -> deeper by
    changes: list[Callable[[np.ndarray, np.ndarray], tuple]] = field(
        default_factory=list
    )  # xy, depth -> ratios
    yielding: list[Callable[[np.ndarray, np.ndarray], np.ndarray]] = field(
        default_factory=list
    )  # xy, Fz -> mm
    history: list[Callable] = field(default_factory=list)  # world, rows, xy, depth, force -> force
    sensor: list[Callable[[Rows, np.ndarray], np.ndarray]] = field(
        default_factory=list
    )  # rows, force -> force

    @property
    def plan(self) -> Plan:
        """Return the plan of the sensor's recordings."""
        return self.library.sensor.plan

    def elastic(self, xy: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return the force (R, 3) of the pressed body without memory."""
        force = self.library.base(xy, depth)
        if not self.changes:
            return force
        d = np.maximum(depth, 0.0)
        flat = force[:, :2] / np.where(force[:, 2:] == 0, 1.0, force[:, 2:])
        total = np.zeros(len(depth))
        for change in self.changes:
            ratio, horizontal = change(xy, d)
            total += ratio
            flat = flat + horizontal
        z = force[:, 2] * np.exp(total)
        return np.stack([flat[:, 0] * z, flat[:, 1] * z, z], axis=1)

    def reached(self, rows: Rows, touch_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where and how deep (R, 2), (R,) the gel is really pressed; touch_mm (R,): deeper by the zero's error."""
        xy = rows[["x_mm", "y_mm"]].to_numpy()
        for move in self.places:
            xy = move(rows, xy)
        depth = rows["depth_mm"].to_numpy()
        for read in self.clock:
            depth = read(rows)
        sent = depth + np.where(depth > 0, touch_mm, 0.0)
        for deeper in self.depths:
            sent = sent + np.where(depth > 0, deeper(rows, xy), 0.0)
        return xy, self._after_yielding(xy, sent)

    def _after_yielding(self, xy, sent) -> np.ndarray:
        """Return the depth that is left when what stands in series has yielded: d + y(F(d)) = sent, by bisection."""
        if not self.yielding:
            return sent
        low, high = np.minimum(sent, 0.0), sent.copy()
        for _ in range(40):
            middle = (low + high) / 2
            z = self.elastic(xy, middle)[:, 2]
            over = middle + sum(y(xy, z) for y in self.yielding) > sent
            low, high = np.where(over, low, middle), np.where(over, middle, high)
        return (low + high) / 2

    def forces(self, rows: Rows, touch_mm: np.ndarray | float = 0.0) -> np.ndarray:
        """Return what the force sensor would show (R, 3) [N] without noise, zero not subtracted."""
        xy, depth = self.reached(rows, np.broadcast_to(touch_mm, len(rows)))
        force = self.elastic(xy, depth)
        for remember in self.history:
            force = remember(self, rows, xy, depth, force)
        for read in self.sensor:
            force = read(rows, force)
        return force


def zeroed(rows: Rows, force: np.ndarray, tared: bool) -> np.ndarray:
    """Return forces (R, 3) less the mean of each press's zero rows, unless the session is tared."""
    if tared:
        return force
    zero = rows["phase"].to_numpy() == "zero"
    group = rows.groupby(["session", "order"], sort=False).ngroup().to_numpy()
    count = np.bincount(group[zero], minlength=group.max() + 1)
    mean = np.stack(
        [np.bincount(group[zero], f[zero], minlength=group.max() + 1) / count for f in force.T], axis=1
    )
    return force - mean[group]


def held(rows: Rows) -> np.ndarray:
    """Return (R,) bool: the readings under load."""
    return (rows["phase"] != "zero").to_numpy()
