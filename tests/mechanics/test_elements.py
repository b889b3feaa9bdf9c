"""One battery for every element: its defining properties, and a twin built from monomials. A new one enters ELEMENTS."""

import numpy as np
import pytest
import specimens
import twins
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull

from gelforge.mechanics.meshes.elements import (
    ELEMENTS,
    HEX8_CORNERS,
    TET10_EDGES,
    TET10_FACES,
    element_gradient,
    lumped_area,
    quadratic_tetrahedra,
)

rng = np.random.default_rng(3)
INSIDE = {8: rng.uniform(-1, 1, (20, 3)), 10: rng.dirichlet(np.ones(4), 20)[:, 1:]}
BLOCKS = {8: specimens.box, 10: lambda n, length=1.0: specimens.tetrahedral(specimens.box(n, length))}
# Polynomials that each quadrature must integrate over its natural element: at most this degree in each direction (2 points
# of Gauss), or in total; the hexahedron's volume factor is quadratic in each direction, the tetrahedron's stiffness in all.
EXACT = {
    8: [e for e in np.ndindex(4, 4, 4)],
    10: [e for e in np.ndindex(3, 3, 3) if sum(e) <= 2],
}
kinds = pytest.mark.parametrize("A", ELEMENTS, ids=[kind.name for kind in ELEMENTS.values()])


def exact_integral(A, exponents):
    """Return the integral of r^i s^j t^k over [-1, 1]^3, or i! j! k! / (i + j + k + 3)! over the unit tetrahedron."""
    if A == 8:
        return np.prod([(1 + (-1) ** e) / (e + 1) for e in exponents])
    factorial = np.cumprod([1.0, *range(1, 12)])
    return np.prod(factorial[list(exponents)]) / factorial[sum(exponents) + 3]


@pytest.fixture(scope="module", params=ELEMENTS, ids=[kind.name for kind in ELEMENTS.values()])
def mesh(request):
    return specimens.distorted(BLOCKS[request.param](3), 0.2, rng, boundary=True)


@kinds
def test_shape_functions_and_slopes_equal_the_twin_and_add_to_one(A):
    assert_allclose(ELEMENTS[A].shape(ELEMENTS[A].nodes), np.eye(A), atol=1e-15)

    # Shape functions and slopes equal the twin
    basis = twins.BASES[A]
    atol = 1e-14  # rounding of the twin's inverted matrix of monomials
    assert_allclose(ELEMENTS[A].shape(INSIDE[A]), [basis.shape(xi) for xi in INSIDE[A]], atol=atol)
    slopes = [basis.slopes(xi) for xi in INSIDE[A]]
    assert_allclose(ELEMENTS[A].natural_gradient(INSIDE[A]), slopes, atol=10 * atol)

    # Partition of unity
    assert_allclose(ELEMENTS[A].shape(INSIDE[A]).sum(axis=-1), 1, rtol=1e-14)
    assert_allclose(ELEMENTS[A].natural_gradient(INSIDE[A]).sum(axis=-2), 0, atol=1e-14)


@kinds
def test_quadrature_is_exact_and_measures_the_volume(A):
    kind = ELEMENTS[A]
    for exponents in EXACT[A]:
        found = kind.weights @ np.prod(kind.points ** np.array(exponents), axis=1)
        assert found == pytest.approx(exact_integral(A, exponents), abs=1e-15), exponents

    # The points integrate det(dX/dxi), at most quadratic in each direction (or constant), exactly
    # on any mesh.
    inner = specimens.distorted(BLOCKS[A](3, 2.0), 0.2, rng)
    _, weight = element_gradient(inner.X, inner.elements)
    assert_allclose(weight.sum(), 8.0, rtol=1e-14)
    affine = inner.X @ np.array([[1.2, 0.3, 0], [0, 0.9, -0.2], [0.1, 0, 1.1]]).T
    _, weight = element_gradient(affine, inner.elements)
    assert_allclose(weight.sum(), ConvexHull(affine).volume, rtol=1e-12)


def test_gradients_equal_the_twin_and_reproduce_linear_fields(mesh):
    gradient, weight = element_gradient(mesh.X, mesh.elements)
    A = mesh.elements.shape[1]
    points, twin = ELEMENTS[A].points, twins.BASES[A].points
    order = [int(np.argmin(np.abs(twin - xi).sum(axis=1))) for xi in points]
    for e, nodes in enumerate(mesh.elements):
        G, w = twins.points(mesh.X[nodes])
        # inverses of jacobians of condition < 30
        assert_allclose(gradient[e], G[order], rtol=1e-11, atol=1e-11)
        assert_allclose(weight[e], w[order], rtol=1e-11)

    # Linear fields are reproduced on a distorted mesh
    slope, constant = rng.normal(size=(3, 3)), rng.normal(size=3)
    gradient, _ = element_gradient(mesh.X, mesh.elements)
    field = mesh.X @ slope.T + constant
    found = np.einsum("eai,eqaj->eqij", field[mesh.elements], gradient)
    # rounding of differences of field
    assert_allclose(found, np.broadcast_to(slope, found.shape), atol=2e-12)


def test_tetrahedra_reproduce_quadratic_fields_and_are_numbered_outwards():
    # The straight tetrahedron reproduces quadratic fields
    mesh = specimens.distorted(BLOCKS[10](3), 0.2, rng, boundary=True)
    B = rng.normal(size=(3, 3, 3))  # u_i = B_ijk X_j X_k
    gradient, _ = element_gradient(mesh.X, mesh.elements)
    field = np.einsum("ijk,nj,nk->ni", B, mesh.X, mesh.X)
    at = np.einsum("qa,eai->eqi", ELEMENTS[10].shape(ELEMENTS[10].points), mesh.X[mesh.elements])
    expected = np.einsum("ijk,eqk->eqij", B + np.swapaxes(B, 1, 2), at)
    found = np.einsum("eai,eqaj->eqij", field[mesh.elements], gradient)
    assert_allclose(found, expected, atol=2e-12)

    # Nodes and faces are numbered outwards and shared
    linear = BLOCKS[10](2)
    corners, N = linear.elements[:, :4], int(linear.elements[:, :4].max()) + 1
    X, elements = quadratic_tetrahedra(linear.X[:N], corners)
    assert np.array_equal(X[:N], linear.X[:N])
    assert np.array_equal(elements[:, :4], corners)
    assert_allclose(X[elements[:, 4:]], X[corners[:, TET10_EDGES]].mean(axis=2), atol=1e-15)
    assert len(np.unique(X.round(12), axis=0)) == len(X)
    # Euler's V - E + F - T = 1 of a ball, with F = (4 T + boundary faces) / 2
    T, sides = len(corners), round((len(corners) / 6) ** (1 / 3))
    assert N - (len(X) - N) + (4 * T + 12 * sides**2) / 2 - T == 1

    # Faces of a tetrahedron look outwards
    X = ELEMENTS[10].nodes
    for face in TET10_FACES:
        corner = X[face[:3]]
        normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
        assert normal @ (corner[0] - X[:4].mean(axis=0)) > 0
        assert_allclose(X[face[3:]], (corner + np.roll(corner, -1, axis=0)) / 2, atol=1e-15)

    # Bottom face counter-clockwise, then the top face above it.
    assert np.array_equal(HEX8_CORNERS[:4, :2], HEX8_CORNERS[4:, :2])
    assert (HEX8_CORNERS[:4, 2] == -1).all()
    assert (HEX8_CORNERS[4:, 2] == 1).all()


@kinds
def test_an_inverted_element_is_refused_by_number(A):
    mesh = BLOCKS[A](2)
    mirrored = mesh.X.copy()
    mirrored[mesh.elements[5], 0] *= -1
    with pytest.raises(ValueError, match=r"element 0 has volume factor -.*untangle"):
        element_gradient(mirrored, mesh.elements[5:6])


def test_lumped_areas_carry_linear_tractions_and_converge():
    """All shares positive; on a flat face they integrate a linear field, whatever the triangle."""
    for triangle in rng.normal(size=(5, 3, 3)):
        X = np.concatenate([triangle, (triangle + np.roll(triangle, -1, axis=0)) / 2])
        area = lumped_area(X, np.arange(6)[None])
        size = np.linalg.norm(np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])) / 2
        assert area.min() > 0
        assert area.sum() == pytest.approx(size, rel=1e-13)
        assert_allclose(area @ X, size * triangle.mean(axis=0), rtol=1e-12)

    # A cap of a sphere with its middles on it: four flat triangles per face err by O(h^2).
    errors = []
    for n in (4, 8, 16):
        r, t = np.meshgrid(
            np.linspace(0.3, 1, 2 * n + 1), np.linspace(0, np.pi / 2, 2 * n + 1), indexing="ij"
        )
        X = np.stack([np.sin(r) * np.cos(t), np.sin(r) * np.sin(t), np.cos(r)], axis=-1).reshape(-1, 3)
        k = np.arange((2 * n + 1) ** 2).reshape(2 * n + 1, -1)
        a, b, c, d = k[:-2:2, :-2:2], k[2::2, :-2:2], k[2::2, 2::2], k[:-2:2, 2::2]
        ab, bc, ca, cd, da = k[1::2, :-2:2], k[2::2, 1::2], k[1::2, 1::2], k[1::2, 2::2], k[:-2:2, 1::2]
        faces = [np.stack(f, axis=-1).reshape(-1, 6) for f in ((a, b, c, ab, bc, ca), (a, c, d, ca, cd, da))]
        area = lumped_area(X, np.concatenate(faces)).sum()
        errors.append(abs(area - np.pi / 2 * (np.cos(0.3) - np.cos(1))))
    assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.1)
