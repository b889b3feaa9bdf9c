"""Nodal forces to bins: the rule against numerical integration, nothing lost."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.config import Bins, Layer, Sensor
from gelforge.indentation.cells.binning import (
    bin_forces,
    node_shares,
    surface_shares,
    without_dust,
)
from gelforge.indentation.sensor.unrolled import bin_points
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block

WIDTH, DEPTH, NX, NY = 8.0, 6.0, 5, 4
SENSOR = Sensor(
    width_x_mm=WIDTH,
    width_y_mm=DEPTH,
    layers=[Layer(name="gel", thickness_mm=2.0, material="soft")],
    wall_mm=0.0,
    bins=Bins(nx=NX, ny=NY),
)
BLOCK = Block(WIDTH, DEPTH, (("gel", 2.0),))
MESHES = {
    "halved": layered_block(BLOCK, 3.1, 2.9, Sizes(near=0.2, near_radius=0.6, growth=0.4, far=0.9)),
    "even, larger than a bin": layered_block(BLOCK, 3.1, 2.9, Sizes(near=2.5, far=2.5)),
}
rng = np.random.default_rng(6)


@pytest.fixture(params=MESHES.values(), ids=MESHES.keys())
def mesh(request):
    return request.param


@pytest.mark.parametrize("rule", [surface_shares, node_shares])
def test_every_top_node_gives_all_it_has(rule, mesh):
    shares = rule(mesh, SENSOR)
    assert_allclose(np.asarray(shares.sum(axis=0)).ravel(), mesh.surface.top.astype(float), rtol=1e-13)
    assert shares.data.min() >= 0


def test_shares_equal_numerical_integration(mesh):
    """Each node's shape function on the surface, sampled at 100 points a millimetre and ties included."""
    n = 100
    x, y = ((np.arange(int(width * n)) + 0.5) / n for width in (WIDTH, DEPTH))
    owner = NX * (y / DEPTH * NY).astype(int)[:, None] + (x / WIDTH * NX).astype(int)[None, :]
    integral = np.zeros((NX * NY, len(mesh.X)))
    for face in mesh.surface.faces:
        low, high = mesh.X[face[0], :2], mesh.X[face[2], :2]
        ix, iy = (np.flatnonzero((p > a) & (p < b)) for p, a, b in zip((x, y), low, high))
        s, t = ((p[i] - a) / (b - a) for p, i, a, b in zip((x, y), (ix, iy), low, high))
        for corner, (u, v) in zip(face, [(1 - s, 1 - t), (s, 1 - t), (s, t), (1 - s, t)]):
            np.add.at(integral[:, corner], owner[np.ix_(iy, ix)], np.outer(v, u) / n**2)
    if mesh.ties is not None:
        integral = integral @ mesh.ties
    expected = integral[:, mesh.surface.nodes]
    expected[:, mesh.surface.top] /= expected[:, mesh.surface.top].sum(axis=0)
    # an edge of a face or a bin may cut a row of samples: half a row of 0.01 mm on functions 0.4 mm wide, 2.5 %
    assert_allclose(surface_shares(mesh, SENSOR).toarray(), expected, atol=0.025)


def test_bins_keep_the_total_and_a_uniform_pressure_fills_them_alike(mesh):
    """Forces of a uniform pressure are the integrals of the shape functions: the bins carry equal forces."""
    top = mesh.surface.top
    area = layered_area(mesh)
    assert_allclose(surface_shares(mesh, SENSOR)[:, top] @ area, WIDTH * DEPTH / (NX * NY), rtol=1e-12)

    # Bins keep the total of the top
    forces = rng.normal(size=(2, len(mesh.surface.nodes), 3))
    found = bin_forces(forces, surface_shares(mesh, SENSOR))
    assert found.shape == (2, NX * NY, 3)
    assert_allclose(found.sum(axis=1), forces[:, mesh.surface.top].sum(axis=1), atol=1e-12)


def layered_area(mesh):
    """Return the integrals of the top nodes' shape functions over the top alone."""
    corner = mesh.X[mesh.surface.faces]
    size = np.prod(corner[:, 2, :2] - corner[:, 0, :2], axis=1)
    area = np.zeros(len(mesh.X))
    np.add.at(area, mesh.surface.faces, size[:, None] / 4)
    area = area if mesh.ties is None else mesh.ties.T @ area
    return area[mesh.surface.nodes[mesh.surface.top]]


def test_nodes_on_edges_triangles_and_bin_points_are_in_their_bins():
    # Node rule gives a node on an edge to both bins
    X = np.array([[0.0, 0.0], [0.5, 0.7], [1.6 - 1e-13, 0.7], [1.6, 1.5], [8.0, 6.0]])
    surface = SimpleNamespace(nodes=np.arange(5), top=np.ones(5, bool))
    shares = node_shares(SimpleNamespace(X=X, surface=surface), SENSOR).toarray()
    expected = np.zeros((NX * NY, 5))
    expected[0, [0, 1]] = 1
    expected[[0, 1], 2] = 0.5
    expected[[0, 1, NX, NX + 1], 3] = 0.25
    expected[-1, 4] = 1
    assert_allclose(shares, expected)

    # Six node triangles fill the bins that they lie in. A rectangle of two, over x 4 to 8 and y 0 to 2 mm of a
    # sensor with bins of 2 mm: bins 2 and 3 of the first row
    corner = np.array([[4.0, 0, 0], [8, 0, 0], [8, 2, 0], [4, 2, 0]])
    halves = [(0, 1, 2), (0, 2, 3)]
    sides = sorted({tuple(sorted((f[k], f[(k + 1) % 3]))) for f in halves for k in range(3)})
    X = np.concatenate([corner, [(corner[i] + corner[j]) / 2 for i, j in sides]])
    faces = np.array(
        [[*f, *(4 + sides.index(tuple(sorted((f[k], f[(k + 1) % 3])))) for k in range(3))] for f in halves]
    )
    triangles = SimpleNamespace(X=X, ties=None, surface=SimpleNamespace(faces=faces, nodes=np.arange(len(X))))
    sensor = SENSOR.model_copy(update={"bins": Bins(nx=4, ny=3)})
    share = surface_shares(triangles, sensor)
    assert_allclose(share.sum(axis=0), 1.0)
    assert_allclose(share[[2, 3]].sum(axis=0), 1.0)
    left = X[:, 0] == 4.0  # their shape functions lie between x = 4 and 6 for the most part
    assert (share[[2]].toarray()[0, left] > 0.5).all()

    # Bin points count x first and dust becomes zeros
    points = bin_points(SENSOR.model_copy(update={"bins": Bins(nx=4, ny=3)}))
    assert points.shape == (12, 3)
    assert_allclose(points[[0, 1, 4, 11]], [[1, 1, 0], [3, 1, 0], [1, 3, 0], [7, 5, 0]])

    # Dust becomes exact zeros
    assert np.array_equal(without_dust(np.array([1e-10, -9e-10, 2e-9, -0.1])), [0, 0, 2e-9, -0.1])
