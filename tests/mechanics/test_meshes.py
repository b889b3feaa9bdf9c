"""Meshes of layered blocks: exact regions, conforming, fine where asked, symmetric where the block is."""

from collections import Counter

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.mechanics.elements import hex8_gradient
from gelforge.mechanics.meshes import Block, Sizes, graded_lines, layered_block

PLAIN = Block(32.0, 32.0, (("gel", 4.5), ("skin", 1.5)), wall=1.5)
FLANGE = Block(32.0, 30.0, (("gel", 4.5), ("skin", 1.5)), wall=1.1, flange_width=6.5, flange_height=1.5)
STACK = Block(20.0, 24.0, (("base", 3.0), ("gel", 2.0), ("skin", 0.7)))
SIZES = Sizes(near=0.9, near_radius=3.0, far=2.5, vertical_far=1.2)
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


def test_regions_have_their_exact_volumes(case):
    block, _, mesh = case
    _, weight = hex8_gradient(mesh.X, mesh.hexahedra)
    found = {name: weight[mesh.region == r].sum() for r, name in enumerate(mesh.regions)}
    assert found == pytest.approx(expected_volumes(block), rel=1e-12)


def test_conforming(case):
    """Every face belongs to two elements or to the boundary, whose area is that of the body; no node is left over."""
    block, _, mesh = case
    corners = np.sort(mesh.hexahedra[:, FACES], axis=-1).reshape(-1, 4)
    shared = Counter(map(tuple, corners))
    assert set(shared.values()) == {1, 2}
    ordered = {tuple(sorted(face)): face for face in mesh.hexahedra[:, FACES].reshape(-1, 4)}
    outer = np.array([ordered[face] for face, count in shared.items() if count == 1])
    a, b, _, d = np.moveaxis(mesh.X[outer], 1, 0)
    area = np.linalg.norm(np.cross(b - a, d - a), axis=1).sum()
    wx, wy, f = block.width_x, block.width_y, block.flange_width
    sides = 2 * (wx + wy) * (block.height - block.flange_height) + 2 * (wx + wy + 4 * f) * block.flange_height
    assert area == pytest.approx(2 * (wx + 2 * f) * (wy + 2 * f) + sides, rel=1e-12)
    assert np.array_equal(np.unique(mesh.hexahedra), np.arange(len(mesh.X)))
    assert len(np.unique(np.round(mesh.X, 9), axis=0)) == len(mesh.X)


def test_no_element_crosses_an_interface(case):
    block, _, mesh = case
    interfaces = np.cumsum([thickness for _, thickness in block.layers])[:-1] - block.height
    z = mesh.X[mesh.hexahedra, 2]
    for height in interfaces:
        assert not ((z.min(axis=1) < height - 1e-9) & (z.max(axis=1) > height + 1e-9)).any()


def test_surface_is_the_whole_top_in_order(case):
    block, _, mesh = case
    y, x = np.meshgrid(mesh.surface_y, mesh.surface_x, indexing="ij")
    assert_allclose(mesh.X[mesh.surface], np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), atol=1e-12)
    assert (mesh.surface_x[0], mesh.surface_x[-1]) == (0.0, block.width_x)
    assert (mesh.surface_y[0], mesh.surface_y[-1]) == (0.0, block.width_y)
    assert mesh.surface_area.sum() == pytest.approx(block.width_x * block.width_y, rel=1e-13)


def test_surface_area_integrates_linear_fields(case):
    """The nodes' areas are integrals of their shape functions: they integrate bilinear fields exactly."""
    block, _, mesh = case
    x, y, _ = mesh.X[mesh.surface].T
    wx, wy = block.width_x, block.width_y
    assert mesh.surface_area @ x == pytest.approx(wx**2 * wy / 2, rel=1e-13)
    assert mesh.surface_area @ (x * y) == pytest.approx(wx**2 * wy**2 / 4, rel=1e-13)


def test_fixed_is_the_base(case):
    block, _, mesh = case
    assert np.array_equal(mesh.fixed, np.isclose(mesh.X[:, 2], -block.height, rtol=0, atol=1e-9))
    spread = np.ptp(mesh.X[mesh.fixed, :2], axis=0)
    assert_allclose(
        spread, [block.width_x + 2 * block.flange_width, block.width_y + 2 * block.flange_width], rtol=1e-12
    )


def test_nothing_stands_above_the_flange():
    mesh = layered_block(FLANGE, 16.0, 15.0, SIZES)
    outside = (mesh.X[:, :2] < -1e-9).any(axis=1) | (mesh.X[:, :2] > np.array([32.0, 30.0]) + 1e-9).any(
        axis=1
    )
    assert mesh.X[outside, 2].max() == pytest.approx(1.5 - 6.0, abs=1e-12)


@pytest.mark.parametrize("x", [16.0, 27.0, 5.55])
def test_fine_under_the_contact_and_never_coarser_than_asked(x):
    mesh = layered_block(PLAIN, x, 16.0, Sizes(near=0.5, near_radius=3.6, far=1.5))
    lines = mesh.surface_x
    size, middle = np.diff(lines), (lines[1:] + lines[:-1]) / 2
    # The size is met on average over a stretch between two breaks, so one element may be larger by 1 / (2 n), n its
    # number of elements: 5 % for the 29 mm between the walls, two thirds for a 1.5 mm wall at far = 1.5.
    assert size[np.abs(middle - x) < 3.6].max() < 1.05 * 0.5
    assert size.max() < 1.05 * 1.5


def test_finer_settings_give_finer_meshes():
    coarse, fine = (
        layered_block(PLAIN, 16.0, 16.0, Sizes(near=h, far=3 * h, vertical_far=2 * h)) for h in (1.0, 0.5)
    )
    assert 5 < len(fine.hexahedra) / len(coarse.hexahedra) < 11  # 8 at best: breaks and the near radius stay


def test_mesh_of_a_centred_contact_is_symmetric():
    mesh = layered_block(PLAIN, 16.0, 16.0, SIZES)
    assert_allclose(mesh.surface_x + mesh.surface_x[::-1], 32.0, atol=1e-12)
    assert_allclose(mesh.surface_x, mesh.surface_y, atol=1e-12)


def test_meshes_of_mirrored_contacts_are_mirrored():
    one, other = (layered_block(PLAIN, x, 13.0, SIZES).surface_x for x in (24.3, 32 - 24.3))
    assert_allclose(one, 32 - other[::-1], atol=1e-12)


def test_wall_elements_are_kept_where_the_fine_region_is():
    mesh = layered_block(PLAIN, 27.0, 16.0, Sizes(near=0.9, near_radius=3.0, far=2.5, wall_elements=3))
    for lines, low, high in [(mesh.surface_x, 1, 3), (mesh.surface_y, 1, 1)]:
        assert (lines <= 1.5 + 1e-9).sum() - 1 == low
        assert (lines >= 30.5 - 1e-9).sum() - 1 == high


def test_flange_as_high_as_an_interface_adds_no_sliver():
    """3.9 + 3.8 and 7.7 differ by rounding: two breaks at one height must not make elements 1e-15 mm thick."""
    block = Block(
        10.0, 10.0, (("base", 3.9), ("gel", 3.8), ("skin", 1.5)), 1.0, flange_width=2.0, flange_height=7.7
    )
    mesh = layered_block(block, 5.0, 5.0, Sizes(1.0, 2.0, 2.0))
    assert np.diff(np.unique(mesh.X[:, 2])).min() > 0.1


def test_graded_lines_pass_through_their_breaks():
    breaks = [0.0, 1.5, 4.0, 4.2, 9.0]
    lines = graded_lines(breaks, lambda x: 0.3 + 0.1 * x, [1, 2, 3, 1])
    assert set(breaks) <= set(lines)
    assert (np.diff(lines) > 0).all()
    assert ((lines > 4.0) & (lines < 4.2)).sum() == 2
