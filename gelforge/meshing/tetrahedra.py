"""Quadratic tetrahedra of solids bounded by closed surfaces: conforming at interfaces, fine under the contact.

All surfaces go to the mesher as one complex, so each of them becomes a surface of the mesh within the mesher's envelope.
Every tetrahedron then lies on one side of each surface, which its middle's signed distance gives, and the nodes of the
boundary and of the interfaces are moved onto the surfaces themselves.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gelforge.mechanics.indenters.closed_surface import ClosedSurface
from gelforge.mechanics.meshes.elements import (
    TET10,
    TET10_EDGES,
    TET10_FACES,
    element_gradient,
    lumped_area,
    quadratic_tetrahedra,
)
from gelforge.mechanics.meshes.mesh import Mesh, Sizes, Surface
from gelforge.meshing.solids import Solids, area, enclosed_volume
from gelforge.meshing.tetwild import tetrahedralize

# Volumes, surfaces and shapes of meshed bodies (tests/meshing/test_tetrahedra.py):
EDGE_PER_NODE_DISTANCE = 2.0  # a quadratic tetrahedron has a node at the middle of each edge
# A face whose outward normal has a smaller vertical component is a side: it has no place in the bins
# (tests/meshing/test_tetrahedra.py).
STEEP = 0.1
# The envelope cuts edges off by slivers that look anywhere: a node of which less than this share looks up lies on a side
# (tests/meshing/test_tetrahedra.py).
SLIVER = 0.1
# Times sizes.stray: the mesher and a dome's coarse draft together move a node by less than half of this, and a surface that
# crosses itself by more (tests/meshing/test_tetrahedra.py).
ASTRAY = 5
# Times sizes.stray: the mesh's edge around the base may lie this much next to the surface's
# (tests/meshing/test_tetrahedra.py).
ON_BASE = 2
# Of each surface and of what it encloses, in the default envelope; in proportion in a wider one, as companions have
# (tests/meshing/test_tetrahedra.py).
AREA_TOLERANCE, VOLUME_TOLERANCE = 0.01, 0.005
# Of the straight element's: below this an edge's middle stays on the straight edge (tests/meshing/test_tetrahedra.py).
LEAST_JACOBIAN = 0.2


class MeshingError(ValueError):
    """Solids that were not meshed well: what was found, what to do."""


def tetrahedral_mesh(solids: Solids, sizes: Sizes, touched: np.ndarray) -> Mesh:
    """Return 10-node tetrahedra of the solids, fine where they are touched.

    Parameters
    ----------
    solids : Solids
        From the inside out [mm].
    sizes : Sizes
        Distances between neighbouring nodes [mm]: edges are twice as long.
    touched : numpy.ndarray
        (n, 4), balls (x, y, z, radius) [mm]; none is taken as smaller than sizes.near_radius.

    Returns
    -------
    Mesh
        Quadratic, a region for each solid, fixed on the base.

    Raises
    ------
    MeshingError
        Where a surface of the mesh or its volume is not the one that was given.
    """

    def edge(points):
        away = np.linalg.norm(points[:, None] - touched[:, :3], axis=-1)
        away = np.maximum((away - np.maximum(touched[:, 3], sizes.near_radius)).min(axis=1), 0)
        thin = np.maximum(_thickness(solids, points) / sizes.wall_parts, sizes.near)
        thin = thin + sizes.growth * np.maximum(away + solids.base, 0)
        near = np.minimum(sizes.near + sizes.growth * away, thin)
        return EDGE_PER_NODE_DISTANCE * np.minimum(near, sizes.far)

    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in solids.drafts[:-1]])
    X, tetrahedra = tetrahedralize(
        np.concatenate([vertices for vertices, _ in solids.drafts]),
        np.concatenate([triangles + k for (_, triangles), k in zip(solids.drafts, offsets)]),
        edge,
        EDGE_PER_NODE_DISTANCE * sizes.far,
        sizes.stray,
    )
    middle = X[tetrahedra].mean(axis=1)
    inside = np.stack([surface.distance(middle)[0] < 0 for surface in solids.surfaces], axis=-1)
    kept = inside.any(axis=1)
    inside, used = inside[kept], np.unique(tetrahedra[kept])
    X, tetrahedra = X[used], np.searchsorted(used, tetrahedra[kept])
    skins = [faces_between(tetrahedra, inside[:, k]) for k in range(len(solids.names))]
    X = _snapped(X, tetrahedra, skins, solids, ASTRAY * sizes.stray)
    X, elements = quadratic_tetrahedra(X, tetrahedra)
    X = _curved(X, elements, skins, solids)
    _check(X, elements, inside, solids, max(1.0, sizes.stray / Sizes.envelope))
    fixed, surface = _boundary(X, elements, solids.base, ON_BASE * sizes.stray)
    return Mesh(X, elements, np.argmax(inside, axis=1).astype(np.int32), solids.names, fixed, surface)


def _thickness(solids: Solids, points: np.ndarray) -> np.ndarray:
    """Return the thickness (n,) [mm] of the outermost solid around points: skin and wall; next to it a larger number.

    It is the distance to the outer surface and that to the nearest inner one. Both vanish on the base, which holds the
    wall: it bends most at its root, where elements as wide as the wall are too stiff.
    """
    gaps = [np.abs(surface.distance(points)[0]) for surface in solids.surfaces]
    return gaps[-1] + np.min(gaps[:-1], axis=0, initial=np.inf)


def faces_between(tetrahedra: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return the faces (F, 3 or 6) of chosen (E,) tetrahedra (E, 4 or 10) that no other chosen one shares, from outside."""
    faces = TET10_FACES if tetrahedra.shape[1] == 10 else TET10_FACES[:, :3]
    faces = tetrahedra[chosen][:, faces].reshape(-1, faces.shape[1])
    _, first, count = np.unique(np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def _on(surface: ClosedSurface, points: np.ndarray) -> np.ndarray:
    """Return the nearest points (n, 3) of a surface."""
    gap, normal, _ = surface.distance(points)
    return points - gap[:, None] * normal


def _projected(X: np.ndarray, on: list[np.ndarray], solids: Solids) -> np.ndarray:
    """Return X with the nodes on[k] moved onto surface k; where two surfaces meet, in turns until both are met."""
    X = X.copy()
    for _ in range(3 if len(on) > 1 else 1):
        for nodes, surface in zip(on, solids.surfaces):
            X[nodes] = _on(surface, X[nodes])
    return X


def _volumes(X: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    corner = X[tetrahedra]
    return np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6


def _snapped(X, tetrahedra, skins, solids: Solids, limit: float) -> np.ndarray:
    moved = _projected(X, [np.unique(skin) for skin in skins], solids)
    if (furthest := np.linalg.norm(moved - X, axis=1).max()) > limit:
        raise MeshingError(
            f"the mesh's surfaces lie up to {furthest:.2g} mm off those of the solids {list(solids.names)} (limit "
            f"{limit:g} mm): one of them crosses itself; join its overlapping parts in the program that wrote the file"
        )
    inverted = _volumes(moved, tetrahedra) <= 0
    if inverted.any():
        raise MeshingError(
            f"{inverted.sum()} of {len(tetrahedra)} tetrahedra turn inside out when their nodes move onto the surfaces, "
            f"by up to {np.abs(moved - X).max():.2g} mm: the mesh is too coarse for the shape, or a layer too thin for it; "
            "make mechanics.mesh.near_mm or far_mm smaller"
        )
    return moved


def _check(X, elements, inside, solids: Solids, wider: float) -> None:
    """Refuse a mesh whose surfaces are not the given ones within the tolerances, times wider."""
    volumes = element_gradient(X, elements)[1].sum(axis=1)
    for k, (name, surface) in enumerate(zip(solids.names, solids.surfaces)):
        meshed = lumped_area(X, faces_between(elements, inside[:, k])).sum()
        for quantity, value, given, tolerance in (
            ("volume", volumes[inside[:, k]].sum(), enclosed_volume(surface), VOLUME_TOLERANCE),
            ("surface", meshed, area(surface), AREA_TOLERANCE),
        ):
            if abs(value / given - 1) > wider * tolerance:
                raise MeshingError(
                    f"solid {name}: the mesh's {quantity} is {value:.6g}, given is {given:.6g} (limit "
                    f"{wider * tolerance:.1%}); the surface crosses itself, or mechanics.mesh.far_mm is too large for the "
                    "shape: make it smaller"
                )


def _jacobian_ratio(X: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Return each element's least volume factor at its nodes and points over the straight element's (E,)."""
    points = np.concatenate([TET10.nodes, TET10.points])
    factor = np.linalg.det(np.einsum("enx,gnk->egxk", X[elements], TET10.natural_gradient(points)))
    return factor.min(axis=1) / (6 * _volumes(X, elements[:, :4]))


def _curved(X, elements, skins, solids: Solids) -> np.ndarray:
    """Return X with the middles of edges on a surface moved onto it, except where that spoils an element."""
    edges = elements[:, TET10_EDGES].reshape(-1, 2)
    middles = elements[:, 4:].ravel()
    key = np.sort(edges, axis=1) @ [len(X), 1]
    on = []
    for skin in skins:
        sides = np.unique(np.sort(skin[:, [[0, 1], [1, 2], [2, 0]]], axis=-1).reshape(-1, 2) @ [len(X), 1])
        on.append(np.unique(middles[np.isin(key, sides)]))
    straight, curved = X, _projected(X, on, solids)
    while (bad := _jacobian_ratio(curved, elements) < LEAST_JACOBIAN).any():
        spoiling = np.unique(elements[bad, 4:])
        if (curved[spoiling] == straight[spoiling]).all():  # straight elements have the ratio 1: cannot be
            raise MeshingError(
                f"{bad.sum()} of {len(elements)} straight tetrahedra have no volume; change mechanics.mesh.near_mm or far_mm"
            )
        curved[spoiling] = straight[spoiling]
    return curved


def _boundary(X: np.ndarray, elements: np.ndarray, base: float, above: float) -> tuple[np.ndarray, Surface]:
    """Return the fixed nodes (N,) and the surface that is touched: the boundary without its part on the base.

    On the base lies what is less than `above` [mm] over it.
    """
    faces = faces_between(elements, np.ones(len(elements), bool))
    fixed = np.zeros(len(X), bool)
    fixed[np.unique(faces)] = X[np.unique(faces), 2] <= base + above
    if not fixed.any():
        raise MeshingError(
            f"no node of the mesh lies at or below the base z = {base:g} mm; correct shape.base_mm"
        )
    faces = faces[~fixed[faces].all(axis=1)]
    corner = X[faces[:, :3]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    up = normal[:, 2] > STEEP * np.linalg.norm(normal, axis=1)
    area, nodes = lumped_area(X, faces), np.unique(faces)
    looks_up = lumped_area(X, faces[up]) > SLIVER * area
    up &= looks_up[faces].all(axis=1)
    return fixed, Surface(nodes, area[nodes], np.isin(nodes, faces[up]), faces[up])


# ------------------------------------------------------------------------------------------------------- files
WRITTEN = (".vtu", ".vtk", ".msh")  # formats that keep elements of both kinds with their regions


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """Write a mesh: nodes [mm], elements, cell data "region" and point data "fixed".

    "region" is the number in mesh.regions; "fixed" is 1 on nodes that are held on the base.

    Parameters
    ----------
    path : str or Path
        Its ending says the format: .vtu, .vtk or .msh (Gmsh). Missing folders above it are made.
    mesh : Mesh
        Of hexahedra or 10-node tetrahedra.

    Raises
    ------
    MeshingError
        For another ending.
    """
    if Path(path).suffix not in WRITTEN:
        raise MeshingError(
            f"{path}: meshes are written as {', '.join(WRITTEN)}, found {Path(path).suffix or 'no ending'!r}; rename it"
        )
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    kind = {8: "hexahedron", 10: "tetra10"}[mesh.elements.shape[1]]
    import meshio  # a fifth of a second, which who meshes blocks does without

    meshio.Mesh(
        mesh.X,
        [(kind, mesh.elements)],
        point_data={"fixed": mesh.fixed.astype(np.int32)},
        cell_data={"region": [mesh.region.astype(np.int32)]},
    ).write(path, file_format="gmsh" if Path(path).suffix == ".msh" else None)  # ANSYS writes .msh too
