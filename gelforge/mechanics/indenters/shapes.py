"""Rigid indenters: signed distance of surface points, its normal and the normal's turn.

An indenter has a frame of its own, whose origin the solver calls its centre. `distance` is negative inside; there it is
still the distance to the surface, because nodes penetrate while Newton's method iterates. Edges are rounded: at a sharp
one the normal jumps, and no iteration converges on a jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

DOWN = np.array([0.0, 0.0, -1.0])
# The edge of a soft contact lies at about this share of the depth (a half for Hertz's ball), and not a tenth further out.
SECTION, MARGIN = 0.6, 1.1

# Gaps, normals and turns of every shape against its surface (tests/mechanics/test_indenters.py):
SAMPLES = 65  # points along a side of the box around a shape whose projections sample its surface


# Of n points: gap (n,) [mm], normal (n, 3), turn (n, 3, 3) [1/mm]
Gaps = tuple[np.ndarray, np.ndarray, np.ndarray]


class Indenter:
    """What all shapes share; a shape defines distance and support, both in its own frame."""

    def distance(self, points: np.ndarray) -> Gaps:
        """Return gap (n,) [mm] (negative inside), normal (n, 3) = d gap/dx and its turn dn/dx (n, 3, 3) [1/mm]."""
        raise NotImplementedError

    def support(self, direction: np.ndarray) -> float:
        """Return the largest p . direction [mm] over the points p of the body."""
        raise NotImplementedError

    def vertical_gap(self, points: np.ndarray, centre: np.ndarray) -> Gaps:
        """Return the vertical gap, and the normal of the undeformed surface with its turn; a ball alone defines it."""
        raise NotImplementedError

    def gap(self, points: np.ndarray, centre: np.ndarray) -> Gaps:
        """Return gap, normal and turn of points (n, 3) [mm] for the indenter at centre (3,), or (6,) if it has turned.

        The last three of six numbers are a rotation vector [rad] about the centre.
        """
        if len(centre) == 3 or not centre[3:].any():
            return self.distance(points - centre[:3])
        return Turned(self, rotation_of(centre[3:])).distance(points - centre[:3])

    def start(self, x: float, y: float) -> np.ndarray:
        """Return the centre (3,) [mm] above (x, y) with the lowest point at the undeformed top surface z = 0."""
        return np.array([x, y, self.support(DOWN)])

    @property
    def size(self) -> float:
        """Half of the largest extent along an axis [mm]."""
        return max(self.support(axis) + self.support(-axis) for axis in np.eye(3)) / 2

    @cached_property
    def outline(self) -> np.ndarray:
        """Points (m, 3) [mm] all over the surface: projections of the box around a convex shape."""
        high = np.array([self.support(axis) for axis in np.eye(3)])
        low = -np.array([self.support(-axis) for axis in np.eye(3)])
        grid = np.stack(np.meshgrid(*[np.linspace(0, 1, SAMPLES)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        box = low + grid[((grid == 0) | (grid == 1)).any(axis=1)] * (high - low)
        gap, normal, _ = self.distance(box)
        return box - gap[:, None] * normal

    def section(self, depth: float) -> np.ndarray:
        """Return discs (n, 3) = (x, y, radius) [mm] about the centre that cover the body's part below this height."""
        height = self.outline[:, 2] + self.support(DOWN)
        below = height <= max(depth, height.min())
        return np.array(_discs(self.outline[below, :2]))

    def footprint(self, depth: float) -> np.ndarray:
        """Return discs (n, 3) = (x, y, radius) [mm] about the centre: where a flat surface is touched at this depth."""
        return self.section(SECTION * depth) * [1.0, 1.0, MARGIN]

    @cached_property
    def reach(self) -> float:
        """The height [mm] of the widest part over the lowest point: pressed deeper, the gel closes over it."""
        away = np.linalg.norm(self.outline[:, :2], axis=1)
        return float((self.outline[away > 0.99 * away.max(), 2] + self.support(DOWN)).max())


@dataclass(frozen=True)
class Sphere(Indenter):
    """A rigid ball of this radius [mm] about its centre."""

    radius: float

    def distance(self, points):
        r = np.linalg.norm(points, axis=-1)
        normal = points / r[:, None]
        turn = (np.eye(3) - normal[:, :, None] * normal[:, None, :]) / r[:, None, None]
        return r - self.radius, normal, turn

    def support(self, direction):
        return self.radius * float(np.linalg.norm(direction))

    def section(self, depth):
        depth = min(depth, self.radius)
        return np.array([[0.0, 0.0, np.sqrt(depth * (2 * self.radius - depth))]])

    @property
    def reach(self) -> float:
        return self.radius

    def vertical_gap(self, points: np.ndarray, centre: np.ndarray) -> Gaps:
        """Return the same with the vertical distance below the ball and the normal (0, 0, -1) of the undeformed surface.

        Points outside the ball's shadow are open by its centre's height above them.
        """
        d2 = ((points[:, :2] - centre[:2]) ** 2).sum(axis=-1)
        height = centre[2] - np.sqrt(np.maximum(self.radius**2 - d2, 0.0))
        normal = np.tile([0.0, 0.0, -1.0], (len(points), 1))
        return height - points[:, 2], normal, np.zeros((len(points), 3, 3))


@dataclass(frozen=True)
class Cylinder(Indenter):
    """A cylinder about z on its lower end, edges rounded; radius = length / 2 = edge would be a ball. Lengths in mm."""

    radius: float
    length: float
    edge: float  # radius of the rounded edges

    def distance(self, points):
        x, y, z = points.T
        rho = np.hypot(x, y)
        outward = np.zeros((len(points), 3))
        away = rho > 0
        outward[away, :2] = points[away, :2] / rho[away, None]
        outward[~away, 0] = 1.0  # on the axis every direction is as good
        up = np.zeros((len(points), 3))
        up[:, 2] = np.where(z < self.length / 2, -1.0, 1.0)
        half = self.length / 2
        beside, beyond = rho - (self.radius - self.edge), np.abs(z - half) - (half - self.edge)
        gap, slope, bend = _rounded(np.stack([beside, beyond], -1), self.edge)
        normal = slope[:, :1] * outward + slope[:, 1:] * up
        frame = np.stack([outward, up], axis=1)  # (n, 2, 3)
        turn = np.einsum("nai,nab,nbj->nij", frame, bend, frame)
        around = np.cross(up, outward)
        hoop = np.divide(slope[:, 0], rho, out=np.zeros_like(rho), where=away)
        return gap, normal, turn + hoop[:, None, None] * around[:, :, None] * around[:, None, :]

    def support(self, direction):
        dx, dy, dz = direction
        core = (self.radius - self.edge) * np.hypot(dx, dy) + (self.length / 2 - self.edge) * abs(dz)
        return float(core + self.length / 2 * dz + self.edge * np.linalg.norm(direction))


@dataclass(frozen=True)
class Box(Indenter):
    """A box on its lower face with rounded edges; sizes along x, y, z. Lengths in mm."""

    sizes: tuple[float, float, float]
    edge: float

    @property
    def _core(self) -> np.ndarray:
        return np.array(self.sizes) / 2 - self.edge

    @property
    def _middle(self) -> np.ndarray:
        return np.array([0.0, 0.0, self.sizes[2] / 2])

    def distance(self, points):
        p = points - self._middle
        side = np.where(p < 0, -1.0, 1.0)
        gap, slope, bend = _rounded(np.abs(p) - self._core, self.edge)
        return gap, side * slope, side[:, :, None] * bend * side[:, None, :]

    def support(self, direction):
        core = self._core @ np.abs(direction) + self._middle @ direction
        return float(core + self.edge * np.linalg.norm(direction))


@dataclass(frozen=True)
class Turned(Indenter):
    """A shape turned about its origin by a rotation matrix (3, 3)."""

    shape: Indenter
    rotation: np.ndarray

    def distance(self, points):
        R = self.rotation
        gap, normal, turn = self.shape.distance(points @ R)
        return gap, normal @ R.T, R @ turn @ R.T

    def support(self, direction):
        return self.shape.support(self.rotation.T @ direction)

    @cached_property
    def outline(self):
        return self.shape.outline @ self.rotation.T


@dataclass(frozen=True)
class Several(Indenter):
    """Shapes moved by offsets (n, 3) [mm] from the common centre and joined: the least gap counts.

    Where two shapes overlap the gap inside them is that to the nearer hidden face: keep contacts out of the overlap.
    """

    shapes: tuple[Indenter, ...]
    offsets: np.ndarray

    def distance(self, points):
        parts = [shape.distance(points - offset) for shape, offset in zip(self.shapes, self.offsets)]
        nearest = np.argmin([gap for gap, _, _ in parts], axis=0)
        rows = np.arange(len(points))
        return tuple(np.stack(values)[nearest, rows] for values in zip(*parts))

    def support(self, direction):
        return max(shape.support(direction) + offset @ direction for shape, offset in self._placed)

    @property
    def _placed(self):
        return list(zip(self.shapes, self.offsets))

    @cached_property
    def outline(self):
        return np.concatenate([shape.outline + offset for shape, offset in self._placed])

    def section(self, depth):
        lowest = self.support(DOWN)
        discs = [
            shape.section(below) + [*offset[:2], 0.0]
            for shape, offset in self._placed
            if (below := depth - (lowest + offset[2] - shape.support(DOWN))) >= -1e-12
        ]
        return np.concatenate(discs)

    @cached_property
    def reach(self) -> float:
        lowest = self.support(DOWN)
        return min(shape.reach + lowest + offset[2] - shape.support(DOWN) for shape, offset in self._placed)


def rotation_of(vector: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a rotation vector, by Rodrigues' formula.

    Parameters
    ----------
    vector : (3,) array
        Along the axis, as long as the angle [rad].

    Returns
    -------
    numpy.ndarray
        (3, 3).
    """
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


def rotation_about_axes(degrees: Sequence[float]) -> np.ndarray:
    """Return the rotation that turns about the fixed x, then y, then z axis.

    Parameters
    ----------
    degrees : sequence of 3 floats
        Angles [deg].

    Returns
    -------
    numpy.ndarray
        (3, 3).
    """
    turns = [rotation_of(np.radians(angle) * axis) for angle, axis in zip(degrees, np.eye(3))]
    return turns[2] @ turns[1] @ turns[0]


def _rounded(q: np.ndarray, edge: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return gap (n,), slope (n, k) and bend (n, k, k) from signed excesses q (n, k) over a core's faces, widened by edge.

    Outside the core the distance to it is |max(q, 0)|, inside the largest (least negative) excess decides.
    """
    outside = np.maximum(q, 0.0)
    r = np.linalg.norm(outside, axis=1)
    out = r > 0
    slope = np.zeros_like(q)
    slope[out] = outside[out] / r[out, None]
    slope[~out, q[~out].argmax(axis=1)] = 1.0
    bend = np.zeros((*q.shape, q.shape[1]))
    plane = np.einsum("na,ab->nab", (q[out] > 0).astype(float), np.eye(q.shape[1]))
    bend[out] = (plane - slope[out, :, None] * slope[out, None, :]) / r[out, None, None]
    return np.where(out, r, q.max(axis=1)) - edge, slope, bend


def _discs(points: np.ndarray) -> list[tuple[float, float, float]]:
    """Return discs (x, y, radius) around points (m, 2), cut across as long as they are much longer than wide."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, extent = (low + high) / 2, high - low
    radius = np.linalg.norm(points - middle, axis=1).max()
    long = int(np.argmax(extent))
    first = points[:, long] <= middle[long]
    # a section longer than two widths is covered by several discs
    if extent[long] <= 2.0 * extent[1 - long] or len(points) < 8 or first.all():
        return [(*middle, radius)]
    return _discs(points[first]) + _discs(points[~first])
