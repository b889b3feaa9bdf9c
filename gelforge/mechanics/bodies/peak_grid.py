"""The largest energy density that each place of a body has seen, on a grid that stays while meshes change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree


@dataclass(frozen=True)
class Box:
    """Grid points (nx, ny, nz) evenly over a box, with a value each."""

    low: np.ndarray  # (3,) mm
    high: np.ndarray  # (3,) mm
    values: np.ndarray  # (nx, ny, nz) MPa

    @property
    def points(self) -> np.ndarray:
        """Return the grid points (nx ny nz, 3) [mm]."""
        lines = [np.linspace(a, b, n) for a, b, n in zip(self.low, self.high, self.values.shape)]
        return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Return the values (n,) at points (n, 3) [mm], linear between grid points, those of the rim outside."""
        place = (points - self.low) / (self.high - self.low) * (np.array(self.values.shape) - 1)
        return map_coordinates(self.values, place.T, order=1, mode="nearest")


@dataclass(frozen=True)
class PeakGrid:
    """A box of grid points for each region that softens: values do not leak from one material into another."""

    boxes: Mapping[str, Box]

    @classmethod
    def empty(cls, extents: Mapping[str, tuple[np.ndarray, np.ndarray]], spacing: float, regions) -> PeakGrid:
        """Return the grid of a body that nobody has pressed; extents are lowest and highest corner of each region [mm]."""
        boxes = {}
        for name in regions:
            low, high = (np.asarray(corner, dtype=float) for corner in extents[name])
            shape = np.maximum(2, np.ceil((high - low) / spacing - 1e-9).astype(int) + 1)
            boxes[name] = Box(low, high, np.zeros(shape))
        return cls(boxes)

    def read(self, points: np.ndarray, region: np.ndarray, regions: tuple[str, ...]) -> np.ndarray:
        """Return the peaks (E, Q) [MPa] at quadrature points (E, Q, 3) [mm] of elements of these regions (E,)."""
        peak = np.zeros(points.shape[:2])
        for name, box in self.boxes.items():
            inside = region == regions.index(name)
            peak[inside] = box.at(points[inside].reshape(-1, 3)).reshape(-1, points.shape[1])
        return peak

    def updated(
        self,
        points: np.ndarray,
        region: np.ndarray,
        regions: tuple[str, ...],
        before: np.ndarray,
        after: np.ndarray,
    ) -> PeakGrid:
        """Return the grid after an indentation that has raised peaks (E, Q) [MPa], as they were read, from before to after.

        Only what was raised is added: an indentation that raises nothing leaves the grid as it is, so that reading and
        writing again and again spreads nothing.
        """
        boxes = {}
        for name, box in self.boxes.items():
            inside = region == regions.index(name)
            more = _continued(points[inside], (after - before)[inside], box.points)
            boxes[name] = replace(box, values=box.values + more.reshape(box.values.shape))
        return PeakGrid(boxes)


def _continued(points: np.ndarray, values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return values (m,) at places (m, 3) [mm] of functions that elements continue from values (E, Q) at points (E, Q, 3).

    Linear through four points, trilinear through eight: exact there; kept between half of the least and twice the largest
    value of the element. A place takes the mean over the elements of its nearest points, the nearer the more.
    """
    Q = points.shape[1]
    middle = points.mean(axis=1)
    size = np.abs(points - middle[:, None]).max(axis=1)  # (E, 3)
    functions = np.linalg.pinv(_basis((points - middle[:, None]) / size[:, None])[..., :Q])  # (E, Q, Q)
    coefficients = np.einsum("epq,eq->ep", functions, values)
    # a grid point listens to the elements of the nearest quadrature points
    distance, nearest = cKDTree(points.reshape(-1, 3)).query(places, k=8)
    element = nearest // Q  # (m, k)
    at = _basis((places[:, None] - middle[element]) / size[element])[..., :Q]
    peaks = np.einsum("mkp,mkp->mk", at, coefficients[element])
    peaks = np.clip(peaks, 0.5 * values.min(axis=1)[element], 2 * values.max(axis=1)[element])
    weight = 1 / (distance + 0.1 * distance.mean(axis=1, keepdims=True)) ** 2
    return (weight * peaks).sum(axis=1) / weight.sum(axis=1)


def _basis(x: np.ndarray) -> np.ndarray:
    """Return 1, x, y, z, xy, yz, xz, xyz (..., 8) of x (..., 3)."""
    products = [x[..., i] * x[..., j] for i, j in ((0, 1), (1, 2), (0, 2))]
    return np.stack([np.ones(x.shape[:-1]), *np.moveaxis(x, -1, 0), *products, x.prod(axis=-1)], axis=-1)
