"""Viscoelasticity and softening of single elements against closed forms, and their tangent against differences."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose
from scipy.special import erf

from gelforge.mechanics.bodies.memory import Relaxation, RememberingBody, Softening
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.linear.sparsity import build_pattern

rng = np.random.default_rng(3)
CUBE = specimens.box(1)
MESHES = {
    "hexahedron": specimens.distorted(CUBE, 0.15, rng, boundary=True),
    "tetrahedra": specimens.distorted(specimens.tetrahedral(CUBE), 0.15, rng, boundary=True),
}
BRANCHES = Relaxation((0.5, 0.2), (1.0, 10.0))
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
SHEAR = np.array([[1.0, 0.4, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # keeps the volume


RUBBER = NeoHooke(0.02)


def body(mesh=CUBE, law=RUBBER, relaxation=None, softening=None, bulk=50.0):
    free = build_pattern(mesh.elements, np.zeros(len(mesh.X), bool))
    made = RememberingBody(
        mesh,
        {"gel": law},
        bulk,
        {"gel": relaxation} if relaxation else {},
        {"gel": softening} if softening else {},
        pattern=free,
    )
    return made


def stretched(mesh, F):
    return mesh.X @ (F - np.eye(3)).T


def force(made, u, memory, time):
    """Return the internal force (N, 3) without pressure at the end of a step, and what is remembered."""
    made.begin(memory, time)
    response = made.response(u, np.zeros(len(made.mesh.elements)))
    return response.f_mixed, made.remember(u)


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("softening", [None, Softening(0.4, 2e-4, 0.1)], ids=["hard", "soft"])
def test_tangent_is_that_of_the_forces(mesh, softening):
    """After a random step, on the way back: frozen stress, gain and softening all act."""
    made = body(mesh, specimens.GEL, BRANCHES, softening)
    size = 0.1 if mesh.elements.shape[1] == 8 else 0.025
    far, here = (s * np.random.default_rng(4).uniform(-size, size, mesh.X.shape) for s in (1.0, 0.7))
    made.begin(made.initial, 0.3)
    made.begin(made.remember(far), 0.8)
    if softening:
        _, W = made._stress(here, made.initial.peak)
        assert (W < made._memory[2]).all()  # softened at every point

    def condensed(u):
        E = len(mesh.elements)
        p = made.response(u, np.zeros(E)).p_volume
        return made.response(u, p).f_condensed.ravel()

    values = np.empty(len(made.pattern.indices))
    p = made.response(here, np.zeros(len(mesh.elements))).p_volume
    made.response(here, p, values)
    n = mesh.X.size
    K = np.zeros((n, n))
    rows = np.repeat(np.arange(n), np.diff(made.pattern.indptr))
    K[rows, made.pattern.indices] = K[made.pattern.indices, rows] = values
    order = made.pattern.equation.ravel()
    K = K[np.ix_(order, order)]
    du = np.random.default_rng(8).normal(size=mesh.X.shape)
    difference = (condensed(here + 1e-6 * du) - condensed(here - 1e-6 * du)) / 2e-6
    assert_allclose(
        K @ du.ravel(), difference, atol=1e-7 * np.abs(difference).max()
    )  # of central differences


def test_stress_relaxes_exactly_and_a_ramp_at_second_order():
    # Stress at constant strain relaxes exactly. A jump at t = 0 and any steps after it: the law's force times 1 +
    # sum gamma exp(-t / tau)
    made, u = body(relaxation=BRANCHES), stretched(CUBE, SHEAR)
    plain = body(relaxation=Relaxation((0.0,), (1.0,)))
    known, _ = force(plain, u, plain.initial, 0.0)
    memory = made.initial
    for t in (0.0, 0.1, 0.5, 3.0, 3.0, 40.0):
        f, memory = force(made, u, memory, t)
        gain = 1 + sum(g * np.exp(-t / tau) for g, tau in zip(BRANCHES.moduli, BRANCHES.times))
        assert_allclose(f, gain * known, rtol=1e-12, atol=1e-15)

    # A ramp converges at second order. Small shear at a constant rate r: tau = mu r (t + sum gamma tau_k (1 -
    # exp(-t / tau_k)))
    end, size = 2.0, 1e-4
    known = sum(g * t * (1 - np.exp(-end / t)) for g, t in zip(BRANCHES.moduli, BRANCHES.times)) / end + 1
    top = np.isclose(CUBE.X[:, 2], CUBE.X[:, 2].max())
    errors = []
    for steps in (4, 8, 16):
        made, memory = body(relaxation=BRANCHES), None
        memory = made.initial
        for k in range(1, steps + 1):
            F = np.eye(3)
            F[0, 2] = size * k / steps
            f, memory = force(made, stretched(CUBE, F), memory, end * k / steps)
        errors.append(abs(f[top, 0].sum() / (0.02 * size) - known))
    assert errors[2] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.1)


def test_a_turn_turns_the_forces_and_nothing_else():
    softened = {"relaxation": BRANCHES, "softening": Softening(0.3, 1e-3)}
    made = body(**softened)
    _, memory = force(made, stretched(CUBE, np.diag([1.5, 0.8, 1 / 1.2])), made.initial, 1.0)
    still, kept = force(made, stretched(CUBE, SHEAR), memory, 2.0)
    turned, also = force(made, stretched(CUBE, TURN @ SHEAR), memory, 2.0)
    assert_allclose(turned, still @ TURN.T, atol=1e-14)
    assert_allclose(also.stress, kept.stress, atol=1e-15)
    assert_allclose(also.peak, kept.peak, rtol=1e-12)


@pytest.mark.parametrize("lam", [1.1, 1.4, 1.8, 2.0])
def test_softening_is_ogden_and_roxburgh_s(lam):
    """Stretched to 1.8 and back to lam: the neo-Hookean force times 1 - a erf((W_m - W) / (m + b W_m)); 1 beyond 1.8."""
    amount, m, share, mu = 0.4, 4e-3, 0.2, 0.02
    made = body(softening=Softening(amount, m, share), law=NeoHooke(mu))

    def uniaxial(stretch):
        return stretched(CUBE, np.diag([stretch, stretch**-0.5, stretch**-0.5]))

    def W(stretch):
        return mu / 2 * (stretch**2 + 2 / stretch - 3)

    plain = body(softening=Softening(0.0, m), law=NeoHooke(mu))
    _, memory = force(made, uniaxial(1.8), made.initial, 1.0)
    back, after = force(made, uniaxial(lam), memory, 2.0)
    known, _ = force(plain, uniaxial(lam), plain.initial, 1.0)
    eta = 1 - amount * erf(max(W(1.8) - W(lam), 0) / (m + share * W(1.8)))
    assert_allclose(back, eta * known, rtol=1e-10, atol=1e-15)
    assert_allclose(after.peak, W(max(lam, 1.8)), rtol=1e-12)


def test_the_softened_energy_is_that_of_the_forces_and_time_runs_forwards():
    # The softened energy is that of the forces
    made = body(softening=Softening(0.4, 1e-3, 0.1))
    made.begin(made.remember(stretched(CUBE, np.diag([1.8, 1.8**-0.5, 1.8**-0.5]))), 0.0)
    u, du = stretched(CUBE, SHEAR), np.random.default_rng(1).normal(size=CUBE.X.shape)
    values = [made.response(u + h * du, np.zeros(1)).energy for h in (1e-5, -1e-5)]
    response = made.response(u, np.zeros(1))
    assert (values[0] - values[1]) / 2e-5 == pytest.approx(float((response.f_condensed * du).sum()), rel=1e-7)

    # Time does not run backwards
    made = body(relaxation=BRANCHES)
    made.begin(made.initial, 2.0)
    later = made.remember(np.zeros_like(CUBE.X))
    with pytest.raises(ValueError, match="from 2 to 1 s"):
        made.begin(later, 1.0)


def test_nothing_remembered_is_the_plain_body_and_prestretch_a_stretch():
    # Nothing remembered is the plain body
    from gelforge.mechanics.bodies.body import Body

    mesh = MESHES["hexahedron"]
    u, p = 0.05 * rng.uniform(-1, 1, mesh.X.shape), np.array([0.1])
    made = body(mesh, specimens.GEL, Relaxation((0.0,), (1.0,)), Softening(0.0, 1.0), bulk=1000.0)
    made.begin(made.remember(u / 2), 1.0)
    plain = Body(mesh, {"gel": specimens.GEL}, 1000.0).response(u, p)
    assert_allclose(made.response(u, p).f_mixed, plain.f_mixed, rtol=1e-12, atol=1e-16)

    # Prestretch is a stretch from the state without stress. An element held at its shape with prestretch F has the
    # forces of one that was stretched by F, over its own area
    from gelforge.mechanics.bodies.body import Body

    F = np.diag([1.2, 0.9, 1 / (1.2 * 0.9)])
    free = build_pattern(CUBE.elements, np.zeros(8, bool))
    made = Body(CUBE, {"gel": specimens.GEL}, 100.0, free, prestretch={"gel": F})
    assert_allclose(made.deformation_gradient(np.zeros((8, 3))), np.broadcast_to(F, (1, 8, 3, 3)), atol=1e-15)
    response = made.response(np.zeros((8, 3)), np.zeros(1))
    sigma = specimens.GEL.kirchhoff_stress(F)  # J = 1
    for axis in range(3):
        face = np.isclose(CUBE.X[:, axis], CUBE.X[:, axis].max())
        assert response.f_condensed[face, axis].sum() == pytest.approx(sigma[axis, axis], rel=1e-12)  # 1 mm2
