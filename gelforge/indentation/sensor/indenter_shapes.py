"""Indenters from their descriptions, and what is checked of an indentation before anything is solved."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gelforge.config import ConfigError, Effects, Indenter, IndenterPart, Study, given
from gelforge.indentation.sensor.obj_surface import fan, obj_triangles
from gelforge.mechanics.indenters.shapes import (
    DOWN,
    Box,
    Cylinder,
    Several,
    Sphere,
    Turned,
    rotation_about_axes,
)
from gelforge.mechanics.indenters.shapes import Indenter as Shape

# An edge rounded by less than this share of the element size is a jump for Newton's method. Measured: at a tenth it still
# converges, in two to three times the iterations.
EDGE_SHARE = 0.2


def shape_of(section: Indenter) -> Shape:
    """Return the rigid body that a section of the configuration describes.

    Parameters
    ----------
    section : Indenter
        One shape, or parts with offsets [mm].

    Returns
    -------
    Shape
        Its distance function and support; lengths in mm.

    Raises
    ------
    ConfigError
        For a file that bounds no body.
    """
    shapes = [_part(part) for part in section.shapes]
    if not section.parts:
        return shapes[0]
    offsets = [
        [part.offset_mm[0], part.offset_mm[1], part.offset_mm[2] + shape.support(DOWN)]
        for part, shape in zip(section.parts, shapes)
    ]
    return _turned(Several(tuple(shapes), np.array(offsets)), section)


def real_indenter(shape: Shape, effects: Effects) -> Shape:
    """Return the indenter as it really is; the mesh is made for the one that is described."""
    change = effects.geometry.indenter_radius_change_mm
    if not change:
        return shape
    if not isinstance(shape, Sphere):
        raise ConfigError(
            f"mechanics.effects.geometry.indenter_radius_change_mm is for a ball, found {type(shape).__name__.lower()};"
            " change the indenter's own sizes instead"
        )
    if shape.radius + change <= 0:
        raise ConfigError(
            f"mechanics.effects.geometry.indenter_radius_change_mm {change:g} leaves no ball of radius"
            f" {shape.radius:g} mm; make it smaller"
        )
    return Sphere(shape.radius + change)


def _part(part: IndenterPart) -> Shape:
    if part.kind == "sphere":
        return Sphere(part.radius_mm)
    if part.kind == "cylinder":
        return _turned(Cylinder(part.radius_mm, part.length_mm, part.edge_radius_mm), part)
    if part.kind == "box":
        x, y, z = part.size_mm
        return _turned(Box((x, y, z), part.edge_radius_mm), part)
    return _turned(_surface(part), part)


def _turned(shape: Shape, part: IndenterPart) -> Shape:
    return Turned(shape, rotation_about_axes(part.orientation_deg)) if any(part.orientation_deg) else shape


def _surface(part: IndenterPart) -> Shape:
    """Return the body inside the closed surface of a file."""
    # loads compiled kernels
    from gelforge.mechanics.indenters.closed_surface import SurfaceError, closed_surface

    vertices, triangles = read_triangles(given(part.file, "indenter.file"))
    try:
        return closed_surface(_about_origin(part, vertices), triangles, part.edge_radius_mm)
    except SurfaceError as error:
        raise ConfigError(f"{part.file}: {error}") from None


def _about_origin(part: IndenterPart, vertices: np.ndarray) -> np.ndarray:
    """Return a file's vertices (V, 3) in mm about the point that is the shape's origin."""
    return part.mm_per_unit * vertices - np.array(part.origin_mm or (0.0, 0.0, 0.0))


def part_corners(part: IndenterPart) -> np.ndarray:
    """Return the vertices (V, 3) [mm] of a file about its origin, turned; else two corners of its box."""
    if part.kind == "mesh":
        vertices, triangles = read_triangles(given(part.file, "indenter.file"))
        used = _about_origin(part, vertices[np.unique(triangles)])
        return used @ rotation_about_axes(part.orientation_deg).T
    shape = _part(part)
    return np.array([[sign * shape.support(sign * axis) for axis in np.eye(3)] for sign in (-1, 1)])


def read_triangles(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, 3) in the file's unit and triangles (T, 3) of an STL, PLY or OBJ file, polygons cut."""
    import meshio

    if not path.is_file():
        raise ConfigError(f"{path}: no such file; name an STL, PLY or OBJ file that exists")
    if path.suffix.lower() == ".obj":
        vertices, triangles = obj_triangles(path)
        if not len(triangles):
            raise ConfigError(f"{path}: no face; save the body's surface as triangles")
        return vertices, triangles
    try:
        # meshio takes the text of an ASCII STL for a number of triangles first
        with np.errstate(over="ignore"):
            read = meshio.read(path)
    # meshio exits where it gives up
    except (meshio.ReadError, ValueError, IndexError, KeyError, SystemExit) as error:
        raise ConfigError(
            f"{path}: meshio cannot read it ({error or 'unknown format'}); save it as another of STL, PLY and OBJ"
        ) from None
    faces = [np.empty((0, 3), int)]
    for block in read.cells:
        if block.type == "triangle":
            faces.append(block.data)
        elif block.type in ("quad", "polygon"):
            faces += [fan(str(path), read.points, corners) for corners in block.data]
    triangles = np.concatenate(faces).astype(np.int64)
    if not len(triangles):
        types = sorted({block.type for block in read.cells}) or "nothing"
        raise ConfigError(f"{path}: no triangles, found {types}; save the body's surface as triangles")
    return np.asarray(read.points, dtype=float), triangles


def check_widest(shape: Shape, words: str, depth_mm: float, where: str) -> None:
    """Refuse an indentation that would sink the indenter; the depth is the real one, words those of the indenter."""
    if depth_mm > shape.reach + 1e-9:
        raise ConfigError(
            f"{where}: depth {depth_mm:.4g} mm is beyond the widest part of the {words}, {shape.reach:.3g} mm above its "
            "lowest point: the gel would close over it; press less deep or take a larger indenter"
        )


def check_press(study: Study, shape: Shape, depth_mm: float, where: str) -> None:
    """Refuse a commanded depth that the mesh cannot resolve."""
    near, words = study.mechanics.mesh.used.near_mm, study.indenter.words
    for part in study.indenter.shapes:
        if part.kind != "sphere" and part.edge_radius_mm < EDGE_SHARE * near - 1e-12:
            raise ConfigError(
                f"{where}: edge_radius_mm {part.edge_radius_mm:g} of the {part.kind} is sharp for elements of "
                f"mechanics.mesh.near_mm {near:g} mm (limit {EDGE_SHARE * near:.3g} mm); round the edge more or refine"
            )
    touched = shape.footprint(depth_mm)[:, 2].min()
    if touched < near:
        turned = any(any(part.orientation_deg) for part in (study.indenter, *study.indenter.parts))
        remedy = (
            ", or an orientation_deg in which no edge or corner comes first" if turned else " or press deeper"
        )
        raise ConfigError(
            f"{where}: at its deepest, {depth_mm:g} mm, the {words} touches only {touched:.2g} mm to each side, less than "
            f"one element (mechanics.mesh.near_mm {near:g} mm); take a finer mesh{remedy}"
        )
