"""The linear operator from bin forces to the flow of image regions: small strains, the sensor's moduli at rest, its camera.

Forces of unit size, spread evenly over each bin, displace the gel; the camera sees the displacement of its particles.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from gelforge.config import Camera, Mechanics, Mesh, PrintedDots, Sensor
from gelforge.indentation.cells.binning import surface_shares
from gelforge.indentation.effects.fields import element_stiffness
from gelforge.indentation.effects.material import region_bulk, region_laws
from gelforge.indentation.paths.places import ROUNDING_MM
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.indentation.sensor.symmetry import D4
from gelforge.learning.basis.turns import names_of, order
from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.linear.sparse import direct_solver
from gelforge.mechanics.meshes.elements import lumped_area
from gelforge.mechanics.meshes.mesh import Mesh as HexMesh
from gelforge.recording.optics.camera import project, unproject
from gelforge.virtual_lab.particles import dots_box, gel_boxes, interpolation

# The flow of an even shear and of a shallow indentation is that of closed form and solver
# (tests/learning/test_elasticity.py):
PARTS = 2  # of a region's side: the places in it that are followed
# along a bin's side. Measured: three change the flow of the benchmark study's labels by 1.6 %.
ELEMENTS_OF_BIN = 2
MOST_ELEMENTS = 60  # along a side
# Of central differences of the projection: they err by the square of the step over the distance, some 1e-7.
STEP_MM = 0.01


def flow_operator(
    sensor: Sensor,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    camera: Camera,
    regions: int,
    crop_px: list[int] | None = None,
    particle_mm: float = 0.3,
    dots: PrintedDots | None = None,
) -> np.ndarray:
    """Return the flow (2, r^2, B, 3) [px/N] of image regions, row by row, for unit forces along x, y, z on each bin.

    laws: by layer. Every force is an even traction over its bin of the undeformed top. A region's flow is the mean over
    its area and over the heights of the particles, each seen through those below it (Lambert-Beer: a share
    1.5 phi / d of the view is covered per mm). Bins are solved up to the symmetry of sensor and mesh. Regions that
    show no gel have no flow. dots: what is printed on one plane in place of particles. Raises VirtualLabError for dots
    that lie in no layer.
    """
    mesh = _even_mesh(sensor, mechanics)
    seen = seen_flow(mesh, sensor, camera, regions, crop_px, particle_mm, dots)
    load = bin_loads(mesh, sensor)
    maps = symmetries(mesh, sensor, mechanics)
    nx, ny = sensor.bins.nx, sensor.bins.ny
    orders = {name: order(name, nx, ny) for name in maps}  # the bin that a bin's value comes from
    orbit = np.min(list(orders.values()), axis=0)
    first = np.unique(orbit)
    moved = displacements(mesh, sensor, mechanics, laws, load[first])  # (b, 3, N, 3)
    fields = np.moveaxis(moved, -1, 2).reshape(len(first) * 3, -1).T  # (3 N, 3 b), x of all nodes first
    G = np.empty((2 * regions**2, nx * ny, 3), np.float32)
    done = np.zeros(nx * ny, bool)
    for name, nodes in maps.items():
        bins = np.flatnonzero(np.isin(orders[name], first) & ~done)
        if len(bins):
            source = np.searchsorted(first, orders[name][bins])
            carried = (_carrying(seen, D4[name], nodes) @ fields).reshape(len(G), len(first), 3)[:, source]
            # a carried force along c lies along D4 e_c; that along e_j is the sum of D4[j, c] of them
            G[:, bins, :2] = np.einsum("jc,fbc->fbj", D4[name], carried[..., :2])
            G[:, bins, 2] = carried[..., 2]
            done[bins] = True
    return G.reshape(2, regions**2, nx * ny, 3)


def _even_mesh(sensor: Sensor, mechanics: Mechanics) -> HexMesh:
    """Return a mesh of even elements, symmetric about the sensor's middle."""
    bins, widths = sensor.bins, (sensor.width_x_mm, sensor.width_y_mm)
    size = min(width / n for width, n in zip(widths, (bins.nx, bins.ny))) / ELEMENTS_OF_BIN
    size = max(size, max(widths) / MOST_ELEMENTS)
    even = Mesh(near_mm=size, far_mm=size)
    return sensor_mesh(sensor, even, widths[0] / 2, widths[1] / 2, base=mechanics.effects.geometry.base)


def bin_loads(mesh: HexMesh, sensor: Sensor) -> sp.csr_matrix:
    """Return the nodal forces (B, N) of a unit force on each bin, spread evenly over it."""
    area = lumped_area(mesh.X, mesh.surface.faces)  # (N,) of the top alone, which the shares are of
    area = area if mesh.ties is None else mesh.ties.T @ area
    shares = surface_shares(mesh, sensor) @ sp.diags(area[mesh.surface.nodes])  # (B, S)
    total = np.asarray(shares.sum(axis=1)).ravel()
    shares = (sp.diags(1 / np.where(total > 0, total, 1.0)) @ shares).tocoo()
    place = shares.row, mesh.surface.nodes[shares.col]
    return sp.csr_matrix((shares.data, place), shape=(shares.shape[0], len(mesh.X)))


def displacements(
    mesh: HexMesh, sensor: Sensor, mechanics: Mechanics, laws: dict[str, PrincipalLaw], load: sp.csr_matrix
) -> np.ndarray:
    """Return the displacements (b, 3, N, 3) [mm] of loads (b, N) [N] along x, y and z: small strains, moduli at rest."""
    effects = mechanics.effects
    stiffness, bulk_stiffness = element_stiffness(mesh, sensor, mechanics)
    by_region = region_laws(sensor, effects, mesh.regions, laws)
    body = Body(
        mesh, by_region, region_bulk(sensor, mechanics, mesh.regions), None, stiffness, bulk_stiffness
    )
    equation, size = body.pattern.equation, body.pattern.size
    values = np.empty(len(body.pattern.indices))
    body.response(np.zeros_like(mesh.X), np.zeros(len(mesh.elements)), values)
    solver = direct_solver(body.pattern, mechanics.solver.linear_solver)
    solver.factor(values)
    upper = sp.csr_matrix((values, body.pattern.indices, body.pattern.indptr), shape=(size, size))
    symmetric = (upper + sp.triu(upper, 1).T).tocsr()
    free = equation >= 0
    dense = load.toarray() if mesh.ties is None else (load @ mesh.ties).toarray()
    moved = np.zeros((len(dense), 3, *mesh.X.shape))
    for axis in range(3):
        along, held = np.zeros((len(dense), size)), equation[:, axis] >= 0
        along[:, equation[held, axis]] = dense[:, held]
        solutions = solver.solve_many(along)
        for _ in range(2):  # the factorisation is in single precision
            left = along - (symmetric @ solutions.T).T
            scale = np.abs(left).max(axis=1, keepdims=True) + 1e-300  # of unit size, as solve_many asks
            solutions = solutions + scale * solver.solve_many(left / scale)
        moved[:, axis, free] = solutions[:, equation[free]]
    if mesh.ties is not None:
        by_node = mesh.ties @ np.moveaxis(moved, 2, 0).reshape(len(mesh.X), -1)
        moved = np.moveaxis(by_node.reshape(len(mesh.X), len(dense), 3, 3), 0, 2)
    return moved


def symmetries(mesh: HexMesh, sensor: Sensor, mechanics: Mechanics) -> dict[str, np.ndarray]:
    """Return by element of D4 that carries sensor and mesh onto themselves the node (N,) onto which each one is carried."""
    width = np.array([sensor.width_x_mm, sensor.width_y_mm])
    names = names_of(width[0] == width[1] and sensor.bins.nx == sensor.bins.ny)
    names = names if mechanics.effects.has_symmetry_of_square else ("identity",)
    tree, permutations = cKDTree(mesh.X), {}
    for name in names:
        carried = mesh.X.copy()
        carried[:, :2] = (carried[:, :2] - width / 2) @ D4[name].T + width / 2
        away, nodes = tree.query(carried)
        if away.max() < ROUNDING_MM:
            permutations[name] = nodes
    return permutations


def _carrying(seen: sp.csr_matrix, plane: np.ndarray, nodes: np.ndarray) -> sp.csr_matrix:
    """Return the operator (R, 3 N) on displacements before they are carried by a symmetry to other nodes (N,)."""
    count = len(nodes)
    at = [seen[:, axis * count : (axis + 1) * count][:, nodes] for axis in range(3)]
    x, y = (plane[0, c] * at[0] + plane[1, c] * at[1] for c in range(2))
    return sp.hstack([x, y, at[2]], format="csr")


def seen_flow(
    mesh: HexMesh,
    sensor: Sensor,
    camera: Camera,
    regions: int,
    crop_px: list[int] | None,
    particle_mm: float,
    dots: PrintedDots | None = None,
) -> sp.csr_matrix:
    """Return the operator (2 r^2, 3 N) [px/mm] from nodal displacements, x of all nodes first, to the flow of regions."""
    left, top, wide, high = crop_px or (0, 0, camera.width_px, camera.height_px)
    places = (np.arange(regions * PARTS) + 0.5) / (regions * PARTS)
    u, v = np.meshgrid(left + wide * places - 0.5, top + high * places - 0.5)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)  # (n, 2), row by row
    region = (np.arange(len(u))[:, None] // PARTS * regions + np.arange(len(u)) // PARTS).ravel()
    count, nodes = regions**2, len(mesh.X)
    total, sum_of = np.zeros(count), sp.csr_matrix((2 * count, 3 * nodes))
    for layer, z, weight in _heights(sensor, particle_mm, dots):
        low, high_corner = layer[1]
        points = unproject(camera, pixels, z)
        inside = ((points > low + ROUNDING_MM) & (points < high_corner - ROUNDING_MM)).all(axis=1)
        points, of = points[inside], region[inside]
        if not len(points):
            continue
        elements = mesh.elements[mesh.region == mesh.regions.index(layer[0])]
        cells, corners = np.unique(elements, return_inverse=True)
        local = interpolation(mesh.X[cells], corners.reshape(-1, 8), points)
        at = sp.csr_matrix((local.data, cells[local.indices], local.indptr), shape=(len(points), nodes))
        J = weight * projection_jacobian(camera, points)  # (n, 2, 3)
        gather = sp.csr_matrix((np.ones(len(of)), (of, np.arange(len(of)))), shape=(count, len(of)))
        rows = [sp.hstack([gather @ sp.diags(J[:, i, c]) @ at for c in range(3)]) for i in range(2)]
        sum_of = sum_of + sp.vstack(rows, format="csr")
        total += weight * np.bincount(of, minlength=count)
    mean = np.where(total > 0, 1 / np.where(total > 0, total, 1.0), 0.0)
    return (sp.diags(np.tile(mean, 2)) @ sum_of).tocsr()


def _heights(
    sensor: Sensor, particle_mm: float, dots: PrintedDots | None
) -> list[tuple[tuple, float, float]]:
    """Return layer, mean height of what is seen [mm] and visible share of slabs with particles, from the camera up.

    Printed dots are all on one plane.
    """
    if dots:
        box = dots_box(dots, sensor)
        imaged = zip(sensor.imaged_layers, gel_boxes(sensor))
        named = next(layer.name for layer, corners in imaged if corners[0][2] == box[0][2])
        return [((named, box), -dots.depth_mm, 1.0)]
    layers = [layer for layer in sensor.layers if layer.particle_volume_fraction > 0]
    heights, covered = [], 0.0
    for layer, box in zip(layers, gel_boxes(sensor)):
        # particles of 0.7 mm of gel are followed at one height
        count = max(1, round((box[1][2] - box[0][2]) / 0.7))
        edges = np.linspace(box[0][2], box[1][2], count + 1)
        per_mm = 1.5 * layer.particle_volume_fraction / particle_mm
        for bottom, top in zip(edges, edges[1:]):
            thick = top - bottom
            share = -np.exp(-covered) * np.expm1(-per_mm * thick)
            z = bottom + 1 / per_mm - thick / np.expm1(per_mm * thick)
            covered += per_mm * thick
            heights.append(((layer.name, box), float(z), float(share)))
    return heights


def projection_jacobian(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Return d(pixel)/d(point) (n, 2, 3) [px/mm] at points (n, 3), by central differences."""
    ends = ((project(camera, points + h)[0], project(camera, points - h)[0]) for h in STEP_MM * np.eye(3))
    return np.stack([(after - before) / (2 * STEP_MM) for after, before in ends], axis=-1)
