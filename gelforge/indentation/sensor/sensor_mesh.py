"""The mesh of a described sensor, fine where it is pressed."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from gelforge.config import ConfigError, Sensor
from gelforge.config import Mesh as MeshSizes
from gelforge.config.parts.effects import Base
from gelforge.indentation.sensor.indenter_shapes import read_triangles
from gelforge.indentation.sensor.sizes import check_fits
from gelforge.indentation.sensor.surface_files import surface_digests
from gelforge.mechanics.indenters.closed_surface import SurfaceError, closed_surface
from gelforge.mechanics.indenters.shapes import rotation_about_axes
from gelforge.mechanics.meshes.mesh import Block, Mesh, Sizes, layered_block
from gelforge.meshing.layout import check_layout
from gelforge.meshing.solids import Solids, block_solids, dome_solids, given_solids
from gelforge.meshing.tetrahedra import MeshingError, tetrahedral_mesh
from gelforge.meshing.tetwild import TetwildError


def sensor_mesh(
    sensor: Sensor,
    mesh: MeshSizes,
    x_mm: float,
    y_mm: float,
    touched: np.ndarray | None = None,
    base: Base | None = None,
) -> Mesh:
    """Return the sensor's mesh, fine around a contact.

    Parameters
    ----------
    sensor : Sensor
        Its shape decides between hexahedra (block) and quadratic tetrahedra.
    mesh : MeshSizes
        Near and far size [mm] and growth.
    x_mm, y_mm : float
        Middle of the contact in the sensor frame.
    touched : numpy.ndarray, optional
        (n, 3) = (x, y, radius) [mm] of discs that are fine too; without them the middle alone.
    base : Base, optional
        An elastic slab under a block.

    Returns
    -------
    Mesh
        Nodes X (N, 3) [mm], elements, regions and the surface that is touched.

    Raises
    ------
    ConfigError
        For surfaces that bound no body or do not fit the description.
    """
    sizes = sizes_of(mesh)
    if by_hexahedra(sensor, mesh):
        return layered_block(_block(sensor, base), x_mm, y_mm, sizes, touched)
    if base:
        raise ConfigError(
            "mechanics.effects.geometry.base is meshed by hexahedra only; use mesh.elements: auto"
        )
    discs = np.array([[x_mm, y_mm, 0.0]]) if touched is None else np.asarray(touched)
    try:
        solids = sensor_solids(sensor, sizes.stray)
        heights = [_height(solids, x, y) for x, y, _ in discs]
        return tetrahedral_mesh(solids, sizes, np.insert(discs, 2, heights, axis=1))
    except (SurfaceError, MeshingError, TetwildError) as error:
        raise ConfigError(f"sensor: {error}") from None


def by_hexahedra(sensor: Sensor, mesh: MeshSizes) -> bool:
    """Return whether a sensor is meshed by hexahedra."""
    return sensor.shape.kind == "block" and mesh.elements != "tetrahedra"


def elements_through(sensor: Sensor, mesh: MeshSizes) -> float:
    """Return how many elements lie between contact and base; a tetrahedron's length is two of its node distances.

    Parameters
    ----------
    sensor : Sensor
        Its height.
    mesh : MeshSizes
        Near and far size [mm] and growth.

    Returns
    -------
    float
        Not rounded.
    """
    return sizes_of(mesh).through(sensor.height_mm) / (1 if by_hexahedra(sensor, mesh) else 2)


def sizes_of(mesh: MeshSizes) -> Sizes:
    """Return a description's element sizes."""
    mesh = mesh.used
    near = mesh.near_mm, mesh.near_radius_mm, mesh.growth
    return Sizes(*near, mesh.far_mm, mesh.envelope_mm, mesh.wall_parts)


def _block(sensor: Sensor, base: Base | None = None) -> Block:
    flange = sensor.flange
    return Block(
        width_x=sensor.width_x_mm,
        width_y=sensor.width_y_mm,
        layers=_layers(sensor),
        wall=sensor.wall_mm,
        flange_width=flange.width_mm if flange else 0.0,
        flange_height=flange.height_mm if flange else 0.0,
        base=base.thickness_mm if base else 0.0,
        base_is_rigid=base is not None and base.youngs_modulus_MPa is None,
    )


def _layers(sensor: Sensor) -> tuple[tuple[str, float], ...]:
    return tuple((layer.name, layer.thickness_mm) for layer in sensor.layers)


@lru_cache(maxsize=4)
def _from_files(
    files: tuple[tuple[str, str, str], ...], unit: float, origin: tuple, turns: tuple, base: float
) -> Solids:
    """Return the solids of surface files (name, path, digest), brought into the sensor's frame."""
    surfaces, rotation = {}, rotation_about_axes(turns)
    for name, path, _ in files:
        vertices, triangles = read_triangles(Path(path))
        try:
            surfaces[name] = closed_surface((unit * vertices - np.array(origin)) @ rotation.T, triangles)
        except SurfaceError as error:
            raise SurfaceError(f"{path}: {error}") from None
    return given_solids(surfaces, base)


@lru_cache(maxsize=4)
def _laid_out(files: tuple, unit: float, origin: tuple, turns: tuple, base: float, confirmed: bool) -> Solids:
    """Return the same solids after a look at how they lie to one another."""
    solids = _from_files(files, unit, origin, turns, base)
    check_layout(solids, confirmed)
    return solids


_dome = lru_cache(maxsize=4)(dome_solids)


def sensor_solids(sensor: Sensor, envelope: float = Sizes.envelope) -> Solids:
    """Return the closed surfaces of a sensor's layers.

    Parameters
    ----------
    sensor : Sensor
        A block, a dome or surfaces from files.
    envelope : float
        Largest distance [mm] of a dome's faces from the dome.

    Returns
    -------
    Solids
        Surfaces and names of the layers.

    Raises
    ------
    SurfaceError
        Where the surfaces do not fit the sensor's description.
    """
    if sensor.shape.kind == "block":
        return block_solids(_block(sensor))
    if sensor.shape.kind == "dome":
        return _dome(sensor.width_x_mm, sensor.width_y_mm, _layers(sensor), envelope)
    shape, digests = sensor.shape, surface_digests(sensor)
    base = -sensor.height_mm if shape.base_mm is None else shape.base_mm
    files = tuple((name, str(path), digests[name]) for name, path in shape.files.items())
    placed = (shape.mm_per_unit, tuple(shape.origin_mm), tuple(shape.orientation_deg))
    check_fits(sensor, *_from_files(files, *placed, base).bounds)
    return _laid_out(files, *placed, base, shape.layout_confirmed)


def tops_over(solids: Solids, x: float, y: float) -> list[float]:
    """Return the heights z [mm] at which the vertical through (x, y) meets the solids' surfaces; none next to them."""
    p, heights = np.array([x, y]), []

    def cross(u, v):
        return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]

    for surface in solids.surfaces:
        corners = a, b, c = [surface.vertices[surface.triangles[:, k]] for k in range(3)]
        sides = ((b, c), (c, a), (a, b))
        weight = np.stack([cross(first[:, :2] - p, last[:, :2] - p) for first, last in sides])
        doubled_area = weight.sum(axis=0)
        over = (weight >= 0).all(axis=0) & (doubled_area > 1e-12)  # faces that look up
        z = np.stack([corner[:, 2] for corner in corners])
        heights += list((weight * z).sum(axis=0)[over] / doubled_area[over])
    return heights


def _height(solids: Solids, x: float, y: float) -> float:
    """Return the greatest z [mm] of the solids over (x, y), or of the nearest point of the last where they have none."""
    if tops := tops_over(solids, x, y):
        return float(max(tops))
    gap, normal, _ = solids.surfaces[-1].distance(np.array([[x, y, 0.0]]))
    return float(-gap[0] * normal[0, 2])
