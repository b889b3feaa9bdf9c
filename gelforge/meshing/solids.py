"""What is meshed: named solids, each inside a closed surface, on a rigid base.

Frame: z = 0 at the highest point of the undeformed body, up positive; x and y from a corner of the rectangle around it.
A point belongs to the first solid whose surface encloses it, so solids are listed from the inside out; slabs that touch
enclose nothing of one another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.mechanics.indenters.closed_surface import ClosedSurface, SurfaceError, closed_surface
from gelforge.mechanics.meshes.mesh import Block, Sizes
from gelforge.mechanics.meshes.octree import CORNERS

# mm between the points of a dome's surface: its faces lie 0.3^2 / (8 x 11) = 1e-3 mm inside a dome of radius 11 mm
# (tests/meshing/test_solids.py).
DOME_STEP = 0.3


@dataclass(frozen=True)
class Solids:
    """Named solids from the inside out: each lies in later ones, or touches others, or stands on the base (layout.py)."""

    names: tuple[str, ...]
    surfaces: tuple[ClosedSurface, ...]  # on which nodes lie
    # (vertices, triangles) for the mesher: the same within its envelope
    drafts: tuple[tuple[np.ndarray, np.ndarray], ...]
    base: float  # z of the rigid base [mm]; boundary nodes at or below it are held

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and greatest x, y, z (3,) [mm] of all surfaces."""
        ends = [(s.vertices.min(axis=0), s.vertices.max(axis=0)) for s in self.surfaces]
        return np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)


def enclosed_volume(surface: ClosedSurface) -> float:
    """Return the volume [mm^3] inside; where a surface overlaps itself the overlap counts twice."""
    corner = surface.vertices[surface.triangles] - surface.vertices.mean(axis=0)
    return float(np.linalg.det(corner).sum() / 6)


def area(surface: ClosedSurface) -> float:
    """Return the area [mm^2] of a surface."""
    a, b, c = (surface.vertices[surface.triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def given_solids(surfaces: dict[str, ClosedSurface], base: float) -> Solids:
    """Return solids of given surfaces by name, from the inside out.

    Parameters
    ----------
    surfaces : dict of str to ClosedSurface
        By name, from the inside out [mm].
    base : float
        z of the rigid base [mm].

    Returns
    -------
    Solids
        With the surfaces themselves as drafts.
    """
    drafts = tuple((surface.vertices, surface.triangles) for surface in surfaces.values())
    return Solids(tuple(surfaces), tuple(surfaces.values()), drafts, base)


def block_solids(block: Block) -> Solids:
    """Return the layers of a block: boxes inside the wall, and the whole of it as the top layer, which is the wall too.

    Parameters
    ----------
    block : Block
        Sizes [mm].

    Returns
    -------
    Solids
        In the block's order of layers, the base at z = -height [mm].
    """
    heights = np.cumsum([0.0] + [thickness for _, thickness in block.layers]) - block.height
    boxes = [
        _box([block.wall, block.wall, low], [block.width_x - block.wall, block.width_y - block.wall, high])
        for low, high in zip(heights[:-2], heights[1:-1])
    ]
    boxes.append(_box([0.0, 0.0, heights[0]], [block.width_x, block.width_y, 0.0]))
    names = tuple(name for name, _ in block.layers)
    return Solids(names, tuple(closed_surface(*box) for box in boxes), tuple(boxes), float(heights[0]))


def dome_solids(
    width_x: float, width_y: float, layers: tuple[tuple[str, float], ...], envelope: float = Sizes.envelope
) -> Solids:
    """Return a half-ellipsoid on its flat base: a core under layers of constant thickness.

    Inner surfaces are parallel to the outer one.

    Parameters
    ----------
    width_x, width_y : float
        Of the base [mm].
    layers : tuple of (str, float)
        Name and thickness [mm] at the top, from the base up.
    envelope : float
        Of the mesher [mm]; its drafts are as coarse as this lets them be.

    Returns
    -------
    Solids
        The base at z = -height [mm].

    Raises
    ------
    SurfaceError
        Where the layers over the core are as thick as the dome's smallest radius of curvature, or thicker.
    """
    height = sum(thickness for _, thickness in layers)
    axes = np.array([width_x / 2, width_y / 2, height])
    sharpest = axes.min() ** 2 / axes.max()
    offsets = [sum(thickness for _, thickness in layers[k + 1 :]) for k in range(len(layers))]
    if offsets[0] >= sharpest:
        raise SurfaceError(
            f"the layers over the core are {offsets[0]:g} mm thick, the dome's smallest radius of curvature is "
            f"{sharpest:.3g} mm: no surface parallel to the dome lies there; make them thinner or the dome rounder"
        )
    surfaces = tuple(closed_surface(*_dome(axes, offset, DOME_STEP)) for offset in offsets)
    # 1.2 mm for the mesher in an envelope of 0.04 mm, which it follows within that only
    step = 1.2 * np.sqrt(envelope / Sizes.envelope)  # a chord's distance from its curve goes with its square
    drafts = tuple(_dome(axes, offset, step) for offset in offsets)
    return Solids(tuple(name for name, _ in layers), surfaces, drafts, -height)


def _box(low, high) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    faces = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    a, b, c, d = faces.T
    return low + CORNERS * (high - low), np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])


def _dome(axes: np.ndarray, offset: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of the surface `offset` [mm] inside the upper half-ellipsoid with these half axes.

    Rings of 6 k points about the top (z = 0), about `step` [mm] apart, and a flat base.
    """
    rings = max(4, int(np.ceil(np.pi / 2 * axes.max() / step)))
    points, faces, start = [np.array([[0.0, 0.0, 1.0]])], [], [0]
    for k in range(1, rings + 1):
        down, around = np.pi / 2 * k / rings, 2 * np.pi * np.arange(6 * k) / (6 * k)
        start.append(start[-1] + max(1, 6 * (k - 1)))
        level = np.sin(down) * np.stack([np.cos(around), np.sin(around)], axis=-1)
        # cos(pi/2) is not exactly zero in floating point, the base is.
        points.append(np.column_stack([level, np.full(6 * k, 0.0 if k == rings else np.cos(down))]))
        inner, outer = max(1, 6 * (k - 1)), 6 * k
        for side in range(6):
            j = np.arange(k)
            a = start[k] + (side * k + j) % outer
            b = start[k] + (side * k + j + 1) % outer
            c = start[k - 1] + (side * (k - 1) + j) % inner
            d = start[k - 1] + (side * (k - 1) + j + 1) % inner
            faces += [np.stack([c, a, b], -1), np.stack([c, b, d], -1)[:-1]]
    sphere = np.concatenate(points)
    normal = sphere / axes
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    vertices = sphere * axes - offset * normal
    rim = start[rings] + np.arange(6 * rings)
    base = np.stack([np.full(len(rim), len(vertices)), np.roll(rim, -1), rim], axis=-1)
    vertices = np.concatenate([vertices, [[0.0, 0.0, 0.0]]]) + [axes[0], axes[1], -axes[2]]
    return vertices, np.concatenate([*faces, base])
