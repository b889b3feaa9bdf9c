"""Rigid indenters: gap and normal of surface points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sphere:
    """A rigid ball of this radius [mm]; its reference position touches the undeformed top surface (z = 0) from above."""

    radius: float

    def start(self, x: float, y: float) -> np.ndarray:
        """Return the centre (3,) [mm] at first touch above (x, y)."""
        return np.array([x, y, self.radius])

    def gap(self, points: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gap (n,) [mm] (negative penetrates) and normal (n, 3) from the ball into the body at points (n, 3)."""
        ray = points - centre
        r = np.linalg.norm(ray, axis=-1)
        return r - self.radius, ray / r[:, None]

    def vertical_gap(self, points: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the vertical gap (n,) [mm] below the ball and the normal (0, 0, -1) of the undeformed surface.

        Points outside the ball's shadow are open by its height above them.
        """
        d2 = ((points[:, :2] - centre[:2]) ** 2).sum(axis=-1)
        height = centre[2] - np.sqrt(np.maximum(self.radius**2 - d2, 0.0))
        return height - points[:, 2], np.broadcast_to([0.0, 0.0, -1.0], points.shape)
