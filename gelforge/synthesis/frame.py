"""Coordinates that move with the indenter and stretch to the gel's walls, and displacement fields on a grid of them.

The displacement of a press depends on the place mostly through the distance from the indenter; at a wall it is that of the
wall. A field on this grid therefore changes slowly from site to site, and can be interpolated between sites or carried to
another place.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from gelforge.config import Sensor, VirtualParticles
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.places import ROUNDING_MM
from gelforge.indentation.sensor.symmetry import D4
from gelforge.virtual_lab.particles import VirtualLabError, dots_box, gel_boxes, interpolation

# `python benchmarks/synthesis.py` prints the errors of rows that are made so:
CORE_HEIGHTS = 0.5  # half width, over the sensor's height, of the part that moves with the indenter
# A quarter of a millimetre in the article's sensor: a fifth of the depth at which its particles begin.
# benchmarks/synthesis.py prints the error.
CORE_INTERVALS = 24
# To each wall, finer towards the indenter. benchmarks/synthesis.py prints the error near walls.
OUTER_INTERVALS = 11
# Dots lie on one plane, near the contact's edge, where displacement changes within a fraction of a millimetre.
# As many intervals as for particles in a volume. benchmarks/synthesis.py prints the error.
DOT_FINER = 3


class MovingFrame:
    """A grid in the gel whose lines lie about an indenter.

    Parameters
    ----------
    sensor : Sensor
        A block whose layers with particles form one box; where none has any, all of it.
    particles : VirtualParticles, optional
        What moves with the gel. Of printed dots the grid is one plane of finer intervals.

    Raises
    ------
    VirtualLabError
        If the layers with particles do not form one box, or dots lie in none of them.
    """

    def __init__(self, sensor: Sensor, particles: VirtualParticles | None = None):
        self.core_mm = CORE_HEIGHTS * sensor.height_mm
        dots = particles.dots if particles else None
        finer = DOT_FINER if dots else 1
        self.core_intervals, self.outer_intervals = finer * CORE_INTERVALS, finer * OUTER_INTERVALS
        if dots:
            self.low, self.high = dots_box(dots, sensor)
            self.heights = np.array([-dots.depth_mm])
            return
        boxes = gel_boxes(sensor)
        for (_, below), (above, _) in zip(boxes, boxes[1:]):
            if abs(below[2] - above[2]) > ROUNDING_MM:
                raise VirtualLabError(
                    f"layers with particles end at {below[2]:g} mm and begin at {above[2]:g} mm; synthesis interpolates in "
                    "one box: give the layer between them particles, or leave synthesis out"
                )
        # walls surround every layer but the top one: the narrowest layer
        self.low = np.max([low for low, _ in boxes], axis=0)
        self.high = np.min([high for _, high in boxes], axis=0)
        self.low[2], self.high[2] = boxes[0][0][2], boxes[-1][1][2]
        self.heights = np.linspace(self.low[2], self.high[2], 13)

    def lines(self, at: float, axis: int) -> np.ndarray:
        """Return the positions (n,) [mm] of the grid's lines along an axis with the indenter at a position [mm]."""
        # intervals grow towards the walls
        outer = np.linspace(0.0, 1.0, self.outer_intervals + 1)[1:] ** 1.5
        inner = np.linspace(0.0, 1.0, self.core_intervals // 2 + 1)
        sides = []
        for room in (at - self.low[axis], self.high[axis] - at):
            core = self.core_mm * np.tanh(room / (1.5 * self.core_mm))  # smooth in the place, always inside
            sides.append(np.concatenate([core * inner, core + (room - core) * outer]))
        return np.concatenate([at - sides[0][:0:-1], at + sides[1]])

    def index(self, points: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return the coordinates (P, 3) of points (P, 3) [mm] in units of grid lines, the indenter at (2,) [mm]."""
        lines = [self.lines(at[0], 0), self.lines(at[1], 1), self.heights]
        places = [np.interp(points[:, k], line, np.arange(len(line))) for k, line in enumerate(lines)]
        return np.column_stack(places)

    def field(self, cell: Cell) -> np.ndarray:
        """Return the displacement (S, nx, ny, nz, 3) [mm], float32, of a solved cell's steps on the grid about its place."""
        at = cell.attributes["x_mm"], cell.attributes["y_mm"]
        axes = [self.lines(at[0], 0), self.lines(at[1], 1), self.heights]
        axes = [  # inside the border, so that every point lies in an element
            np.clip(line, low + ROUNDING_MM, high - ROUNDING_MM)
            for line, low, high in zip(axes, self.low, self.high)
        ]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        weights = interpolation(cell.arrays["gel_node_mm"], cell.arrays["gel_hex"], points.reshape(-1, 3))
        moved = cell.arrays["gel_displacement_mm"]
        fields = [(weights @ one.astype(float)).reshape(points.shape) for one in moved]
        return np.stack(fields).astype(np.float32)


def turned_field(symmetry: str, field: np.ndarray) -> np.ndarray:
    """Return a field (..., nx, ny, nz, 3) carried by a symmetry of the square: that of the image of its press."""
    matrix = D4[symmetry]
    swapped = matrix[0, 0] == 0
    moved = np.swapaxes(field, -4, -3) if swapped else field
    signs = matrix.sum(axis=1)
    for axis, sign in zip((-4, -3), signs):
        moved = np.flip(moved, axis) if sign < 0 else moved
    horizontal = moved[..., 1::-1] if swapped else moved[..., :2]
    return np.concatenate([horizontal * signs.astype(field.dtype), moved[..., 2:]], axis=-1)


def displaced(field: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the displacement (P, 3) [mm] of a field (nx, ny, nz, 3) at coordinates (P, 3) in units of grid lines."""
    return np.column_stack(
        [map_coordinates(field[..., k], index.T, order=1, mode="nearest") for k in range(3)]
    )
