"""Rigid motions cost nothing, and internal forces carry no resultant."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block

FLANGED = Block(4.0, 4.0, (("gel", 1.0), ("skin", 0.5)), wall=0.7, flange_width=1.0, flange_height=0.5)


@pytest.fixture(scope="module", params=["hexahedra", "tetrahedra"])
def mesh(request):
    """Return a distorted mesh with every region and no fixed node."""
    if request.param == "hexahedra":
        mesh = layered_block(FLANGED, 2.0, 2.0, Sizes(near=0.7, near_radius=2.0, far=1.3))
    else:
        mesh = specimens.tetrahedral(
            layered_block(FLANGED, 2.0, 2.0, Sizes(near=1.5, near_radius=9.0, far=1.5))
        )
    mesh = specimens.distorted(mesh, 0.2, np.random.default_rng(4), boundary=True)
    return replace(mesh, fixed=np.zeros(len(mesh.X), bool))


@pytest.fixture(scope="module")
def body(mesh):
    return Body(mesh, specimens.LAWS, 1000.0)


def none(mesh):
    return np.zeros(len(mesh.elements))


def dense_tangent(body, u):
    values = np.empty(len(body.pattern.indices))
    body.response(u, none(body.mesh), values)
    n = body.pattern.size
    dense = np.zeros((n, n))
    rows = np.repeat(np.arange(n), np.diff(body.pattern.indptr))
    dense[rows, body.pattern.indices] = dense[body.pattern.indices, rows] = values
    return dense


def rotation(axis, angle):
    """Return Rodrigues' rotation matrix."""
    a, b, c = np.asarray(axis) / np.linalg.norm(axis)
    W = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    return np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W


TURN = rotation([1.0, -2.0, 0.5], 2.0)


def rigid_modes(x):
    """Return an orthonormal basis (n, 6) of the infinitesimal rigid motions of positions x (N, 3)."""
    moves = [np.tile(e, (len(x), 1)) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
    return np.linalg.qr(np.stack([m.ravel() for m in moves], axis=1))[0]


@pytest.mark.parametrize("turn", [np.eye(3), TURN], ids=["undeformed", "turned"])
def test_exactly_six_rigid_modes(body, mesh, turn):
    K = dense_tangent(body, mesh.X @ (turn - np.eye(3)).T)
    eigenvalues = np.linalg.eigvalsh(K)
    size = eigenvalues[-1]
    # 1e-16 of the largest one (K) per operation; the softest deformation is a shear of the gel, some 1e-6 of it.
    assert np.abs(eigenvalues[:6]).max() < 1e-13 * size
    assert eigenvalues[6] > 1e-8 * size
    assert np.abs(K @ rigid_modes((mesh.X @ turn.T)[~mesh.hanging])).max() < 1e-13 * size


def test_forces_turn_with_the_body_and_have_no_resultant(body, mesh, rng):
    u = mesh.X @ (TURN - np.eye(3)).T + [3.0, -1.0, 2.0]
    response = body.response(u, none(mesh))
    # K times rounding of the volume ratio; faces are about 1 mm^2.
    assert np.abs(response.f_condensed).max() < 1e-13 * body.bulk.max()
    assert response.energy < 1e-20 * body.bulk.max()
    assert response.smallest_J == pytest.approx(1, rel=1e-13)

    # Objectivity of the assembled forces at a random deformation that inverts no element (slopes up
    # to 0.6).
    x = mesh.X + 0.04 * rng.uniform(-1, 1, mesh.X.shape)
    p = 0.01 * rng.normal(size=len(mesh.elements))
    one, turned = (body.response(y - mesh.X, p) for y in (x, x @ TURN.T))
    limit = 1e-12 * body.bulk.max()  # K times rounding
    assert_allclose(turned.f_mixed, one.f_mixed @ TURN.T, atol=limit)
    assert_allclose(turned.f_condensed, one.f_condensed @ TURN.T, atol=limit)
    assert turned.energy == pytest.approx(one.energy, rel=1e-11)

    # Internal forces have neither resultant nor moment
    x = body.spread(mesh.X + 0.1 * rng.uniform(-1, 1, mesh.X.shape))
    response = body.response(x - mesh.X, 0.01 * rng.normal(size=len(mesh.elements)))
    for force in (response.f_mixed, response.f_condensed):
        size = np.abs(force).sum()
        assert np.abs(force.sum(axis=0)).max() < 1e-14 * size
        assert np.abs(np.cross(x, force).sum(axis=0)).max() < 1e-13 * size


def test_small_strain_turns_without_force_only_infinitesimally(mesh):
    body = SmallStrainBody(mesh, specimens.LAWS, 1000.0)
    spin = np.cross([0.3, -0.2, 0.5], mesh.X)
    stretch = mesh.X * [0.1, 0, 0]
    forces = [np.abs(body.response(u, none(mesh)).f_condensed).max() for u in (spin, stretch)]
    assert forces[0] < 1e-13 * forces[1]
