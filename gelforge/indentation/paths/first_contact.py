"""Where an indenter that comes along a line first touches the undeformed surface, whatever its shape."""

from __future__ import annotations

import numpy as np

from gelforge.config import ConfigError
from gelforge.mechanics.indenters.shapes import Indenter
from gelforge.mechanics.meshes.elements import TRIANGLE6_PARTS
from gelforge.mechanics.meshes.mesh import Mesh

# Parts along a face's side: on a face of 0.6 mm every point has a sample within 0.018 mm, and up to there a ball of radius 8
# mm rises by 0.018^2 / (2 x 8) = 2e-5 mm (contacts of a ball: tests/indentation/test_shapes.py).
FINE = 24
# The gap at which the indenter touches: a thousandth of the 1e-6 mm to which files hold positions (paths/places.py).
NEAR_MM = 1e-9
TRIANGLE6_NODES = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])
SIDES = np.array([[0, 1], [1, 2], [2, 0]])  # of whose ends the nodes 3 to 5 are the middles


def surface_point(mesh: Mesh, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the point (3,) of the undeformed top surface over (x, y) [mm] and its outward normal (3,).

    Raises ConfigError where no face of the top surface lies over (x, y).
    """
    faces, p = mesh.surface.faces, np.array([x, y])
    parts = TRIANGLE6_PARTS if faces.shape[1] == 6 else np.array([[0, 1, 2], [0, 2, 3]])
    triangles = faces[:, parts].reshape(-1, 3)
    corner = mesh.X[triangles]
    a, b, c = corner[:, 0, :2], corner[:, 1, :2], corner[:, 2, :2]
    weight = np.stack([_cross(b - p, c - p), _cross(c - p, a - p), _cross(a - p, b - p)], axis=-1)
    weight /= _cross(b - a, c - a)[:, None]
    height = np.where(weight.min(axis=1) > -1e-9, np.einsum("fk,fk->f", weight, corner[:, :, 2]), -np.inf)
    best = int(np.argmax(height))
    if not np.isfinite(height[best]):
        raise ConfigError(f"no top surface lies over ({x:g}, {y:g}) mm; press where the sensor is")
    if faces.shape[1] == 4:
        normal = np.cross(corner[best, 1] - corner[best, 0], corner[best, 2] - corner[best, 0])
        return np.array([x, y, height[best]]), normal / np.linalg.norm(normal)
    face, part = divmod(best, len(parts))
    L = weight[best] @ TRIANGLE6_NODES[parts[part]]
    nodes = mesh.X[faces[face]]
    for _ in range(8):  # from the flat quarter of the face: a curved face differs little
        N, dN = _triangle6(L)
        tangents = np.stack([dN[1] - dN[0], dN[2] - dN[0]]) @ nodes  # (2, 3)
        step = np.linalg.solve(tangents[:, :2].T, p - N @ nodes[:, :2])
        L = L + np.array([[-1, -1], [1, 0], [0, 1]]) @ step
    normal = np.cross(*tangents)
    return _triangle6(L)[0] @ nodes, normal / np.linalg.norm(normal)


def centre_at_contact(indenter: Indenter, mesh: Mesh, x: float, y: float, along: np.ndarray) -> np.ndarray:
    """Return the centre (3,) [mm] at which the indenter, coming along a unit vector (3,), first touches the surface.

    Its path aims at the surface's point over (x, y). Moving by the smallest gap never passes the surface: no point of a
    rigid body that only translates comes nearer by more than it moves.
    """
    away = 2 * indenter.size + np.ptp(mesh.X, axis=0).max()
    far = surface_point(mesh, x, y)[0] - away * along
    nodes = mesh.X[mesh.surface.nodes]
    first = nodes[np.argmin(indenter.gap(nodes, _advanced(indenter, nodes, far, along))[0])]
    faces = mesh.surface.faces
    corner = mesh.X[faces[:, :3]]
    size = np.linalg.norm(corner[:, 0] - corner[:, 1], axis=1)
    # the contact point lies between the nodes around the first
    near = np.linalg.norm(corner.mean(axis=1) - first, axis=1) < 3 * size
    points = np.concatenate([nodes, _sampled(mesh.X[faces[near]])])
    return _advanced(indenter, points, far, along)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _triangle6(L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the shape functions (..., 6) of a six-node triangle at area coordinates L (..., 3), and dN/dL (3, ..., 6)."""
    a, b = SIDES.T
    N = np.concatenate([L * (2 * L - 1), 4 * L[..., a] * L[..., b]], axis=-1)
    corners = [(4 * L - 1) * (np.arange(3) == k) for k in range(3)]
    middles = [4 * ((a == k) * L[..., b] + (b == k) * L[..., a]) for k in range(3)]
    return N, np.concatenate([corners, middles], axis=-1)


def _sampled(nodes: np.ndarray) -> np.ndarray:
    """Return points (n, 3) all over faces with nodes (F, 4) or (F, 6, 3)."""
    i, j = (w.ravel() for w in np.meshgrid(*[np.arange(FINE + 1)] * 2, indexing="ij"))
    if nodes.shape[1] == 4:  # flat rectangles
        s, t = i / FINE, j / FINE
        weight = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=-1)
    else:
        a, b = i[i + j <= FINE] / FINE, j[i + j <= FINE] / FINE
        weight = _triangle6(np.stack([1 - a - b, a, b], axis=-1))[0]
    return np.einsum("wk,fki->fwi", weight, nodes).reshape(-1, 3)


def _advanced(indenter: Indenter, points: np.ndarray, centre: np.ndarray, along: np.ndarray) -> np.ndarray:
    for _ in range(500):
        gap = indenter.gap(points, centre)[0].min()
        if gap < NEAR_MM:
            return centre
        centre = centre + gap * along
    raise ConfigError(
        f"the indenter, moving along {np.round(along, 3)}, passes the surface at {gap:.2g} mm; press at another position"
    )
