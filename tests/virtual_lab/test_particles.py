"""Particles fill the gel as asked, and move as the truth cell says."""

import numpy as np
import pytest
from artificial_truth import DEPTHS, displacement_per_mm, force_at, gel_mesh, small_study, truth_cell
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from gelforge.config import VirtualParticles
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import D4, transform_points, transform_vectors
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.virtual_lab.particles import VirtualLabError, interpolation, place_particles, true_motion

SENSOR = small_study().sensor
GEL_MM3 = 29 * 29 * 4.5


@pytest.mark.parametrize(("diameter", "fraction"), [(0.3, 0.0196), (0.6, 0.0196), (0.6, 0.1)])
def test_particles_fill_their_share_inside_the_gel_without_overlap(diameter, fraction):
    P = place_particles(VirtualParticles(diameter_mm=diameter, volume_fraction=fraction), SENSOR, "a")
    assert_allclose(len(P) * np.pi / 6 * diameter**3 / GEL_MM3, fraction, rtol=0.02)
    r = diameter / 2
    assert (P >= [1.5 + r, 1.5 + r, -6 + r]).all()
    assert (P <= [30.5 - r, 30.5 - r, -1.5 - r]).all()
    assert cKDTree(P).query(P, k=2)[0][:, 1].min() >= diameter
    # uniform: the mean of n uniform numbers scatters by width / sqrt(12 n); 5 of these are never exceeded
    scatter = 5 * (np.array([29, 29, 4.5]) - diameter) / np.sqrt(12 * len(P))
    assert (np.abs(P.mean(axis=0) - [16, 16, -3.75]) < scatter).all()


def test_particles_need_a_layer_follow_the_truth_in_depth_and_outside_is_named():
    # Particles belong to the serial and need a layer
    particles = VirtualParticles(diameter_mm=0.6)
    first, again, other = (place_particles(particles, SENSOR, serial) for serial in ("a", "a", "b"))
    assert_array_equal(first, again)
    assert not np.array_equal(first, other)

    # A sensor without particle layer is refused
    bare = [layer.model_copy(update={"particle_volume_fraction": 0.0}) for layer in SENSOR.layers]
    with pytest.raises(VirtualLabError, match="particle_volume_fraction"):
        place_particles(VirtualParticles(), SENSOR.model_copy(update={"layers": bare}), "a")

    # Points outside and meshes that are no grid are named
    nodes, hexahedra = gel_mesh((4, 4, 2))
    with pytest.raises(VirtualLabError, match="lies in no element"):
        interpolation(nodes, hexahedra, np.array([[16.0, 16.0, -1.0]]))
    bent = nodes.copy()
    bent[hexahedra[3, 0]] += 0.1
    with pytest.raises(VirtualLabError, match="boxes"):
        interpolation(bent, hexahedra, np.array([[16.0, 16.0, -3.0]]))

    # Motion follows the truth in depth
    P = place_particles(VirtualParticles(diameter_mm=0.6), SENSOR, "a")
    motion = true_motion(truth_cell("c", 10.0, 22.0), PlannedCell("c", 10.0, 22.0, tuple(DEPTHS)), P, 32.0)
    assert_array_equal(motion.displacement(0.0), 0)
    assert motion.deepest_mm == 1.0
    for depth in (0.5, 0.8, 1.0):  # linear in depth, as the truth is: PCHIP keeps lines
        exact = depth * displacement_per_mm(P, 10.0, 22.0)
        # 1.2 mm elements under a bell of 4 mm: h^2 / 8 times its curvature, 0.7 / 16 per mm
        assert_allclose(motion.displacement(depth), exact, atol=0.02)
    assert_allclose(motion.force(1.0), force_at(np.array([1.0]), 10, 22)[0], atol=1e-12)
    assert_allclose(motion.unload_force(0.6), force_at(np.array([0.6]), 10, 22)[0], atol=1e-12)

    # A truth cell with mixed phases is refused
    cell = truth_cell("c", 10.0, 10.0)
    mixed = Cell(cell.arrays, cell.attributes | {"phases": ["unload", "load", "load"]})
    with pytest.raises(VirtualLabError, match="loading depths must increase"):
        true_motion(mixed, PlannedCell("c", 10.0, 10.0, tuple(DEPTHS)), np.array([[16.0, 16.0, -3.0]]), 32.0)


def test_interpolation_reproduces_trilinear_fields_in_any_mesh():
    nodes, hexahedra = gel_mesh((5, 4, 3))
    rng = np.random.default_rng(0)
    shuffled = rng.permuted(hexahedra, axis=1)
    points = rng.uniform([1.5, 1.5, -6], [30.5, 30.5, -1.5], (500, 3))
    points = np.concatenate([points, nodes])  # nodes lie on the border of several elements

    def field(X):
        x, y, z = X.T
        return 1 + x - 2 * y + 3 * z

    for connectivity in (hexahedra, shuffled):
        weights = interpolation(nodes, connectivity, points)
        assert_allclose(weights @ field(nodes), field(points), atol=1e-12)  # rounding
    # a product of the coordinates is trilinear within an element only: compare on one element
    one = interpolation(nodes, hexahedra[:1], nodes[hexahedra[0]].mean(axis=0, keepdims=True))
    assert_allclose(one @ nodes.prod(axis=1), nodes[hexahedra[0]].prod(axis=1).mean(), rtol=1e-12)

    # Interpolation accepts float32 nodes
    nodes, hexahedra = gel_mesh()
    weights = interpolation(nodes.astype(np.float32), hexahedra, np.array([[30.49, 1.51, -1.51]]))
    assert_allclose(weights.sum(axis=1), 1, atol=1e-12)

    # Elements of several sizes are found
    mesh = layered_block(Block(16.0, 16.0, (("gel", 6.0),)), 8.0, 8.0, Sizes(0.5, 2.0, 0.5, 2.0))
    assert mesh.hanging.any()
    points = np.random.default_rng(0).uniform([0, 0, -6], [16, 16, 0], (500, 3))
    weights = interpolation(mesh.X, mesh.elements, points)
    assert_allclose(weights @ mesh.X, points, atol=1e-12)  # rounding
    corners = np.diff(weights.indptr)
    span = [np.ptp(mesh.X[weights.indices[a:b]], axis=0) for a, b in zip(weights.indptr, weights.indptr[1:])]
    assert (
        corners.max() == 8 and len(np.unique(np.round(span, 6), axis=0)) > 2
    )  # in elements of several sizes


@pytest.mark.parametrize("symmetry", [name for name in D4 if name != "identity"])
def test_a_mirrored_cell_carries_the_field_and_not_the_particles(symmetry):
    P = place_particles(VirtualParticles(diameter_mm=0.6), SENSOR, "a")
    source = truth_cell("s", 10.0, 13.0)
    x, y = transform_points(symmetry, np.array([10.0, 13.0]), 32.0)
    planned = PlannedCell("m", x, y, tuple(DEPTHS), "s", symmetry)
    motion = true_motion(source, planned, P, 32.0)
    # the bell is round: its image is the bell at the image of the position
    assert_allclose(motion.displacement(1.0), displacement_per_mm(P, x, y), atol=0.02)  # as above
    force = source.arrays["total_force_N"][1]
    assert_allclose(motion.force(1.0), transform_vectors(symmetry, force), atol=1e-12)


def dots_of(serial: str, **keys) -> np.ndarray:
    bare = [layer.model_copy(update={"particle_volume_fraction": 0.0}) for layer in SENSOR.layers]
    dots = {"spacing_mm": 2.0, "depth_mm": 0.3} | keys
    sensor = SENSOR.model_copy(update={"layers": bare, "width_y_mm": 41.0})
    return place_particles(VirtualParticles(diameter_mm=0.6, dots=dots), sensor, serial)


def test_dots_are_a_square_grid_shifted_and_turned_by_the_serial():
    P = dots_of("a", rotation_deg=10.0)
    assert_array_equal(P[:, 2], -0.3)
    assert (P[:, :2] >= 0.3).all() and (P[:, :2] <= np.array([31.7, 40.7])).all()
    distance, _ = cKDTree(P).query(P, k=5)
    inner = (np.minimum(P[:, :2], [32, 41] - P[:, :2]) > 2.5).all(axis=1)
    assert_allclose(distance[inner, 1:], 2.0, atol=1e-9)  # four neighbours each
    # area over area of a dot's square; a strip of half a spacing along the border may hold one more or less
    assert abs(len(P) - 31.4 * 40.4 / 4) < (31.4 + 40.4) / 2

    # Dots are about the middle and shifted and turned from serial to serial
    straight = dots_of("a", offset_mm=0.0, rotation_deg=0.0)
    assert_allclose(straight.mean(axis=0), [16, 20.5, -0.3], atol=1e-9)
    assert_array_equal(dots_of("a"), dots_of("a"))
    middle = straight[cKDTree(straight).query([16, 20.5, -0.3])[1]]
    shifted = [dots_of(serial, rotation_deg=0.0) for serial in "abcdefgh"]
    places = np.array([P[cKDTree(P).query(middle)[1], :2] for P in shifted])
    assert 0.1 < places.std(axis=0).mean() < 0.4  # 0.2 as asked for, of eight draws
    row = [P[np.argsort(np.hypot(*(P[:, :2] - [16, 20.5]).T))[:2]] for P in map(dots_of, "abcdefgh")]
    turned = [np.degrees(np.arctan2(*(b - a)[1::-1])) % 90 for a, b in row]
    assert 0 < np.ptp([(t + 45) % 90 for t in turned]) < 8  # 1 deg as asked for

    # Dots that overlap are refused
    with pytest.raises(VirtualLabError, match="overlap"):
        dots_of("a", spacing_mm=0.5)
