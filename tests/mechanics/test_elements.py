"""The hexahedron against its defining properties and a twin built from monomials."""

import numpy as np
import pytest
import specimens
import twins
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull

from gelforge.mechanics.elements import HEX8_CORNERS, hex8_gradient, hex8_natural_gradient, hex8_shape

rng = np.random.default_rng(3)
INSIDE = rng.uniform(-1, 1, (20, 3))


@pytest.fixture(scope="module")
def mesh():
    return specimens.distorted(specimens.box(3), 0.25, rng, boundary=True)


def test_shape_functions_are_one_at_their_node_and_zero_at_the_others():
    assert_allclose(hex8_shape(HEX8_CORNERS), np.eye(8), atol=1e-15)


def test_shape_functions_and_slopes_equal_the_twin():
    assert_allclose(hex8_shape(INSIDE), [twins.shape(xi) for xi in INSIDE], atol=1e-15)
    slopes = [twins.NODAL.T @ twins.monomial_slopes(xi) for xi in INSIDE]
    assert_allclose(hex8_natural_gradient(INSIDE), slopes, atol=1e-15)


def test_partition_of_unity():
    assert_allclose(hex8_shape(INSIDE).sum(axis=-1), 1, rtol=1e-15)
    assert_allclose(hex8_natural_gradient(INSIDE).sum(axis=-2), 0, atol=1e-15)


def test_gradients_and_weights_equal_the_twin(mesh):
    gradient, weight = hex8_gradient(mesh.X, mesh.hexahedra)
    order = [int(np.argmin(np.abs(twins.GAUSS - corner / np.sqrt(3)).sum(axis=1))) for corner in HEX8_CORNERS]
    for e, nodes in enumerate(mesh.hexahedra):
        G, w = twins.points(mesh.X[nodes])
        assert_allclose(
            gradient[e], G[order], rtol=1e-11, atol=1e-12
        )  # inverses of jacobians of condition < 10
        assert_allclose(weight[e], w[order], rtol=1e-12)


def test_linear_fields_are_reproduced_on_a_distorted_mesh(mesh):
    slope, constant = rng.normal(size=(3, 3)), rng.normal(size=3)
    gradient, _ = hex8_gradient(mesh.X, mesh.hexahedra)
    field = mesh.X @ slope.T + constant
    found = np.einsum("eai,eqaj->eqij", field[mesh.hexahedra], gradient)
    assert_allclose(
        found, np.broadcast_to(slope, found.shape), atol=1e-12
    )  # rounding of differences of field


def test_quadrature_measures_the_volume():
    """2 x 2 x 2 points integrate det(dX/dxi), at most quadratic in each direction, exactly on any mesh."""
    inner = specimens.distorted(specimens.box(3, 2.0), 0.25, rng)
    _, weight = hex8_gradient(inner.X, inner.hexahedra)
    assert_allclose(weight.sum(), 8.0, rtol=1e-14)
    affine = inner.X @ np.array([[1.2, 0.3, 0], [0, 0.9, -0.2], [0.1, 0, 1.1]]).T
    _, weight = hex8_gradient(affine, inner.hexahedra)
    assert_allclose(weight.sum(), ConvexHull(affine).volume, rtol=1e-12)


def test_an_inverted_element_is_refused_by_number(mesh):
    X = mesh.X.copy()
    a, b = mesh.hexahedra[5, [0, 6]]
    X[[a, b]] = X[[b, a]]
    hexahedra = mesh.hexahedra[5:6]
    with pytest.raises(ValueError, match=r"element 0 has volume factor -.*untangle"):
        hex8_gradient(X, hexahedra)
