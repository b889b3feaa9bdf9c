"""Nodal forces to bins of the undeformed surface, and what that does to their moment."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from gelforge.config import Sensor
from gelforge.indentation.sensor.unrolled import unrolled
from gelforge.mechanics.meshes.elements import TRIANGLE6_PARTS
from gelforge.mechanics.meshes.mesh import Mesh

# Of a triangle's side. A bin's edge cuts at most 47 of a face's 576 equal parts, and each of these counts for one side: some
# sqrt(47) / 2 of 576, 0.6 % of the face, are off. Bins under a uniform pressure are alike
# (tests/indentation/test_unrolled.py).
PARTS = 24
# Components below this share of the largest are stored as exact zeros: the sparse RMSE (Sferrazza et al. 2019)
# counts entries that are not zero.
DUST = 1e-8


def bin_shares(mesh: Mesh, sensor: Sensor, rule: str) -> sp.csr_matrix:
    """Return the share of each surface node's force that each bin gets.

    Parameters
    ----------
    mesh : Mesh
        Its surface has S nodes.
    sensor : Sensor
        Its B bins.
    rule : str
        `mechanics.binning`: "shape_function" or "node".

    Returns
    -------
    scipy.sparse.csr_matrix
        (B, S), bin k = nx iy + ix.
    """
    return surface_shares(mesh, sensor) if rule == "shape_function" else node_shares(mesh, sensor)


def surface_shares(mesh: Mesh, sensor: Sensor) -> sp.csr_matrix:
    """Return the share of each surface node's shape function that lies in each bin.

    It is the integral of the shape function over the bin, divided by its integral over the top surface.

    Parameters
    ----------
    mesh : Mesh
        Its surface has S nodes.
    sensor : Sensor
        Its B bins.

    Returns
    -------
    scipy.sparse.csr_matrix
        (B, S), bin k = nx iy + ix. Columns of nodes of the top sum to 1, those of nodes on the sides are empty.
    """
    if mesh.surface.faces.shape[1] == 6:
        return _triangle_shares(mesh, sensor)
    faces, surface, bins = mesh.surface.faces, mesh.surface, sensor.bins
    low, high = mesh.X[faces[:, 0], :2], mesh.X[faces[:, 2], :2]
    share = [
        _hat_integrals(low[:, axis], high[:, axis], width, n)
        for axis, width, n in ((0, sensor.width_x_mm, bins.nx), (1, sensor.width_y_mm, bins.ny))
    ]
    rows, columns, values = [], [], []
    for corner, (end_x, end_y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
        (bin_x, parts_x), (bin_y, parts_y) = share
        part_x, part_y = parts_x[end_x], parts_y[end_y]
        for i in range(part_x.shape[1]):
            for j in range(part_y.shape[1]):
                value = part_x[:, i] * part_y[:, j]
                some = value > 0
                rows.append((bins.nx * (bin_y + j) + bin_x + i)[some])
                columns.append(faces[some, corner])
                values.append(value[some])
    row, column, share_of = (np.concatenate(part) for part in (rows, columns, values))
    shares = sp.csr_matrix((share_of, (row, column)), shape=(bins.nx * bins.ny, len(mesh.X)))
    if mesh.ties is not None:
        shares = shares @ mesh.ties
    return _normalised(shares[:, surface.nodes])


def _triangle_shares(mesh: Mesh, sensor: Sensor) -> sp.csr_matrix:
    """Return surface_shares of six-node triangles by quadrature: PARTS^2 equal parts of each, binned by where they lie.

    The integral of a corner's shape function over a flat face is zero, so that what little force a corner carries acts at
    no place of its own: it is shared as by the linear function of the corner.
    """
    bins, width = sensor.bins, np.array([sensor.width_x_mm, sensor.width_y_mm])
    faces = mesh.surface.faces
    L = _midpoints(PARTS)  # (parts, 3) area coordinates
    a, b = np.array([[0, 1], [1, 2], [2, 0]]).T
    middle = 4 * L[:, a] * L[:, b]
    position = np.concatenate([L * (2 * L - 1), middle], axis=1)  # the curved face's own shape functions
    place = unrolled(sensor, np.einsum("pk,fki->fpi", position, mesh.X[faces]))
    index = np.clip((place / width * [bins.nx, bins.ny]).astype(int), 0, [bins.nx - 1, bins.ny - 1])
    value = face_areas(mesh)[:, None, None] * np.concatenate([L, middle], axis=1)  # (F, parts, 6)
    rows = np.broadcast_to((bins.nx * index[..., 1] + index[..., 0])[..., None], value.shape)
    columns = np.broadcast_to(faces[:, None, :], value.shape)
    entries = value.ravel(), (rows.ravel(), columns.ravel())
    shares = sp.csr_matrix(entries, shape=(bins.nx * bins.ny, len(mesh.X)))
    return _normalised(shares[:, mesh.surface.nodes])


def face_areas(mesh: Mesh) -> np.ndarray:
    """Return the areas (F,) [mm^2] of the top surface's six-node faces, each as four flat triangles."""
    corner = mesh.X[mesh.surface.faces[:, TRIANGLE6_PARTS]]  # (F, 4, 3, 3)
    normal = np.cross(corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0])
    return np.linalg.norm(normal, axis=-1).sum(axis=1) / 2


def node_areas(mesh: Mesh) -> np.ndarray:
    """Return the area (S,) [mm^2] over which each surface node's force acts: the integral of its shape function.

    At a corner of six-node triangles it is zero, at the middle of an edge a third of the two faces.
    """
    surface = mesh.surface
    if surface.faces.shape[1] == 4:
        return surface.area
    area = np.zeros(len(mesh.X))
    np.add.at(area, surface.faces[:, 3:], face_areas(mesh)[:, None] / 3)
    return area[surface.nodes]


def _midpoints(n: int) -> np.ndarray:
    """Return the middles (n^2, 3), in volume coordinates, of the n^2 equal triangles that a triangle divides into."""
    i, j = (w.ravel() for w in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    upright, turned = i + j < n, i + j < n - 1
    a = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / n
    b = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / n
    return np.stack([1 - a - b, a, b], axis=-1)


def _hat_integrals(low: np.ndarray, high: np.ndarray, width: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first bin (Q,) of each interval and the integrals (2, Q, m) [mm] of its falling and rising hat per bin.

    m is the largest number of bins that an interval meets.
    """
    edge = width / n
    first = np.clip(np.floor(low / edge + 1e-9).astype(int), 0, n - 1)
    last = np.clip(np.ceil(high / edge - 1e-9).astype(int) - 1, first, n - 1)
    size = high - low
    parts = []
    for k in range((last - first).max() + 1):
        a = np.clip((first + k) * edge, low, high) if k else low
        b = np.where(first + k >= last, high, np.clip((first + k + 1) * edge, low, high))
        b = np.where(first + k > last, a, b)
        rising = ((b - low) ** 2 - (a - low) ** 2) / (2 * size)
        parts.append(np.stack([(b - a) - rising, rising]))
    return first, np.moveaxis(np.array(parts), 0, -1)


def node_shares(mesh: Mesh, sensor: Sensor) -> sp.csr_matrix:
    """Return shares (B, S) of the paper's rule: all to the node's bin, a node on an edge to both sides equally."""
    surface, bins = mesh.surface, sensor.bins
    rows, columns, values = [], [], []
    place = unrolled(sensor, mesh.X[surface.nodes])
    along = [
        _bins_of(place[:, axis] / width * n, n)
        for axis, width, n in ((0, sensor.width_x_mm, bins.nx), (1, sensor.width_y_mm, bins.ny))
    ]
    for in_x in along[0]:
        for in_y in along[1]:
            inside = surface.top & (in_x >= 0) & (in_y >= 0)
            rows.append((bins.nx * in_y + in_x)[inside])
            columns.append(np.flatnonzero(inside))
            values.append(np.ones(inside.sum()))
    row, column, share = (np.concatenate(part) for part in (rows, columns, values))
    return _normalised(sp.csr_matrix((share, (row, column)), shape=(bins.nx * bins.ny, len(surface.nodes))))


def _bins_of(position: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the bin of each position and the other one of a position on an edge, -1 where there is none."""
    edge = np.rint(position)
    on_edge = np.abs(position - edge) < 1e-9
    right = np.where(on_edge, edge, np.floor(position)).astype(int)
    left = np.where(on_edge, right - 1, -1)
    return np.where(right < n, right, -1), left


def _normalised(shares: sp.csr_matrix) -> sp.csr_matrix:
    total = np.asarray(shares.sum(axis=0)).ravel()
    return (shares @ sp.diags(1 / np.where(total > 0, total, 1))).tocsr()


def bin_forces(forces: np.ndarray, shares: sp.csr_matrix) -> np.ndarray:
    """Return the forces of bins.

    Parameters
    ----------
    forces : numpy.ndarray
        (D, S, 3) [N] of surface nodes.
    shares : scipy.sparse.csr_matrix
        (B, S), as `bin_shares` returns it.

    Returns
    -------
    numpy.ndarray
        (D, B, 3) [N].
    """
    D, S, _ = forces.shape
    binned = shares @ np.moveaxis(forces, 1, 0).reshape(S, D * 3)
    return np.moveaxis(binned.reshape(shares.shape[0], D, 3), 0, 1)


def without_dust(forces: np.ndarray) -> np.ndarray:
    """Return the forces with components below DUST of the largest one replaced by exact zeros.

    Parameters
    ----------
    forces : numpy.ndarray
        Of any shape [N].

    Returns
    -------
    numpy.ndarray
        Same shape [N].
    """
    return np.where(np.abs(forces) < DUST * np.abs(forces).max(initial=0.0), 0.0, forces)
