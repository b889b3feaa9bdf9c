"""Meshes of layered blocks: exact regions, continuous fields, fine where asked, symmetric where the block is."""

from collections import Counter

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.mechanics.meshes.elements import element_gradient, hex8_shape
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block

PLAIN = Block(32.0, 32.0, (("gel", 4.5), ("skin", 1.5)), wall=1.5)
FLANGE = Block(32.0, 30.0, (("gel", 4.5), ("skin", 1.5)), wall=1.1, flange_width=6.5, flange_height=1.5)
STACK = Block(20.0, 24.0, (("base", 3.0), ("gel", 2.0), ("skin", 0.7)))
SIZES = Sizes(near=0.6, near_radius=3.0, growth=0.3, far=2.4)
CASES = {
    "wall": (PLAIN, (16.0, 16.0)),
    "wall, corner": (PLAIN, (27.0, 6.1)),
    "flange": (FLANGE, (20.0, 8.0)),
    "three layers": (STACK, (10.0, 9.0)),
}
FACES = [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


@pytest.fixture(params=CASES.values(), ids=CASES.keys(), scope="module")
def case(request):
    block, position = request.param
    return block, position, layered_block(block, *position, SIZES)


def expected_volumes(block):
    names = [name for name, _ in block.layers]
    inner = (block.width_x - 2 * block.wall) * (block.width_y - 2 * block.wall)
    outer = block.width_x * block.width_y
    volumes = {name: thickness * inner for name, thickness in block.layers}
    volumes[names[-1]] = block.layers[-1][1] * outer
    if block.wall:
        volumes["wall"] = (outer - inner) * (block.height - block.layers[-1][1])
    if block.flange_width:
        whole = (block.width_x + 2 * block.flange_width) * (block.width_y + 2 * block.flange_width)
        volumes["flange"] = (whole - outer) * block.flange_height
    return volumes


def test_regions_have_exact_volumes_and_neighbours_one_halving(case):
    # Regions have their exact volumes and every node is used once
    block, _, mesh = case
    _, weight = element_gradient(mesh.X, mesh.elements)
    found = {name: weight[mesh.region == r].sum() for r, name in enumerate(mesh.regions)}
    assert found == pytest.approx(expected_volumes(block), rel=1e-12)

    # Every node is used once
    _, _, mesh = case
    assert np.array_equal(np.unique(mesh.elements), np.arange(len(mesh.X)))
    assert len(np.unique(np.round(mesh.X, 9), axis=0)) == len(mesh.X)

    # Neighbours differ by one halving and cross no interface
    size = np.ptp(mesh.X[mesh.elements], axis=1).max(axis=1)
    largest, smallest = np.zeros(len(mesh.X)), np.full(len(mesh.X), np.inf)
    np.maximum.at(largest, mesh.elements, size[:, None])
    np.minimum.at(smallest, mesh.elements, size[:, None])
    # base cells differ by some tenths, because lines meet walls and interfaces: 3.5 and 2.25 mm next to the corner
    assert (largest / smallest).max() < 2 * 1.6

    # No element crosses an interface
    block, _, mesh = case
    interfaces = np.cumsum([thickness for _, thickness in block.layers])[:-1] - block.height
    z = mesh.X[mesh.elements, 2]
    for height in interfaces:
        assert not ((z.min(axis=1) < height - 1e-9) & (z.max(axis=1) > height + 1e-9)).any()


def test_even_mesh_is_conforming(case):
    """Every face belongs to two elements or to the boundary, whose area is that of the body; no node is left over."""
    block, position, _ = case
    mesh = layered_block(block, *position, Sizes(near=1.2, far=1.2))
    assert mesh.ties is None
    corners = np.sort(mesh.elements[:, FACES], axis=-1).reshape(-1, 4)
    shared = Counter(map(tuple, corners))
    assert set(shared.values()) == {1, 2}
    ordered = {tuple(sorted(face)): face for face in mesh.elements[:, FACES].reshape(-1, 4)}
    outer = np.array([ordered[face] for face, count in shared.items() if count == 1])
    a, b, _, d = np.moveaxis(mesh.X[outer], 1, 0)
    area = np.linalg.norm(np.cross(b - a, d - a), axis=1).sum()
    wx, wy, f = block.width_x, block.width_y, block.flange_width
    sides = 2 * (wx + wy) * (block.height - block.flange_height) + 2 * (wx + wy + 4 * f) * block.flange_height
    assert area == pytest.approx(2 * (wx + 2 * f) * (wy + 2 * f) + sides, rel=1e-12)


def test_tied_fields_are_continuous(case):
    """A random field at the nodes that do not hang, spread by the ties, has one value on both sides of every face.

    Each face of an element is seen from the smaller neighbour: where its corners lie inside a larger element's face, the
    larger one's bilinear interpolation must give what the corners have.
    """
    _, _, mesh = case
    rng = np.random.default_rng(3)
    field = mesh.ties @ rng.normal(size=len(mesh.X))
    low, high = mesh.X[mesh.elements[:, 0]], mesh.X[mesh.elements[:, 6]]
    tested = 0
    for node in np.flatnonzero(mesh.hanging):
        x = mesh.X[node]
        holds = np.flatnonzero(((x > low - 1e-9) & (x < high + 1e-9)).all(axis=1))
        for e in holds:
            xi = 2 * (x - low[e]) / (high[e] - low[e]) - 1
            assert hex8_shape(xi) @ field[mesh.elements[e]] == pytest.approx(field[node], abs=1e-12)
            tested += node not in mesh.elements[e]
    assert tested > 100


@pytest.mark.parametrize(("parts", "through"), [(1.0, {1.5}), (2.0, {0.75}), (4.0, {0.375})])
def test_a_wall_near_the_contact_has_elements_through_its_thickness(parts, through):
    """One that is far from it has not."""
    mesh = layered_block(PLAIN, 27.0, 16.0, Sizes(wall_parts=parts))
    low, high = mesh.X[mesh.elements[:, 0]], mesh.X[mesh.elements[:, 6]]
    beside = (low[:, 0] >= 30.5) & (abs((low + high)[:, 1] / 2 - 16.0) < 3.0) & (high[:, 2] <= -4.8)
    assert set(np.round((high - low)[beside, 0], 9)) == through
    opposite = high[:, 0] <= 1.5
    assert set(np.round((high - low)[opposite & (high[:, 2] <= -1.5), 0], 9)) == {1.5}


@pytest.mark.parametrize(("layers", "rows"), [((4.5, 1.5), 5), ((4.0,), 4), ((2.5, 0.3), 3), ((3.0,), 3)])
def test_a_body_has_a_row_more_where_even_rounding_leaves_tall_cells(layers, rows):
    """At a size of 1.2 mm 4 mm ask for 3.3 rows, and 3 are too few; 2.5 + 0.3 mm ask for 2.3 and have 3."""
    block = Block(12.0, 12.0, tuple((f"layer {k}", thickness) for k, thickness in enumerate(layers)))
    mesh = layered_block(block, 6.0, 6.0, Sizes(near=1.2, far=1.2))
    assert len(np.unique(np.round(mesh.X[:, 2], 9))) - 1 == rows


def test_sizes_fit_one_below_another_without_slivers():
    # Sizes through a height are those that fit one below another
    assert Sizes(near=0.5, far=0.5).through(3.0) == pytest.approx(6.0)
    sizes = Sizes(near=0.3, growth=0.25, far=1.2)
    depths = np.linspace(0.0, 6.0, 60001)
    every = 1 / np.minimum(0.3 + 0.25 * depths, 1.2)
    assert sizes.through(6.0) == pytest.approx(np.trapezoid(every, depths), rel=1e-6)
    assert sizes.through(2.0) == pytest.approx(np.trapezoid(every[:20001], depths[:20001]), rel=1e-6)

    # A line runs through the contact without slivers
    mesh = layered_block(PLAIN, 13.37, 18.2, SIZES)
    assert np.isclose(mesh.X[mesh.surface.nodes], [13.37, 18.2, 0.0]).all(axis=1).sum() == 1

    # Finer settings give finer meshes
    coarse, fine = (
        layered_block(PLAIN, 16.0, 16.0, Sizes(near=h, far=2 * h)).elements for h in (0.75, 0.375)
    )
    assert 5 < len(fine) / len(coarse) < 9  # 8 where all sizes were halved alike: near_radius and walls stay

    # 3.9 + 3.8 and 7.7 differ by rounding: two breaks at one height must not make elements 1e-15 mm
    # thick.
    block = Block(
        10.0, 10.0, (("base", 3.9), ("gel", 3.8), ("skin", 1.5)), 1.0, flange_width=2.0, flange_height=7.7
    )
    mesh = layered_block(block, 5.0, 5.0, Sizes(near=1.0, near_radius=2.0, far=2.0))
    assert np.diff(np.unique(mesh.X[:, 2])).min() > 0.1


def test_the_surface_integrates_linear_fields_and_the_base_is_fixed(case):
    # Surface is top and sides and integrates linear fields
    block, _, mesh = case
    X, top = mesh.X[mesh.surface.nodes], mesh.surface.top
    assert (X[top, 2] == 0).all() and (X[~top, 2] < 0).all()
    on_side = np.isclose(X[:, :2], 0) | np.isclose(X[:, :2], [block.width_x, block.width_y])
    assert on_side.any(axis=1)[~top].all()
    assert not mesh.hanging[mesh.surface.nodes].any()
    above = block.height - (block.flange_height if block.flange_width else 0.0)
    sides = 2 * (block.width_x + block.width_y) * above
    assert mesh.surface.area.sum() == pytest.approx(block.width_x * block.width_y + sides, rel=1e-13)

    # The nodes' areas are integrals of their shape functions: they integrate linear fields exactly,
    # ties and all.
    x, _, z = mesh.X[mesh.surface.nodes].T
    wx, wy = block.width_x, block.width_y
    low = block.flange_height - block.height if block.flange_width else -block.height
    top, sides = wx * wy, 2 * (wx + wy) * -low
    assert mesh.surface.area @ x == pytest.approx((top + sides) * wx / 2, rel=1e-13)
    assert mesh.surface.area @ z == pytest.approx(sides * low / 2, rel=1e-13)

    # Fixed is the base
    block, _, mesh = case
    assert np.array_equal(mesh.fixed, np.isclose(mesh.X[:, 2], -block.height, rtol=0, atol=1e-9))
    spread = np.ptp(mesh.X[mesh.fixed, :2], axis=0)
    assert_allclose(
        spread, [block.width_x + 2 * block.flange_width, block.width_y + 2 * block.flange_width], rtol=1e-12
    )


def test_contacts_are_meshed_as_their_mirror_images_and_below_the_flange():
    # Nothing stands above the flange
    mesh = layered_block(FLANGE, 16.0, 15.0, SIZES)
    outside = (mesh.X[:, :2] < -1e-9).any(axis=1) | (mesh.X[:, :2] > np.array([32.0, 30.0]) + 1e-9).any(
        axis=1
    )
    assert mesh.X[outside, 2].max() == pytest.approx(1.5 - 6.0, abs=1e-12)

    # Meshes of mirrored contacts are mirrored
    one, other = (layered_block(PLAIN, x, 13.0, SIZES) for x in (24.3, 32 - 24.3))
    mirrored = other.X * [-1, 1, 1] + [32, 0, 0]
    order, reverse = (np.lexsort(np.round(X, 9).T) for X in (one.X, mirrored))
    assert_allclose(one.X[order], mirrored[reverse], atol=1e-12)
    assert np.array_equal(one.hanging[order], other.hanging[reverse])


@pytest.mark.parametrize("x", [16.0, 27.0, 5.55, 30.0])
def test_fine_under_the_contact_and_never_coarser_than_asked(x):
    sizes = Sizes(near=0.5, near_radius=3.6, growth=0.3, far=2.0)
    mesh = layered_block(PLAIN, x, 16.0, sizes)
    low, high = mesh.X[mesh.elements[:, 0]], mesh.X[mesh.elements[:, 6]]
    size = (high - low).max(axis=1)
    nearest = np.clip([x, 16.0, 0.0], low, high) - [x, 16.0, 0.0]
    radial = np.maximum(np.hypot(nearest[:, 0], nearest[:, 1]) - sizes.near_radius, 0)
    distance = np.hypot(radial, nearest[:, 2])
    # a cell is halved when it is 1.4 times too large; the base grid's cells are up to 1.5 times its size
    assert (size <= np.maximum(1.4 * (sizes.near + sizes.growth * distance), 0) + 1e-9)[size < 1.9].all()
    assert size.max() <= 1.5 * 2.0
    assert size[distance == 0].max() <= 1.4 * 0.5
