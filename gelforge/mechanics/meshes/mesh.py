"""Hexahedral meshes of a layered block with side wall and flange, fine under the contact.

Frame: x and y along the edges with the origin at a corner of the top surface, z = 0 at the undeformed top, up positive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from gelforge.mechanics.meshes.elements import lumped_area
from gelforge.mechanics.meshes.octree import octree

# Cells through the height that may be missing. Measured: a gel of 4 mm in three cells of 1.33 mm, where sizes of 1.2 mm ask
# for 3.33, is 1 % too stiff when a large ball squeezes it.
MISSING = 0.3


@dataclass(frozen=True)
class Block:
    """A layered block: what is meshed."""

    width_x: float  # mm
    width_y: float  # mm
    layers: tuple[tuple[str, float], ...]  # (name, thickness [mm]) from the base up
    wall: float = 0.0  # mm, around every layer but the top one
    flange_width: float = 0.0  # mm, on the base, outside the wall
    flange_height: float = 0.0  # mm
    base: float = 0.0  # mm, a slab below all of this, held at its own bottom
    base_is_rigid: bool = False  # the slab is held everywhere

    @property
    def height(self) -> float:
        return sum(thickness for _, thickness in self.layers)


@dataclass(frozen=True)
class Sizes:
    """Element sizes [mm]: `near` within near_radius of the contact, then growing with the distance up to about `far`.

    Within the body's height of that region a thin wall is meshed finer than its distance asks for.
    """

    near: float = 0.3
    near_radius: float = 3.6
    growth: float = 0.25  # d(size)/d(distance)
    far: float = 1.2
    envelope: float = 0.04  # mm: see stray
    # sizes through the thickness of a wall or a thin shell near the contact, which bends
    wall_parts: float = 2.0

    @property
    def halvings(self) -> int:
        """How often a cell of the base grid is halved to reach `near`."""
        return max(0, round(np.log2(self.far / self.near)))

    @property
    def stray(self) -> float:
        """How far a mesher of tetrahedra may stray from a surface before nodes are moved onto it [mm]."""
        return min(self.envelope, self.near / 6)

    @property
    def base(self) -> float:
        """The size of the base grid [mm], nearest to `far`, whose halves end at `near`."""
        return self.near * 2**self.halvings

    def through(self, height: float) -> float:
        """Return how many sizes lie one below another from the contact to a depth of height [mm]."""
        far = max(self.far, self.near)
        graded = min(height, (far - self.near) / self.growth)
        return float(np.log1p(self.growth * graded / self.near) / self.growth + (height - graded) / far)

    def at_wall(self, wall: float) -> float:
        """Return the size [mm] through a wall near the contact."""
        return max(wall / self.wall_parts, self.near)

    def through_wall(self, wall: float) -> float:
        """Return how many sizes lie side by side through a wall [mm] near the contact."""
        return wall / min(self.at_wall(wall), max(self.far, self.near))


@dataclass(frozen=True)
class Surface:
    """The part of the boundary that an indenter may touch: flat four-sided faces, or triangles with edge middles.

    A node that hangs carries no contact of its own: what it would carry belongs to the nodes it hangs between.
    """

    nodes: np.ndarray  # (S,) numbers of the nodes that do not hang
    area: np.ndarray  # (S,) [mm^2] each node's share of the undeformed faces (elements.lumped_area), positive
    top: np.ndarray  # (S,) bool, nodes of the top surface (z = 0); the others lie on the sides
    # (Q, 4) corners, or (Q, 6) corners and edge middles, of the top surface's faces, hanging ones included
    faces: np.ndarray


@dataclass(frozen=True)
class Mesh:
    """Elements of one kind with regions, fixed nodes and the surface that is touched."""

    X: np.ndarray  # (N, 3) nodes [mm]
    elements: np.ndarray  # (E, 8) hexahedra or (E, 10) tetrahedra, nodes in meshio's order
    region: np.ndarray  # (E,) index into regions
    regions: tuple[str, ...]
    fixed: np.ndarray  # (N,) bool, nodes held on the base
    surface: Surface
    # (N, N) values at all nodes from those that do not hang; None: no node hangs
    ties: sp.csr_matrix | None = None

    @property
    def hanging(self) -> np.ndarray:
        """Return which nodes (N,) hang on others."""
        if self.ties is None:
            return np.zeros(len(self.X), bool)
        return np.diff(self.ties.indptr) > 1


def _spaced(breaks: list[float], size: float, missing: float = math.inf) -> np.ndarray:
    """Return increasing lines through all breaks, evenly spaced by about size between two of them.

    missing: the cells by which there may be fewer than the whole length over size.
    """
    lengths = np.diff(breaks)
    parts = np.array([max(1, round(length / size)) for length in lengths])
    while parts.sum() < lengths.sum() / size - missing:
        parts[np.argmax(lengths / parts)] += 1
    pieces = [np.linspace(a, b, n + 1)[1:] for a, b, n in zip(breaks[:-1], breaks[1:], parts)]
    return np.concatenate([[breaks[0]], *pieces])


def _horizontal_lines(width: float, block: Block, centre: float, size: float) -> np.ndarray:
    inner = {block.wall, width - block.wall} if block.wall else set()
    outer = {-block.flange_width, width + block.flange_width} if block.flange_width else set()
    breaks = sorted({0.0, width} | inner | outer)
    # A line through the contact: every cell of a study then sees the same pattern of elements under its contact.
    if min(abs(centre - place) for place in breaks) > size / 2:
        breaks = sorted([*breaks, centre])
    return _spaced(breaks, size)


def _vertical_lines(block: Block, sizes: Sizes) -> np.ndarray:
    size = sizes.base
    heights = np.cumsum([0.0] + [thickness for _, thickness in block.layers]) - block.height
    heights[-1] = 0.0
    breaks, flange_top = list(heights), block.flange_height - block.height
    # A second break one rounding off an interface would make a layer of elements without thickness.
    if block.flange_width and np.abs(heights - flange_top).min() > 1e-9:
        breaks = sorted([*breaks, flange_top])
    lines = _spaced(breaks, size, MISSING)
    return np.concatenate([_slab_lines(block, sizes), lines])


def _slab_lines(block: Block, sizes: Sizes) -> np.ndarray:
    """Return the lines of the slab below its top, bottom first: as far apart as their distance from the contact allows."""
    z, lines = 0.0, []
    while block.base - z > 1e-9:
        step = max(sizes.base, sizes.near + sizes.growth * (block.height + z))
        parts = max(1, round((block.base - z) / step))
        z = block.base if parts == 1 else z + step
        lines.append(-block.height - z)
    return np.array(lines[::-1])


def layered_block(block: Block, x: float, y: float, sizes: Sizes, touched: np.ndarray | None = None) -> Mesh:
    """Return the mesh of a block, fine around the contact; cells of an even grid are halved where the contact wants it.

    Parameters
    ----------
    block : Block
        Widths, layers, wall, flange and base [mm].
    x, y : float
        Where it is pressed [mm].
    sizes : Sizes
        Of the elements [mm].
    touched : (n, 3) array, optional
        Discs (x, y, radius) [mm] of the top surface, none of which counts for smaller than near_radius; the disc of that
        radius at (x, y) if not given.

    Returns
    -------
    Mesh
        Regions are the layers by name, then "wall", "flange" and "base" where they exist; cells above the flange are left
        out.
    """
    lines = (
        _horizontal_lines(block.width_x, block, x, sizes.base),
        _horizontal_lines(block.width_y, block, y, sizes.base),
        _vertical_lines(block, sizes),
    )
    cells = tuple((line[1:] + line[:-1]) / 2 for line in lines)
    region, names, present = _regions(block, *cells)
    touched = np.array([[x, y, 0.0]]) if touched is None else touched

    def wanted(*finer):
        return _too_large(block, sizes, touched, *finer)

    tree = octree(lines, present, wanted, sizes.halvings)
    X = tree.X
    return Mesh(
        X=X,
        elements=tree.hexahedra,
        region=region[tuple(tree.base_cell.T)].astype(np.int32),
        regions=names,
        fixed=X[:, 2] < (-block.height if block.base_is_rigid else lines[2][0]) + 1e-9,
        surface=_surface(block, X, tree.hexahedra, tree.ties),
        ties=tree.ties if sizes.halvings else None,
    )


def _regions(block: Block, x: np.ndarray, y: np.ndarray, z: np.ndarray):
    """Return region (nx, ny, nz), its names and which cells are present, of the base cells with these middles [mm]."""
    outside_x, outside_y = (x < 0) | (x > block.width_x), (y < 0) | (y > block.width_y)
    outside = (outside_x[:, None] | outside_y[None, :])[:, :, None]
    wall_x, wall_y = _in_wall(x, block.width_x, block.wall), _in_wall(y, block.width_y, block.wall)
    in_wall = (wall_x[:, None] | wall_y)[:, :, None]
    names = [name for name, _ in block.layers]
    interfaces = np.cumsum([thickness for _, thickness in block.layers])[:-1] - block.height
    region = np.broadcast_to(np.searchsorted(interfaces, z), (len(x), len(y), len(z))).copy()
    if block.wall and len(block.layers) > 1:  # it stands around the lower layers
        region[in_wall & (region < len(block.layers) - 1)] = len(names)
        names.append("wall")
    if block.flange_width:
        region[np.broadcast_to(outside, region.shape)] = len(names)
        names.append("flange")
    if block.base:
        region[:, :, z < -block.height] = len(names)
        names.append("base")
    return region, tuple(names), ~outside | (z < block.flange_height - block.height)


def _in_wall(at: np.ndarray, width: float, wall: float) -> np.ndarray:
    """Return which places along an axis lie in the wall at either end, or beyond it."""
    return (at < wall) | (at > width - wall)


def _too_large(block: Block, sizes: Sizes, touched: np.ndarray, *lines: np.ndarray) -> np.ndarray:
    """Return which cells (nx, ny, nz) between the lines are larger than the contact on the touched discs wants."""
    mid = [(line[1:] + line[:-1]) / 2 for line in lines]
    half = [np.diff(line) / 2 for line in lines]
    # Horizontal and vertical distance from the nearest point of a cell to the nearest disc that is touched.
    radial = np.full((len(mid[0]), len(mid[1])), np.inf)
    for *place, radius in touched:
        dx, dy = (np.maximum(np.abs(m - c) - h, 0) for m, h, c in zip(mid, half, place))
        beyond = np.maximum(np.hypot(dx[:, None], dy[None, :]) - max(radius, sizes.near_radius), 0)
        radial = np.minimum(radial, beyond)
    below = np.maximum(-mid[2] - half[2], 0)
    distance = np.hypot(radial[:, :, None], below[None, None, :])
    size = 2 * np.maximum(np.maximum(half[0][:, None], half[1][None, :])[:, :, None], half[2])
    # The lines meet walls and interfaces, so cells are up to a few tenths larger or smaller than asked for.
    large = size > 1.4 * (sizes.near + sizes.growth * distance)
    if block.wall and len(block.layers) > 1:
        # With one eight-node element through a wall that bends Fx 5 mm away is 6 % too small (docs/accuracy.md).
        thin = sizes.at_wall(block.wall) + sizes.growth * np.maximum(radial - block.height, 0)
        through_x, through_y = (
            np.where(_in_wall(m, width, block.wall), 2 * h, 0.0)
            for m, h, width in zip(mid, half, (block.width_x, block.width_y))
        )
        large |= (np.maximum(through_x[:, None], through_y[None, :]) > 1.4 * thin)[:, :, None]
    return large


def _surface(block: Block, X: np.ndarray, hexahedra: np.ndarray, ties: sp.csr_matrix) -> Surface:
    """Return the top and the outer sides of the block."""
    flange_top = block.flange_height - block.height if block.flange_width else -np.inf
    if block.base:  # its sides are no place of contact
        flange_top = max(flange_top, -block.height)
    faces, tops = [], []
    for corners, axis, place in [
        ((4, 5, 6, 7), 2, 0.0),
        ((0, 3, 7, 4), 0, 0.0),
        ((1, 2, 6, 5), 0, block.width_x),
        ((0, 1, 5, 4), 1, 0.0),
        ((3, 2, 6, 7), 1, block.width_y),
    ]:
        face = hexahedra[:, corners]
        outside = np.isclose(X[face, axis], place, atol=1e-9).all(axis=1)
        outside &= X[face, 2].mean(axis=1) > flange_top
        faces.append(face[outside])
        tops.append(np.full(outside.sum(), axis == 2))
    top = np.concatenate(tops)
    area = ties.T @ lumped_area(X, np.concatenate(faces))
    nodes = np.flatnonzero(area > 0)
    on_top = np.isin(nodes, np.flatnonzero(X[:, 2] > -1e-9))
    return Surface(nodes, area[nodes], on_top, np.concatenate(faces)[top])
