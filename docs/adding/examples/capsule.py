"""An indenter: a cylinder with half balls at both ends."""

from dataclasses import dataclass

import numpy as np

from gelforge.mechanics.indenters.shapes import Indenter


@dataclass(frozen=True)
class Capsule(Indenter):
    """A cylinder about z with half balls at both ends, on its lower end; lengths in mm."""

    radius: float
    length: float  # with both ends

    def distance(self, points):
        half = self.length / 2 - self.radius
        middle = np.clip(points[:, 2], self.radius, self.radius + 2 * half)  # the nearest point of the axis
        away = points - np.column_stack([np.zeros((len(points), 2)), middle])
        r = np.linalg.norm(away, axis=1)
        normal = away / r[:, None]
        turn = (np.eye(3) - normal[:, :, None] * normal[:, None, :]) / r[:, None, None]
        on_side = (points[:, 2] == middle)[:, None, None]  # straight along z there
        along = np.where(on_side, np.outer([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]) / r[:, None, None], 0.0)
        return r - self.radius, normal, turn - along

    def support(self, direction):
        half = self.length / 2 - self.radius
        lift = self.length / 2 * direction[2] + half * abs(direction[2])
        return float(lift + self.radius * np.linalg.norm(direction))
