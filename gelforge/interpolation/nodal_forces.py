"""Nodal forces of a solved site as the indenter carries them, and their bins where it presses elsewhere.

Each node keeps its distance from the indenter's centre and the size of its own face, over which its force is spread by its
shape function. At another place the forces are binned as a solved site's are: nothing is resampled, and the bins add up to
the nodes' total.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import Indenter, Sensor
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.sensor.indenter_shapes import shape_of
from gelforge.indentation.sensor.symmetry import D4
from gelforge.mechanics.indenters.shapes import Sphere


@dataclass(frozen=True)
class NodalForces:
    """Forces of a solved site about its own position."""

    offset_mm: np.ndarray  # (S, 2) undeformed nodes from the site's position
    half_mm: np.ndarray  # (S,) half the width of a node's shape function
    force_N: np.ndarray  # (D, S, 6) normal and friction force

    @classmethod
    def of(cls, cell: Cell) -> NodalForces:
        """Return the nodes of a site that carry a force at any depth."""
        arrays = cell.arrays
        force = np.concatenate([arrays["node_normal_N"], arrays["node_shear_N"]], axis=-1)
        loaded = (force != 0).any(axis=(0, 2))
        place = np.array([cell.attributes["x_mm"], cell.attributes["y_mm"]])
        half = np.sqrt(arrays["node_area_mm2"][loaded])
        return cls(arrays["node_xy_mm"][loaded] - place, half, force[:, loaded])

    def mirrored(self, symmetry: str) -> NodalForces:
        """Return the forces of the site's image under a symmetry of the square."""
        return self.turned(D4[symmetry])

    def turned(self, matrix: np.ndarray) -> NodalForces:
        """Return the forces turned or mirrored about the site by an orthogonal matrix (2, 2)."""
        force = self.force_N.copy()
        for first in (0, 3):  # normal force, friction
            force[..., first : first + 2] = self.force_N[..., first : first + 2] @ matrix.T
        return replace(self, offset_mm=self.offset_mm @ matrix.T, force_N=force)

    def binned(
        self,
        position: np.ndarray,
        sensor: Sensor,
        depths: slice | list[int] = slice(None),
        scale: float = 1.0,
    ) -> np.ndarray:
        """Return normal and friction forces (d, ny, nx, 6) [N] per bin with the indenter at a position (2,) [mm].

        scale: of the nodes' distances from the indenter. What would lie beyond the surface goes into its outermost bins.
        """
        force = self.force_N[depths]
        bins = sensor.bins
        summed = np.zeros((len(force), bins.ny, bins.nx, 6))
        if not len(self.half_mm):
            return summed
        place, half = self.offset_mm * scale + position, self.half_mm * scale
        columns, along_x = _shares(place[:, 0], half, sensor.width_x_mm, bins.nx)
        rows, along_y = _shares(place[:, 1], half, sensor.width_y_mm, bins.ny)
        share = (along_y[:, :, None] * along_x[:, None, :]).reshape(len(place), -1)
        values = share.T @ np.moveaxis(force, 1, 0).reshape(len(place), -1)
        shape = (along_y.shape[1], along_x.shape[1], len(force), 6)
        summed[:, rows, columns] = np.moveaxis(values.reshape(shape), 2, 0)
        return summed


def ball_of(indenter: Indenter) -> Sphere | None:
    """Return an indenter's ball; None for any other shape.

    Parameters
    ----------
    indenter : Indenter
        Of the study.

    Returns
    -------
    Sphere or None
        Radius in mm.
    """
    shape = shape_of(indenter)
    return shape if isinstance(shape, Sphere) else None


def contact_width(ball: Sphere | None, depth: float) -> float:
    """Return how wide the contact is at a depth; only ratios of it have a meaning.

    Parameters
    ----------
    ball : Sphere or None
        As `ball_of` returns it.
    depth : float
        [mm].

    Returns
    -------
    float
        Radius [mm] of a ball's section at this height; 1 for other shapes, of which nothing is known.
    """
    return float(ball.section(depth)[0, 2]) if ball else 1.0


def _shares(at: np.ndarray, half: np.ndarray, width: float, n: int) -> tuple[slice, np.ndarray]:
    """Return the bins that hats at (S,) with half widths (S,) [mm] meet, and each hat's shares (S, m), which sum to 1."""
    edge = width / n
    first = int(np.clip(np.floor((at - half).min() / edge), 0, n - 1))
    last = int(np.clip(np.ceil((at + half).max() / edge), first + 1, n))
    inner = np.arange(first + 1, last) * edge
    u = np.clip((inner - at[:, None]) / half[:, None], -1.0, 1.0)
    below = np.where(u < 0, (1 + u) ** 2 / 2, 1 - (1 - u) ** 2 / 2)  # of a hat's integral, left of each edge
    none, ones = np.zeros((len(at), 1)), np.ones((len(at), 1))
    return slice(first, last), np.diff(np.hstack([none, below, ones]), axis=1)


def moved_map(values: np.ndarray, by: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return maps (..., ny, nx, 3) of bins moved by (2,) [mm]: the mean of what then lies over each bin."""
    bins = sensor.bins
    along_x = _overlap(by[0] / sensor.width_x_mm * bins.nx, bins.nx)
    along_y = _overlap(by[1] / sensor.width_y_mm * bins.ny, bins.ny)
    return np.moveaxis(along_y @ np.moveaxis(values, -1, -3) @ along_x.T, -3, -1)


def _overlap(shift: float, n: int) -> np.ndarray:
    """Return the share (n, n) of each bin that lies over each other one after a shift in bins."""
    apart = np.abs(np.arange(n)[:, None] - np.arange(n) - shift)
    return np.maximum(1.0 - apart, 0.0)
