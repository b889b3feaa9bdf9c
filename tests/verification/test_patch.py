"""Patch test: an affine displacement is a solution, is found, and at a quadratic rate, on distorted meshes."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.laws.models.gent import Gent
from gelforge.mechanics.laws.models.mooney_rivlin import MooneyRivlin
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.laws.models.yeoh import Yeoh
from gelforge.mechanics.linear.sparse import SuperLU, refined_solve

LAWS = {
    "gel": specimens.GEL,
    "skin": specimens.SKIN,
    "neo_hooke": NeoHooke(0.1),
    "mooney_rivlin": MooneyRivlin(0.08, 0.02),
    "yeoh": Yeoh(0.05, -1e-3, 5e-5),
    "gent": Gent(0.1, 10.0),
}
BOXES = {"hexahedra": lambda: specimens.box(4), "tetrahedra": lambda: specimens.tetrahedral(specimens.box(2))}
GENERAL = np.array([[1.25, 0.2, 0.0], [0.1, 0.9, -0.15], [-0.05, 0.1, 0.8]])
ISOCHORIC = GENERAL / np.cbrt(np.linalg.det(GENERAL))
DEFORMATIONS = {"general": GENERAL, "isochoric": ISOCHORIC}


def patch(box, law, bulk_to_shear, rng):
    """Return a body of 4^3 distorted hexahedra, or tetrahedra of as many nodes, whose whole boundary is held."""
    mesh = specimens.distorted(box, 0.3, rng)
    edge = ((mesh.X < mesh.X.min(axis=0) + 1e-9) | (mesh.X > mesh.X.max(axis=0) - 1e-9)).any(axis=1)
    return Body(replace(mesh, fixed=edge), {"gel": law}, bulk_to_shear)


@pytest.fixture(params=LAWS.values(), ids=LAWS.keys())
def law(request):
    return request.param


@pytest.fixture(params=DEFORMATIONS.values(), ids=DEFORMATIONS.keys())
def F(request):
    return request.param


@pytest.fixture(params=BOXES.values(), ids=BOXES.keys())
def box(request):
    return request.param()


@pytest.mark.parametrize("bulk_to_shear", [10.0, 1e4])
def test_an_affine_displacement_leaves_no_inner_force(box, law, F, bulk_to_shear, rng):
    body = patch(box, law, bulk_to_shear, rng)
    u = body.mesh.X @ (F - np.eye(3)).T
    response = body.response(u, np.zeros(len(body.mesh.elements)))
    bulk = bulk_to_shear * law.shear_modulus
    # Rounding of the volume ratio, 1e-16 per operation, times K; forces are stresses times faces of 1/16 mm^2.
    assert_allclose(response.p_volume, bulk * (np.linalg.det(F) - 1), atol=1e-13 * bulk)
    outer = np.linalg.norm(response.f_condensed[body.mesh.fixed], axis=1).max()
    assert np.abs(response.f_condensed[~body.mesh.fixed]).max() < 1e-13 * bulk + 1e-13 * outer
    assert outer > 1e-2 * law.shear_modulus / 16  # there is something to balance


@pytest.mark.parametrize("bulk_to_shear", [10.0, 1e4])
def test_the_affine_solution_is_found_at_a_quadratic_rate(box, law, F, bulk_to_shear, rng):
    """Held affinely at the boundary and started from elsewhere, the mixed Newton iteration finds the affine field."""
    body = patch(box, law, bulk_to_shear, rng)
    exact = body.mesh.X @ (F - np.eye(3)).T
    free = body.pattern.equation >= 0
    u, pressure = exact.copy(), np.zeros(len(body.mesh.elements))
    u[free] += 0.02 * rng.uniform(-1, 1, free.sum())
    values, solver = np.empty(len(body.pattern.indices)), SuperLU(body.pattern)
    errors = []
    for _ in range(9):
        response = body.response(u, pressure, values)
        solver.factor(values)
        du = np.zeros_like(u)
        du[free], _ = refined_solve(solver, body.pattern, values, -response.f_condensed[free], 1e-14, 3)
        pressure = body.linearised_pressure(response, du)
        u = u + du
        errors.append(np.abs(u - exact).max())
    floor = 1e-13  # rounding of u times the condition, K/mu = 1e4 at most, relaxed by the fresh residuals of every step
    assert errors[-1] < floor
    bulk = bulk_to_shear * law.shear_modulus
    assert_allclose(pressure, bulk * (np.linalg.det(F) - 1), atol=floor * bulk)
    # e_k+1 < C e_k^2 at the last step above rounding; C is 10 to 750 per mm here. With a wrong tangent e_k+1 is a share of
    # e_k, however small that is, and the quotient grows without end.
    before, after = [e for e in errors if e > 10 * floor][-2:]
    assert after < 5e3 * before**2, errors
