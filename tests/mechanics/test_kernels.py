"""The compiled element loop against its NumPy twin, on distorted elements and at stretches that coincide."""

import numpy as np
import pytest
import specimens
import twins
from numpy.testing import assert_allclose

from gelforge.mechanics.body import Body
from gelforge.mechanics.laws import Ogden
from gelforge.mechanics.sparsity import build_pattern

rng = np.random.default_rng(11)
LAWS = {
    "gel": specimens.GEL,
    "skin": specimens.SKIN,
    "neo_hooke": Ogden((0.1,), (2.0,)),
    "three_terms": Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0)),
}
MESH = specimens.distorted(specimens.box(1), 0.2, rng, boundary=True)
X = MESH.X[MESH.hexahedra[0]]


def affine(F):
    return X @ (np.asarray(F, float) - np.eye(3)).T


TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
DISPLACEMENTS = {
    "none": 0 * X,
    "random": 0.15 * rng.uniform(-1, 1, (8, 3)),
    "turned and random": affine(TURN) + 0.15 * rng.uniform(-1, 1, (8, 3)),
    "two stretches equal": affine(np.diag([1.3, 1.3, 0.6])),
    "nearly equal": affine(np.diag([1.3, 1.3 + 1e-6, 0.6])),
    "barely apart": affine(np.diag([1.3, 1.3 + 1e-4, 0.6])),
    "three equal": affine(1.1 * TURN),
}


def kernel(law, u, p, bulk_to_shear=1000.0):
    """Return the compiled element's response and its dense tangent (24, 24)."""
    free = build_pattern(MESH.hexahedra, np.zeros(8, bool))
    body = Body(MESH, {"gel": law}, bulk_to_shear, free)
    values = np.empty(len(free.indices))
    at_nodes = np.empty((8, 3))
    at_nodes[MESH.hexahedra[0]] = u
    response = body.response(at_nodes, np.array([p]), values)
    dense = np.zeros((24, 24))
    rows = np.repeat(np.arange(24), np.diff(free.indptr))
    dense[rows, free.indices] = dense[free.indices, rows] = values
    order = free.equation[MESH.hexahedra[0]].ravel()
    return response, dense[np.ix_(order, order)]


@pytest.mark.parametrize("u", DISPLACEMENTS.values(), ids=DISPLACEMENTS.keys())
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_kernel_equals_its_twin(law, u):
    p = -0.3 * law.shear_modulus
    bulk = 1000.0 * law.shear_modulus
    response, tangent = kernel(law, u, p)
    twin = twins.element(X, u, p, law, bulk)
    node = MESH.hexahedra[0]
    # Forces: stresses of size mu; f_condensed and p_volume carry the rounding of K (theta - 1), K = 1000 mu.
    mu = law.shear_modulus
    assert_allclose(response.f_mixed[node], twin["f_mixed"], rtol=1e-10, atol=1e-12 * mu)
    assert_allclose(response.f_condensed[node], twin["f_condensed"], rtol=1e-10, atol=1e-11 * mu)
    assert_allclose(response.p_volume[0], twin["p_volume"], rtol=1e-10, atol=1e-11 * mu)
    assert_allclose(response.coupling[0], twin["coupling"], rtol=1e-11, atol=1e-14)
    assert_allclose(response.energy, twin["energy"], rtol=1e-10, atol=1e-14 * mu)
    # Near equal stretches the quotient of differences loses up to five digits, hence 1e-9 of the modulus.
    scale = np.abs(twin["tangent"] - bulk * np.outer(twin["coupling"], twin["coupling"])).max()
    assert_allclose(tangent, twin["tangent"], rtol=1e-9, atol=1e-9 * min(scale, mu))


def test_pressure_of_each_node_force_is_its_own():
    """f_mixed follows the given pressure, f_condensed does not: what makes the iteration a mixed one."""
    u = DISPLACEMENTS["random"]
    (one, _), (other, _) = kernel(specimens.GEL, u, 0.0), kernel(specimens.GEL, u, 0.02)
    assert_allclose(
        other.f_mixed - one.f_mixed, 0.02 * one.coupling[0][np.argsort(MESH.hexahedra[0])], atol=1e-15
    )
    assert np.array_equal(one.f_condensed, other.f_condensed)


def test_smallest_volume_ratio():
    squeezed = affine(np.diag([1.0, 1.0, 0.4]))
    assert kernel(specimens.GEL, squeezed, 0.0)[0].smallest_J == pytest.approx(0.4, rel=1e-12)
    assert kernel(specimens.GEL, affine(np.diag([1.0, 1.0, -0.4])), 0.0)[0].smallest_J == pytest.approx(
        -0.4, rel=1e-12
    )


def test_regions_take_their_own_law():
    """Two elements of different regions: each with the forces that its own law gives alone, bulk modulus included."""
    mesh = specimens.layered_block(
        specimens.Block(1.0, 1.0, (("gel", 1.0), ("skin", 1.0))),
        0.5,
        0.5,
        specimens.Sizes(near=1.0, far=1.0),
    )
    assert len(mesh.hexahedra) == 2
    u = 0.1 * rng.uniform(-1, 1, mesh.X.shape)
    response = Body(mesh, specimens.LAWS, 50.0).response(u, np.zeros(2))
    expected = np.zeros_like(u)
    for nodes, region in zip(mesh.hexahedra, mesh.region):
        law = specimens.LAWS[mesh.regions[region]]
        twin = twins.element(mesh.X[nodes], u[nodes], 0.0, law, 50.0 * law.shear_modulus)
        expected[nodes] += twin["f_condensed"]
    assert_allclose(response.f_condensed, expected, rtol=1e-10, atol=1e-14)
