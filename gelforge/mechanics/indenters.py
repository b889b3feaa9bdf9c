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

    def gap(self, points: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gap (n,) [mm] (negative penetrates), normal (n, 3) into the body and its turn dn/dx (n, 3, 3) [1/mm]."""
        ray = points - centre
        r = np.linalg.norm(ray, axis=-1)
        normal = ray / r[:, None]
        turn = (np.eye(3) - normal[:, :, None] * normal[:, None, :]) / r[:, None, None]
        return r - self.radius, normal, turn

    def vertical_gap(
        self, points: np.ndarray, centre: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the same with the vertical distance below the ball and the normal (0, 0, -1) of the undeformed surface.

        Points outside the ball's shadow are open by its centre's height above them.
        """
        d2 = ((points[:, :2] - centre[:2]) ** 2).sum(axis=-1)
        height = centre[2] - np.sqrt(np.maximum(self.radius**2 - d2, 0.0))
        normal = np.tile([0.0, 0.0, -1.0], (len(points), 1))
        return height - points[:, 2], normal, np.zeros((len(points), 3, 3))
