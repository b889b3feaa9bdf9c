"""An indenter bounded by any closed surface of triangles: signed distance with the sign of consistent pseudo-normals.

Baerentzen & Aanaes 2005, doi 10.1109/TVCG.2005.49: the vector from the nearest point of the surface, on the pseudo-normal
of the face, edge or corner on which that point lies, has the sign of the distance. The nearest point is found in a
tree of boxes, on each triangle after Ericson 2005, Real-Time Collision Detection, section 5.1.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numba as nb
import numpy as np

from gelforge.mechanics.indenters.shapes import SAMPLES, Indenter

# Neighbouring faces that turn by less than about 20 degrees stand for a smooth surface: its corners move along their normal
# only. Ratio of the eigenvalues of sum n n^T, tan(20 deg / 2)^2 = 0.031 of two equal faces
# (tests/mechanics/test_indenters.py: a block and a ball of triangles).
SMOOTH = 0.03


class SurfaceError(ValueError):
    """A surface that bounds no body: what was found, what to do."""


class BoxTree(NamedTuple):
    """Triangles in a tree of boxes, halved at the median of their middles along the longest side.

    Box k with held > 0 is a leaf with the triangles first to first + held; else its halves are boxes first and first + 1.
    """

    corner: np.ndarray  # (T, 3, 3) [mm] in the tree's order
    pseudo: np.ndarray  # (T, 7, 3) pseudo-normals
    low: np.ndarray  # (boxes, 3) [mm]
    high: np.ndarray  # (boxes, 3) [mm]
    first: np.ndarray  # (boxes,)
    held: np.ndarray  # (boxes,) count of triangles


@dataclass(frozen=True)
class ClosedSurface(Indenter):
    """A body bounded by triangles (T, 3) between vertices (V, 3) [mm], outward to the right, its edges rounded.

    The faces are moved inward by `edge` and the body that is left is widened by it again: faces stay, convex edges and
    corners become round. Raises SurfaceError where a feature is thinner than that.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    edge: float = 0.0  # mm
    _core: np.ndarray = field(init=False, repr=False, compare=False)  # (V, 3) vertices inset by the edge
    _tree: BoxTree = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        core = _inset(self.vertices, self.triangles, self.edge)
        object.__setattr__(self, "_core", core)
        tree = _box_tree(core[self.triangles], _pseudo_normals(core, self.triangles))
        object.__setattr__(self, "_tree", tree)

    def distance(self, points):
        gap, normal, turn = _distances(np.ascontiguousarray(points, dtype=float), self._tree)
        return gap - self.edge, normal, turn

    def support(self, direction):
        return float((self._core @ direction).max() + self.edge * np.linalg.norm(direction))

    @cached_property
    def outline(self):
        corner = self.vertices[self.triangles]
        spacing = np.ptp(self.vertices, axis=0).max() / (SAMPLES - 1)
        longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=-1).max(axis=1)
        pieces = np.ceil(longest / spacing).astype(int)
        points = []
        for parts in np.unique(pieces):
            i, j = (w.ravel() for w in np.meshgrid(*[np.arange(parts + 1)] * 2, indexing="ij"))
            weight = (np.stack([parts - i - j, i, j], axis=-1) / parts)[i + j <= parts]
            points.append(np.einsum("wk,tki->twi", weight, corner[pieces == parts]).reshape(-1, 3))
        sharp = np.concatenate(points)
        gap, normal, _ = self.distance(sharp)
        return sharp - gap[:, None] * normal


def closed_surface(vertices: np.ndarray, triangles: np.ndarray, edge: float = 0.0) -> ClosedSurface:
    """Return the body inside triangles as a file gives them: corners joined, turned outwards, checked.

    Parameters
    ----------
    vertices : numpy.ndarray
        (V, 3) [mm].
    triangles : numpy.ndarray
        (T, 3) int, rows of vertices.
    edge : float
        Element size [mm] that the surface is to be used with; 0 where it does not matter.

    Returns
    -------
    ClosedSurface
        With distance and normal.

    Raises
    ------
    SurfaceError
        Where an edge does not have two triangles, one in each direction; the message counts them.
    """
    size = np.ptp(vertices, axis=0).max()
    _, kept, joined = np.unique(
        # corners of an STL's triangles a millionth of the surface's size apart are one
        np.rint((vertices - vertices.min(axis=0)) / (1e-6 * size)).astype(np.int64),
        axis=0, return_index=True, return_inverse=True,
    )  # fmt: skip
    vertices, triangles = vertices[kept], joined.reshape(-1)[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, uses = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    if (uses != 2).any() or not len(triangles):
        raise SurfaceError(
            f"the surface is not closed: {(uses == 1).sum()} open edges and {(uses > 2).sum()} shared by more than two of "
            f"its {len(triangles)} triangles; close the holes and remove inner faces in the program that wrote the file"
        )
    _, uses = np.unique(edges, axis=0, return_counts=True)
    if (uses != 1).any():
        raise SurfaceError(
            f"neighbouring triangles face opposite ways at {(uses != 1).sum()} edges; let the program that wrote the file "
            "make their normals consistent"
        )
    corner = vertices[triangles]
    volume = np.linalg.det(corner - vertices.mean(axis=0)).sum() / 6
    if volume < 0:  # all of it is inside out
        triangles = triangles[:, ::-1]
    return ClosedSurface(vertices, np.ascontiguousarray(triangles), edge)


def _face_normals(corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (T, 3), zero for a triangle without area, and the doubled areas (T,) of corners (T, 3, 3)."""
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1)
    return np.divide(normal, area[:, None], out=np.zeros_like(normal), where=area[:, None] > 0), area


def _corner_angles(corner: np.ndarray) -> np.ndarray:
    """Return the angles (T, 3) [rad] of triangles at their corners."""
    ahead, back = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    return np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=-1), (ahead * back).sum(axis=-1))


def _pseudo_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the pseudo-normals (T, 7, 3) of each triangle: of its face, its edges ab, bc, ca and its corners a, b, c.

    An edge's is the sum of its two faces' normals, a corner's the sum weighted by the faces' angles there.
    """
    corner = vertices[triangles]
    face, _ = _face_normals(corner)
    at_vertex = np.zeros_like(vertices)
    np.add.at(at_vertex, triangles, _corner_angles(corner)[:, :, None] * face[:, None, :])
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=-1).reshape(-1, 2)
    _, name = np.unique(edges, axis=0, return_inverse=True)
    name = name.reshape(-1)
    at_edge = np.zeros((name.max() + 1, 3))
    np.add.at(at_edge, name, np.repeat(face, 3, axis=0))
    return np.concatenate([face[:, None], at_edge[name].reshape(-1, 3, 3), at_vertex[triangles]], axis=1)


def _inset(vertices: np.ndarray, triangles: np.ndarray, edge: float) -> np.ndarray:
    """Return the vertices moved so that every face lies `edge` [mm] further in.

    A corner's move d solves n . d = -edge for the faces around it in the least-squares sense, weighted by their angles.
    """
    if edge == 0:
        return vertices
    corner = vertices[triangles]
    normal, area = _face_normals(corner)
    weight = _corner_angles(corner)[:, :, None]  # (T, 3, 1)
    matrix, right = np.zeros((len(vertices), 3, 3)), np.zeros_like(vertices)
    np.add.at(matrix, triangles, weight[..., None] * (normal[:, :, None] * normal[:, None, :])[:, None])
    np.add.at(right, triangles, -edge * weight * normal[:, None, :])
    values, axes = np.linalg.eigh(matrix)
    along = np.einsum("vik,vi->vk", axes, right)
    certain = values > SMOOTH * values[:, -1:]
    moves = np.where(certain, along / np.where(certain, values, 1.0), 0.0)
    inner = vertices + np.einsum("vik,vk->vi", axes, moves)
    kept = np.einsum("ti,ti->t", _face_normals(inner[triangles])[0], normal)
    lost = (kept < 0.5) & (area > 1e-9 * area.max())
    if lost.any():
        raise SurfaceError(
            f"{lost.sum()} of {len(triangles)} triangles turn over when edges are rounded by {edge:g} mm: the surface "
            "has features rounder or thinner than that; choose a smaller edge_radius_mm or leave the file's edges sharp"
        )
    return inner


def _box_tree(corner: np.ndarray, pseudo: np.ndarray) -> BoxTree:
    """Return the tree over triangles (T, 3, 3) with pseudo-normals (T, 7, 3)."""
    middle = corner.mean(axis=1)
    order = np.arange(len(corner))
    spans = [(0, len(corner))]  # of each box among the ordered triangles; grows while it is gone through
    boxes = []
    for start, end in spans:
        inside = order[start:end]
        first, count = start, end - start
        if count > 4:
            axis, half = int(np.argmax(np.ptp(middle[inside], axis=0))), count // 2
            order[start:end] = inside[np.argpartition(middle[inside, axis], half)]
            first, count = len(spans), 0
            spans += [(start, start + half), (start + half, end)]
        boxes.append((corner[inside].min(axis=(0, 1)), corner[inside].max(axis=(0, 1)), first, count))
    return BoxTree(np.ascontiguousarray(corner[order]), pseudo[order], *map(np.array, zip(*boxes)))


@nb.njit(cache=True)
def _nearest_on_triangle(p, a, b, c, foot):
    """Fill foot (3,) with the point of triangle a b c nearest to p; return 0 face, 1 ab, 2 bc, 3 ca, 4 a, 5 b, 6 c."""
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for i in range(3):
        ab, ac = b[i] - a[i], c[i] - a[i]
        d1 += ab * (p[i] - a[i])
        d2 += ac * (p[i] - a[i])
        d3 += ab * (p[i] - b[i])
        d4 += ac * (p[i] - b[i])
        d5 += ab * (p[i] - c[i])
        d6 += ac * (p[i] - c[i])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v = w = 0.0
    if d1 <= 0 and d2 <= 0:
        feature = 4
    elif d3 >= 0 and d4 <= d3:
        feature, v = 5, 1.0
    elif d6 >= 0 and d5 <= d6:
        feature, w = 6, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        feature, v = 1, d1 / (d1 - d3)
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        feature, w = 3, d2 / (d2 - d6)
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        feature, w = 2, (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1 - w
    else:
        feature, v, w = 0, vb / (va + vb + vc), vc / (va + vb + vc)
    for i in range(3):
        foot[i] = a[i] + v * (b[i] - a[i]) + w * (c[i] - a[i])
    return feature


@nb.njit(cache=True)
def _box_distance2(p, low, high):
    d2 = 0.0
    for i in range(3):
        d = max(low[i] - p[i], 0.0, p[i] - high[i])
        d2 += d * d
    return d2


@nb.njit(cache=True)
def _distances(points, tree):
    """Return gap (n,), normal (n, 3) and turn (n, 3, 3) of points (n, 3) from the triangles of a BoxTree."""
    corner, pseudo, low, high, first, held = tree
    n = len(points)
    gap, normal, turn = np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
    stack = np.empty(128, np.int64)
    foot, ray, along = np.empty(3), np.empty(3), np.empty(3)
    for k in range(n):
        p = points[k]
        best, triangle, feature = np.inf, 0, 0
        stack[0], top = 0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _box_distance2(p, low[node], high[node]) >= best:
                continue
            if held[node] > 0:
                for t in range(first[node], first[node] + held[node]):
                    kind = _nearest_on_triangle(p, corner[t, 0], corner[t, 1], corner[t, 2], foot)
                    d2 = (p[0] - foot[0]) ** 2 + (p[1] - foot[1]) ** 2 + (p[2] - foot[2]) ** 2
                    if d2 < best:
                        best, triangle, feature = d2, t, kind
                        ray[:] = p - foot
                continue
            one, other = first[node], first[node] + 1
            if _box_distance2(p, low[one], high[one]) < _box_distance2(p, low[other], high[other]):
                one, other = other, one
            stack[top], stack[top + 1] = one, other  # the nearer half is looked at first
            top += 2
        outward = pseudo[triangle, feature]
        d = np.sqrt(best)
        sign = 1.0 if ray[0] * outward[0] + ray[1] * outward[1] + ray[2] * outward[2] >= 0 else -1.0
        gap[k] = sign * d
        turn[k] = 0.0
        if feature == 0 or d < 1e-12:
            normal[k] = outward / np.sqrt(outward[0] ** 2 + outward[1] ** 2 + outward[2] ** 2)
            continue
        normal[k] = sign / d * ray
        along[:] = 0.0
        if feature < 4:
            a, b = corner[triangle, feature - 1], corner[triangle, feature % 3]
            along[:] = (b - a) / np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
        for i in range(3):
            for j in range(3):
                plane = (1.0 if i == j else 0.0) - normal[k, i] * normal[k, j] - along[i] * along[j]
                turn[k, i, j] = plane / gap[k]
    return gap, normal, turn
