"""Conforming hexahedral meshes of a layered block with side wall and flange, fine under the contact.

Frame: x and y along the edges with the origin at a corner of the top surface, z = 0 at the undeformed top, up positive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Block:
    """A layered block: what is meshed."""

    width_x: float  # mm
    width_y: float  # mm
    layers: tuple[tuple[str, float], ...]  # (name, thickness [mm]) from the base up
    wall: float = 0.0  # mm, around every layer but the top one
    flange_width: float = 0.0  # mm, on the base, outside the wall
    flange_height: float = 0.0  # mm

    @property
    def height(self) -> float:
        return sum(thickness for _, thickness in self.layers)


@dataclass(frozen=True)
class Sizes:
    """Element sizes of the graded mesh [mm]; growth is d(size)/d(distance) + 1."""

    near: float = 0.5
    near_radius: float = 3.6
    far: float = 1.5
    growth: float = 1.35
    vertical_far: float = 0.8
    vertical_growth: float = 1.15
    wall_elements: int = 1  # least number through a wall that the fine region touches


@dataclass(frozen=True)
class HexMesh:
    """Hexahedra with regions, fixed nodes and a top surface that is a tensor grid of lines."""

    X: np.ndarray  # (N, 3) nodes [mm]
    hexahedra: np.ndarray  # (E, 8)
    region: np.ndarray  # (E,) index into regions
    regions: tuple[str, ...]
    fixed: np.ndarray  # (N,) bool, nodes held on the base
    surface: np.ndarray  # (S,) nodes of the top surface, x fastest
    surface_x: np.ndarray  # (nx,) lines of the top surface [mm]
    surface_y: np.ndarray  # (ny,)

    @property
    def surface_area(self) -> np.ndarray:
        """The undeformed area (S,) [mm^2] of each surface node: the integral of its shape function."""
        return np.outer(_hat_integral(self.surface_y), _hat_integral(self.surface_x)).ravel()


def _hat_integral(lines: np.ndarray) -> np.ndarray:
    size = np.diff(lines)
    return (np.append(size, 0) + np.insert(size, 0, 0)) / 2


def _subdivide(
    start: float, stop: float, size: Callable[[np.ndarray], np.ndarray], least: int = 1
) -> np.ndarray:
    """Return points from start to stop (start excluded) spaced as size(x) asks for, as evenly as it allows."""
    x = np.linspace(start, stop, 401)
    density = 1 / size(x)
    count = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(x))])
    n = max(least, round(count[-1]))
    points = np.interp(np.arange(1, n + 1) * count[-1] / n, count, x)
    points[-1] = stop
    return points


def graded_lines(
    breaks: list[float], size: Callable[[np.ndarray], np.ndarray], least: list[int]
) -> np.ndarray:
    """Return increasing lines through all breaks, graded by size(x); least[i] elements between breaks i and i + 1."""
    lines = [np.array([breaks[0]])]
    for a, b, n in zip(breaks[:-1], breaks[1:], least):
        lines.append(_subdivide(a, b, size, n))
    return np.concatenate(lines)


def _horizontal_lines(width: float, block: Block, centre: float, sizes: Sizes) -> np.ndarray:
    def size(x):
        distance = np.maximum(0.0, np.abs(x - centre) - sizes.near_radius)
        return np.minimum(sizes.near + (sizes.growth - 1) * distance, sizes.far)

    inner = {block.wall, width - block.wall} if block.wall else set()
    outer = {-block.flange_width, width + block.flange_width} if block.flange_width else set()
    breaks = sorted({0.0, width} | inner | outer)
    least = []
    for a, b in zip(breaks[:-1], breaks[1:]):
        is_wall = block.wall > 0 and np.isclose(b - a, block.wall) and a > -1e-9 and b < width + 1e-9
        near = min(abs(a - centre), abs(b - centre)) < 2 * sizes.near_radius
        least.append(sizes.wall_elements if is_wall and near else 1)
    return graded_lines(breaks, size, least)


def _vertical_lines(block: Block, sizes: Sizes) -> np.ndarray:
    top_layer = block.layers[-1][1]

    def size(z):
        below = np.maximum(0.0, -z - top_layer)
        return np.minimum(sizes.near + (sizes.vertical_growth - 1) * below, sizes.vertical_far)

    heights = np.cumsum([0.0] + [thickness for _, thickness in block.layers]) - block.height
    heights[-1] = 0.0
    breaks, flange_top = list(heights), block.flange_height - block.height
    # A second break one rounding beside an interface would make a layer of elements without thickness.
    if block.flange_width and np.abs(heights - flange_top).min() > 1e-9:
        breaks = sorted([*breaks, flange_top])
    return graded_lines(breaks, size, [1] * (len(breaks) - 1))


def layered_block(block: Block, x: float, y: float, sizes: Sizes) -> HexMesh:
    """Return the mesh of a block, fine around the contact at (x, y) [mm].

    Regions are the layers by name, then "wall" and "flange" where they exist; elements above the flange are left out.
    """
    lx, ly = (
        _horizontal_lines(block.width_x, block, x, sizes),
        _horizontal_lines(block.width_y, block, y, sizes),
    )
    lz = _vertical_lines(block, sizes)
    nx, ny, nz = len(lx), len(ly), len(lz)

    node = np.arange(nx * ny * nz).reshape(nz, ny, nx)
    z, yy, xx = np.meshgrid(lz, ly, lx, indexing="ij")
    X = np.stack([xx, yy, z], axis=-1).reshape(-1, 3)
    bottom = [node[:-1, :-1, :-1], node[:-1, :-1, 1:], node[:-1, 1:, 1:], node[:-1, 1:, :-1]]
    top = [node[1:, :-1, :-1], node[1:, :-1, 1:], node[1:, 1:, 1:], node[1:, 1:, :-1]]
    hexahedra = np.stack(bottom + top, axis=-1).reshape(-1, 8)

    mid = X[hexahedra].mean(axis=1)
    outside = (mid[:, 0] < 0) | (mid[:, 0] > block.width_x) | (mid[:, 1] < 0) | (mid[:, 1] > block.width_y)
    in_wall = (
        (mid[:, 0] < block.wall)
        | (mid[:, 0] > block.width_x - block.wall)
        | (mid[:, 1] < block.wall)
        | (mid[:, 1] > block.width_y - block.wall)
    )
    names = [name for name, _ in block.layers]
    interfaces = np.cumsum([thickness for _, thickness in block.layers])[:-1] - block.height
    region = np.searchsorted(interfaces, mid[:, 2])
    if block.wall:
        region[in_wall & (region < len(block.layers) - 1)] = len(names)
        names.append("wall")
    if block.flange_width:
        region[outside] = len(names)
        names.append("flange")
    keep = ~outside | (mid[:, 2] < block.flange_height - block.height)
    hexahedra, region = hexahedra[keep], region[keep]

    used = np.unique(hexahedra)
    number = np.full(len(X), -1)
    number[used] = np.arange(len(used))
    on_top_x = (lx > -1e-9) & (lx < block.width_x + 1e-9)
    on_top_y = (ly > -1e-9) & (ly < block.width_y + 1e-9)
    surface = number[node[-1][np.ix_(on_top_y, on_top_x)].ravel()]
    X = X[used]
    return HexMesh(
        X=X,
        hexahedra=number[hexahedra].astype(np.int32),
        region=region.astype(np.int32),
        regions=tuple(names),
        fixed=X[:, 2] < lz[0] + 1e-9,
        surface=surface,
        surface_x=lx[on_top_x],
        surface_y=ly[on_top_y],
    )
