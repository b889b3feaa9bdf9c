"""Surfaces of OBJ files as CAD and modelling programs write them: relative indices, polygons, normals of any number.

meshio needs one normal and one texture coordinate a vertex; trimesh counts relative indices from the end of the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gelforge.config import ConfigError

TRIANGULATE = "triangulate the faces when the file is written (Blender: Triangulated Mesh)"


def obj_triangles(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (V, 3) in the file's unit and the triangles (T, 3) of an OBJ file; polygons are cut into fans.

    Normals, texture coordinates, materials and groups are ignored. Raises ConfigError with the line that cannot be read.
    """
    vertices: list[list[float]] = []
    faces: list[tuple[int, list[int]]] = []  # line number, corners from 0
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ").replace("\\\r\n", " ")
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#", 1)[0].split()
        try:
            if words[:1] == ["v"]:
                vertices.append([float(word) for word in words[1:4]])
            elif words[:1] == ["f"]:
                corners = [int(word.split("/", 1)[0]) for word in words[1:]]
                faces.append((number, [_from_zero(corner, len(vertices)) for corner in corners]))
        except ValueError as error:
            raise ConfigError(
                f"{path}, line {number}: {line[:60]!r} is no vertex or face ({error}); write it again"
            ) from None
    points = np.array([vertex for vertex in vertices if len(vertex) == 3], float).reshape(-1, 3)
    for number, corners in faces:
        if len(points) != len(vertices) or len(corners) < 3 or max(corners) >= len(points):
            raise ConfigError(
                f"{path}, line {number}: a face of the vertices {[c + 1 for c in corners]}, where there are {len(points)};"
                " at least three of them are needed: write the file again"
            )
    fans = [fan(f"{path}, line {number}", points, corners) for number, corners in faces]
    return points, np.concatenate([np.empty((0, 3), np.int64), *fans])


def _from_zero(corner: int, count: int) -> int:
    """Return a vertex's number from 0; negative ones count back from the last vertex above the face."""
    if corner == 0 or corner < -count:
        raise ValueError(f"vertex {corner} of {count}")
    return corner - 1 if corner > 0 else count + corner


def fan(where: str, points: np.ndarray, corners: Sequence[int]) -> np.ndarray:
    """Return a polygon as triangles (T, 3) about its first corner. Raises ConfigError where that leaves its outline."""
    parts = np.array([[corners[0], b, c] for b, c in zip(corners[1:], corners[2:])], np.int64)
    if len(parts) > 1:
        a, b, c = points[parts].transpose(1, 0, 2)
        areas = np.cross(b - a, c - a)
        if (areas @ areas.sum(axis=0) < 0).any():
            raise ConfigError(f"{where}: a face of {len(corners)} corners is not convex; {TRIANGULATE}")
    return parts
