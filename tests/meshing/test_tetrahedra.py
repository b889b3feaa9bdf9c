"""Tetrahedral meshes of layered solids: on the surfaces, one side each, of the wanted sizes, the same every time."""

import meshio
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from small_shapes import SHAPES, SIZES

from gelforge.config.parts.mechanics import Mesh as MeshSizes
from gelforge.indentation.sensor.sensor_mesh import sizes_of
from gelforge.mechanics.indenters.closed_surface import closed_surface
from gelforge.mechanics.meshes.elements import element_gradient, lumped_area
from gelforge.mechanics.meshes.mesh import Block, Sizes
from gelforge.meshing import tetrahedra, tetwild
from gelforge.meshing.solids import Solids, area, block_solids, dome_solids, enclosed_volume
from gelforge.meshing.tetrahedra import MeshingError, faces_between, tetrahedral_mesh, write_mesh

ON_SURFACE_MM = 0.005  # what the sensor's maker can tell from the true surface


def region_is(meshed, name):
    return meshed.mesh.region == meshed.mesh.regions.index(name)


def test_interface_and_boundary_are_surfaces_of_the_mesh(meshed):
    """Its area within 1 %, its nodes on it, the volume inside it within 0.5 %."""
    inner, mesh = meshed.solids.surfaces[0], meshed.mesh
    faces = faces_between(mesh.elements, region_is(meshed, "gel"))
    assert lumped_area(mesh.X, faces).sum() == pytest.approx(area(inner), rel=0.01)
    assert np.abs(inner.distance(mesh.X[np.unique(faces)])[0]).max() < ON_SURFACE_MM
    volume = element_gradient(mesh.X, mesh.elements)[1].sum(axis=1)
    assert volume[region_is(meshed, "gel")].sum() == pytest.approx(enclosed_volume(inner), rel=5e-3)
    assert volume.sum() == pytest.approx(enclosed_volume(meshed.solids.surfaces[-1]), rel=5e-3)

    # No corner of the skin lies deeper in the gel, no corner of the gel further out, than nodes lie
    # off the interface.
    gap = inner.distance(mesh.X)[0]
    inside = region_is(meshed, "gel")
    assert gap[mesh.elements[inside]].max() < ON_SURFACE_MM
    assert gap[mesh.elements[~inside]].min() > -ON_SURFACE_MM

    # Boundary nodes lie on the given surface
    mesh = meshed.mesh
    boundary = np.unique(faces_between(mesh.elements, np.ones(len(mesh.elements), bool)))
    assert np.abs(meshed.solids.surfaces[-1].distance(mesh.X[boundary])[0]).max() < ON_SURFACE_MM


def test_edges_are_curved_and_as_long_as_asked_under_the_contact(meshed):
    mesh = meshed.mesh
    ratio = tetrahedra._jacobian_ratio(mesh.X, mesh.elements)
    assert ratio.min() >= tetrahedra.LEAST_JACOBIAN
    if meshed.name == "dome":
        corners = mesh.X[mesh.surface.faces[:, :2]].mean(axis=1)
        assert np.linalg.norm(mesh.X[mesh.surface.faces[:, 3]] - corners, axis=1).max() > 0.005

    # Half an edge is about near within near_radius; fTetWild's edges scatter by a third about what
    # is wanted.
    ends = mesh.X[mesh.surface.faces[:, [[0, 1], [1, 2], [2, 0]]]]
    distance = np.linalg.norm(ends.mean(axis=2) - meshed.touched[0, :3], axis=-1)
    half = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1) / 2
    near, away = half[distance < SIZES.near_radius].mean(), half[distance > 4.0].mean()
    assert near == pytest.approx(SIZES.near, rel=0.35)
    assert away > 1.5 * near


def test_walls_near_the_contact_are_finer_and_crossing_surfaces_refused():
    # A wall next to the contact has more elements and one that is far as many
    solids = block_solids(Block(24.0, 8.0, (("gel", 2.5), ("skin", 1.0)), wall=1.5))

    def in_walls(parts):
        sizes = Sizes(near=0.25, near_radius=1.0, growth=0.3, far=1.5, wall_parts=parts)
        mesh = tetrahedral_mesh(solids, sizes, np.array([[20.0, 4.0, 0.0, 0.0]]))
        x, _, z = mesh.X[mesh.elements[:, :4]].mean(axis=1).T
        return [int(((z < -1.5) & wall).sum()) for wall in (x > 22.5, x < 1.5)]

    (two, two_far), (one, one_far) = in_walls(2.0), in_walls(1.0)
    assert two > 1.5 * one and two_far == one_far

    # A surface that crosses itself is refused. Two overlapping blocks as one surface: the mesh has no surface where
    # one lies inside the other
    vertices, triangles = SHAPES["block"][0].drafts[-1]
    twice = np.concatenate([vertices, vertices * [0.5, 0.5, 0.5] + [3.0, 2.0, -0.5]])
    both = closed_surface(twice, np.concatenate([triangles, triangles + len(vertices)]))
    solids = Solids(("gel",), (both,), ((both.vertices, both.triangles),), -3.5)
    with pytest.raises(MeshingError, match=r"lie up to 1\.\d mm off those.*crosses itself"):
        tetrahedral_mesh(solids, Sizes(near=1.0, far=2.0), np.array([[5.0, 4.0, 0.0, 0.0]]))


def test_base_and_touched_surface(meshed):
    mesh, surface = meshed.mesh, meshed.mesh.surface
    low = mesh.X[:, 2].min()
    assert mesh.X[mesh.fixed, 2].max() <= low + tetrahedra.ON_BASE * SIZES.stray
    assert mesh.fixed[mesh.X[:, 2] < low + 1e-9].all()
    corner = mesh.X[surface.faces[:, :3]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (normal[:, 2] > 0).all()  # all of the top faces look up, so outwards
    assert surface.area.min() > 0
    if meshed.name == "block":
        height = mesh.X[surface.nodes, 2]
        assert surface.top[height > -1e-9].all()
        assert not surface.top[height < -SIZES.stray].any()  # within it the rim is cut off
        assert surface.area.sum() == pytest.approx(
            10 * 8 + 36 * 3.5, rel=2e-3
        )  # edges are cut by the envelope

    # A base below the body is refused
    with pytest.raises(MeshingError, match=r"no node of the mesh lies at or below the base z = -20"):
        tetrahedra._boundary(meshed.mesh.X, meshed.mesh.elements, -20.0, 0.1)


@pytest.mark.thorough
def test_meshes_repeat_to_the_byte():
    solids, touched = SHAPES["block"]
    sizes = Sizes(near=1.0, near_radius=1.0, far=2.0)
    first = tetrahedral_mesh(solids, sizes, np.array([touched]))
    tetwild._meshed.cache_clear()
    second = tetrahedral_mesh(solids, sizes, np.array([touched]))
    assert first.X.tobytes() == second.X.tobytes()
    assert first.elements.tobytes() == second.elements.tobytes()


@pytest.mark.thorough
def test_a_coarser_mesh_of_a_dome_has_a_third_of_the_elements():
    """Twice the sizes in a wider envelope: edges as long as asked would stray further from a narrower one."""
    sizes = MeshSizes(near_mm=0.3, near_radius_mm=1.5, growth=0.4, far_mm=1.0)
    layers, touched = (("gel", 4.0), ("skin", 1.0)), np.array([[6.0, 5.0, 0.0, 0.0]])

    def elements(wanted):
        used = sizes_of(wanted)
        return len(tetrahedral_mesh(dome_solids(12.0, 10.0, layers, used.stray), used, touched).elements)

    fine, coarse = elements(sizes), elements(sizes.coarser(2.0))
    narrow = elements(sizes.coarser(2.0).model_copy(update={"envelope_mm": sizes.envelope_mm}))
    assert coarse < 0.35 * fine < 0.5 * fine < narrow


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh"])
def test_a_written_mesh_is_read_as_it_was(meshed, tmp_path, suffix):
    path, mesh = tmp_path / f"mesh{suffix}", meshed.mesh
    write_mesh(path, mesh)
    read = meshio.read(path)
    assert {block.type for block in read.cells} == {"tetra10"}
    assert_array_equal(np.concatenate([block.data for block in read.cells]), mesh.elements)
    assert_array_equal(np.concatenate(read.cell_data["region"]), mesh.region)
    assert np.abs(read.points - mesh.X).max() < 1e-12  # .msh is text
    assert_array_equal(read.point_data["fixed"], mesh.fixed)
