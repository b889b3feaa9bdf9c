"""Solved presses at other places: every step of a solved path, moved and turned.

Far from walls a press looks the same everywhere and from all sides. Near a wall it keeps its distance from the wall, and is
turned by the symmetries of the sensor only. Forces and displacement are moved together, so a row stays a state of
equilibrium of the gel up to what the walls change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import Sensor, VirtualParticles
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.sensor.symmetry import D4, transform_points
from gelforge.interpolation.nodal_forces import NodalForces
from gelforge.synthesis.frame import MovingFrame, displaced

# Distance from the walls, over the sensor's height, beyond which they are not felt: the total force of a press then differs
# from that in the middle by less than its error bar (benchmarks/synthesis.py prints both).
FREE_HEIGHTS = 1.5
KEPT_SHARE = 0.05  # nearer to a wall, a press is moved by at most this share of its distance from it


@dataclass(frozen=True)
class DrawnPress:
    """One state of a press: where, its forces, and how it moves the particles."""

    place: np.ndarray  # (2,) [mm]
    depth_mm: float
    phase: str
    bins: np.ndarray  # (B, 3) [N]
    moved: Callable[[np.ndarray], np.ndarray]  # particles (P, 3) [mm] -> displacement (P, 3) [mm]


class MovedPresses:
    """The steps of solved paths at drawn places and directions.

    Parameters
    ----------
    sensor : Sensor
        The sensor that is pressed.
    cells : sequence of Cell
        The solved paths with the gel's displacement.
    symmetric : bool
        Whether the sensor has the symmetries of a square.
    particles : VirtualParticles, optional
        What moves with the gel.
    """

    def __init__(
        self,
        sensor: Sensor,
        cells: Sequence[Cell],
        symmetric: bool,
        particles: VirtualParticles | None = None,
    ):
        self.sensor, self.symmetric = sensor, symmetric
        self.frame = MovingFrame(sensor, particles)
        self.cells = [cell for cell in cells if len(cell.arrays["depth_mm"])]
        self._fields: dict[int, np.ndarray] = {}
        self._forces = [NodalForces.of(cell) for cell in self.cells]
        self.free_mm = FREE_HEIGHTS * sensor.height_mm
        self._width = np.array([sensor.width_x_mm, sensor.width_y_mm])

    def draw(self, rng: np.random.Generator, kind: int | None = None) -> DrawnPress:
        """Return a drawn step of a drawn path, or of the path of a number, moved and turned."""
        number = int(rng.integers(len(self.cells))) if kind is None else kind
        cell = self.cells[number]
        step = int(rng.integers(len(cell.arrays["depth_mm"])))
        source = np.array([cell.attributes["x_mm"], cell.attributes["y_mm"]])
        if self._is_free(source):
            angle = float(rng.uniform(0, 2 * np.pi))
            place = rng.uniform(self.free_mm, self._width - self.free_mm)
            return self.turned(number, step, place, angle)
        symmetry = str(rng.choice(list(D4))) if self.symmetric else "identity"
        return self.mirrored(number, step, symmetry, rng)

    def _is_free(self, place: np.ndarray) -> bool:
        return bool((np.minimum(place, self._width - place) >= self.free_mm).all())

    def turned(self, number: int, step: int, place: np.ndarray, angle: float) -> DrawnPress:
        """Return a step of a path far from walls, at a place (2,) [mm] far from walls, turned by an angle [rad]."""
        cell = self.cells[number]
        source = np.array([cell.attributes["x_mm"], cell.attributes["y_mm"]])
        matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

        def moved(particles: np.ndarray) -> np.ndarray:
            at_source = particles.copy()
            at_source[:, :2] = (
                particles[:, :2] - place
            ) @ matrix + source  # beyond the gel: as at its border
            shift = displaced(self._field(number)[step], self.frame.index(at_source, source))
            shift[:, :2] = shift[:, :2] @ matrix.T
            return shift

        return self._press(number, step, place, matrix, moved)

    def mirrored(self, number: int, step: int, symmetry: str, rng: np.random.Generator) -> DrawnPress:
        """Return a step of a path near a wall, carried by a symmetry and moved along the wall, or a little across."""
        cell = self.cells[number]
        source = np.array([cell.attributes["x_mm"], cell.attributes["y_mm"]])
        image, matrix = transform_points(symmetry, source, self._width[0]), D4[symmetry].astype(float)
        place = np.array([self._moved_along(c, w, rng) for c, w in zip(image, self._width)])
        inverse = next(name for name in D4 if (D4[name] == D4[symmetry].T).all())
        at = transform_points(inverse, place, self._width[0])

        def moved(particles: np.ndarray) -> np.ndarray:
            local = transform_points(inverse, particles, self._width[0])
            shift = displaced(self._field(number)[step], self.frame.index(local, at))
            shift[:, :2] = shift[:, :2] @ matrix.T
            return shift

        return self._press(number, step, place, matrix, moved)

    def _moved_along(self, at: float, width: float, rng: np.random.Generator) -> float:
        """Return a coordinate for one of a solved press: anywhere far from walls, else about as near to its wall."""
        wall = min(at, width - at)
        if wall >= self.free_mm:
            return float(rng.uniform(self.free_mm, width - self.free_mm))
        return at + float(rng.uniform(-1, 1)) * KEPT_SHARE * wall

    def _field(self, number: int) -> np.ndarray:
        if number not in self._fields:
            self._fields[number] = self.frame.field(self.cells[number])
        return self._fields[number]

    def _press(self, number: int, step: int, place: np.ndarray, matrix: np.ndarray, moved) -> DrawnPress:
        cell = self.cells[number]
        found = self._forces[number].turned(matrix).binned(place, self.sensor, [step])[0].reshape(-1, 6)
        bins = found[:, :3] + found[:, 3:]
        return DrawnPress(
            place, float(cell.arrays["depth_mm"][step]), str(cell.attributes["phases"][step]), bins, moved
        )
