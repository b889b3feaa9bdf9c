"""The mesh of a described sensor, fine where it is pressed."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from gelforge.config import ConfigError, Sensor
from gelforge.config import Mesh as MeshSizes
from gelforge.config.effects import Base
from gelforge.indentation.indenter_shapes import read_triangles
from gelforge.indentation.surface_files import surface_digests
from gelforge.mechanics.closed_surface import ClosedSurface, SurfaceError, closed_surface
from gelforge.mechanics.meshes import Block, Mesh, Sizes, layered_block
from gelforge.meshing.solids import Solids, block_solids, dome_solids, given_solids
from gelforge.meshing.tetrahedra import MeshingError, tetrahedral_mesh

OUTSIDE_MM = 0.01  # a surface may reach this far beyond the sensor's stated rectangle and height


def sensor_mesh(
    sensor: Sensor,
    mesh: MeshSizes,
    x_mm: float,
    y_mm: float,
    touched: np.ndarray | None = None,
    base: Base | None = None,
) -> Mesh:
    """Return the sensor's mesh, fine around (x, y) and on the touched discs (n, 3) = (x, y, radius) [mm].

    base: an elastic slab under a block.
    Raises ConfigError for surfaces that bound no body or do not fit the description.
    """
    sizes = sizes_of(mesh)
    if sensor.shape.kind == "block" and mesh.elements != "tetrahedra":
        return layered_block(_on_base(_block(sensor), base), x_mm, y_mm, sizes, touched)
    if base:
        raise ConfigError(
            "mechanics.effects.geometry.base is meshed by hexahedra only; use mesh.elements: auto"
        )
    discs = np.array([[x_mm, y_mm, 0.0]]) if touched is None else np.asarray(touched)
    try:
        solids = sensor_solids(sensor, sizes.stray)
        heights = [_height(solids.surfaces[-1], x, y) for x, y, _ in discs]
        return tetrahedral_mesh(solids, sizes, np.insert(discs, 2, heights, axis=1))
    except (SurfaceError, MeshingError) as error:
        raise ConfigError(f"sensor: {error}") from None


def sizes_of(mesh: MeshSizes) -> Sizes:
    """Return a description's element sizes."""
    return Sizes(
        mesh.near_mm, mesh.near_radius_mm, mesh.growth, mesh.far_mm, mesh.envelope_mm, mesh.wall_parts
    )


def _block(sensor: Sensor) -> Block:
    flange = sensor.flange
    return Block(
        width_x=sensor.width_x_mm,
        width_y=sensor.width_y_mm,
        layers=_layers(sensor),
        wall=sensor.wall_mm,
        flange_width=flange.width_mm if flange else 0.0,
        flange_height=flange.height_mm if flange else 0.0,
    )


def _on_base(block: Block, base: Base | None) -> Block:
    if base is None:
        return block
    return replace(block, base=base.thickness_mm, base_is_rigid=base.youngs_modulus_MPa is None)


def _layers(sensor: Sensor) -> tuple[tuple[str, float], ...]:
    return tuple((layer.name, layer.thickness_mm) for layer in sensor.layers)


@lru_cache(maxsize=4)
def _from_files(files: tuple[tuple[str, str, str], ...], base: float) -> Solids:
    surfaces = {}
    for name, path, _ in files:
        try:
            surfaces[name] = closed_surface(*read_triangles(Path(path)))
        except SurfaceError as error:
            raise SurfaceError(f"{path}: {error}") from None
    return given_solids(surfaces, base)


@lru_cache(maxsize=4)
def _dome(width_x: float, width_y: float, layers: tuple, envelope: float) -> Solids:
    return dome_solids(width_x, width_y, layers, envelope)


def sensor_solids(sensor: Sensor, envelope: float = Sizes.envelope) -> Solids:
    """Return the closed surfaces of a sensor's layers, drafted within an envelope [mm].

    Raises SurfaceError where they do not fit the sensor's description.
    """
    if sensor.shape.kind == "block":
        return block_solids(_block(sensor))
    if sensor.shape.kind == "dome":
        return _dome(sensor.width_x_mm, sensor.width_y_mm, _layers(sensor), envelope)
    base = -sensor.height_mm if sensor.shape.base_mm is None else sensor.shape.base_mm
    digests = surface_digests(sensor)
    solids = _from_files(
        tuple((name, str(path), digests[name]) for name, path in sensor.shape.files.items()), base
    )
    low, high = (f(solids.surfaces[-1].vertices, axis=0) for f in (np.min, np.max))
    room = np.array([[0.0, 0.0, -np.inf], [sensor.width_x_mm, sensor.width_y_mm, 0.0]])
    if (low < room[0] - OUTSIDE_MM).any() or (high > room[1] + OUTSIDE_MM).any() or abs(high[2]) > OUTSIDE_MM:
        raise SurfaceError(
            f"the outer surface reaches from {np.round(low, 3)} to {np.round(high, 3)} mm; the sensor's frame wants x in "
            f"[0, {sensor.width_x_mm:g}], y in [0, {sensor.width_y_mm:g}] and its highest point at z = 0: move the surfaces "
            f"by {np.round(-np.array([low[0], low[1], high[2]]), 3)} mm or correct width_x_mm and width_y_mm"
        )
    return solids


def _height(surface: ClosedSurface, x: float, y: float) -> float:
    """Return the greatest z [mm] of a surface over (x, y), or of its nearest point where it has none there."""
    a, b, c = (surface.vertices[surface.triangles[:, k]] for k in range(3))
    p = np.array([x, y])

    def cross(u, v):
        return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]

    weight = np.stack(
        [
            cross(b[:, :2] - p, c[:, :2] - p),
            cross(c[:, :2] - p, a[:, :2] - p),
            cross(a[:, :2] - p, b[:, :2] - p),
        ]
    )
    whole = weight.sum(axis=0)
    over = (weight >= 0).all(axis=0) & (whole > 1e-12)
    if over.any():
        z = np.stack([a[:, 2], b[:, 2], c[:, 2]])
        return float(((weight * z).sum(axis=0)[over] / whole[over]).max())
    gap, normal, _ = surface.distance(np.array([[x, y, 0.0]]))
    return float(-gap[0] * normal[0, 2])
