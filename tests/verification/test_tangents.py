"""Taylor halving: energy, forces and tangents belong together, with contact on."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.forces import STICK
from gelforge.mechanics.contact.surface import Iterate
from gelforge.mechanics.linear.sparsity import symmetric_product
from gelforge.mechanics.meshes.mesh import layered_block


def halving_rates(remainder, steps):
    """Return the rates with which remainder(h) falls as h is halved."""
    sizes = [np.linalg.norm(remainder(h)) for h in steps]
    return np.log2(np.divide(sizes[:-1], sizes[1:]))


def product(pattern, values, direction):
    """Return K direction (N, 3) at the free degrees of freedom."""
    free, y = pattern.equation >= 0, np.empty(pattern.size)
    symmetric_product(pattern.indptr, pattern.indices, values, direction[free], y)
    out = np.zeros_like(direction)
    out[free] = y
    return out


@pytest.fixture(scope="module", params=["hexahedra", "tetrahedra"])
def deformed(request):
    """Return a body and a large random displacement, free of inverted elements: stretches of 0.6 to 1.5."""
    rng = np.random.default_rng(13)
    mesh = layered_block(specimens.BLOCK, *specimens.CORNER, replace(specimens.SIZES))
    if request.param == "tetrahedra":
        even = specimens.Sizes(near=2.0, near_radius=2.5, far=2.0)
        mesh = specimens.tetrahedral(layered_block(specimens.BLOCK, *specimens.CENTRE, even))
    body = Body(specimens.distorted(mesh, 0.15, rng), specimens.LAWS, 1000.0)
    # The slopes of a quadratic field are up to four times those of a linear one with the same values.
    u = (0.12 if request.param == "hexahedra" else 0.06) * rng.uniform(-1, 1, mesh.X.shape)
    u[mesh.fixed] = 0
    u = body.spread(u)
    assert 0.3 < body.response(u, np.zeros(len(mesh.elements))).smallest_J < 0.8
    return body, u


def free_direction(body, rng):
    return body.spread(rng.uniform(-1, 1, body.mesh.X.shape) * ~body.mesh.fixed[:, None])


def test_force_and_pressure_are_derivatives(deformed, rng):
    body, u = deformed
    none, v = np.zeros(len(body.mesh.elements)), free_direction(body, rng)
    start = body.response(u, none)
    slope = np.vdot(start.f_condensed, v)

    def remainder(h):
        return body.response(u + h * v, none).energy - start.energy - h * slope

    # 2 plus the third-order term, of relative size h / (element size) = 1e-3 at the first step.
    assert_allclose(halving_rates(remainder, 1e-3 * 0.5 ** np.arange(5)), 2, atol=0.02)

    # Linearised pressure is the derivative of the pressure
    def remainder(h):
        return body.response(u + h * v, none).p_volume - body.linearised_pressure(start, h * v)

    assert_allclose(halving_rates(remainder, 1e-3 * 0.5 ** np.arange(5)), 2, atol=0.02)


def test_body_tangents_are_the_derivatives_of_the_force(deformed, rng):
    """d f_condensed/du is the tangent at the pressures of the volume change."""
    body, u = deformed
    none, v, values = (
        np.zeros(len(body.mesh.elements)),
        free_direction(body, rng),
        np.empty(len(body.pattern.indices)),
    )
    start = body.response(u, none)
    body.response(u, start.p_volume, values)
    change = product(body.pattern, values, v)
    free = body.pattern.equation >= 0

    def remainder(h):
        return (body.response(u + h * v, none).f_condensed - start.f_condensed - h * change)[free]

    assert_allclose(halving_rates(remainder, 1e-3 * 0.5 ** np.arange(5)), 2, atol=0.02)

    # The mixed tangent: f_mixed at fixed p, plus K/V c c^T.
    v, values = free_direction(body, rng), np.empty(len(body.pattern.indices))
    p = 0.02 * rng.normal(size=len(body.mesh.elements))
    start = body.response(u, p, values)
    growth = body.linearised_pressure(start, v) - start.p_volume
    volumetric = np.zeros_like(u)
    np.add.at(volumetric, body.mesh.elements, growth[:, None, None] * start.coupling)
    change = (product(body.pattern, values, v) - body.gathered(volumetric))[free]

    def remainder(h):
        return (body.response(u + h * v, p).f_mixed - start.f_mixed)[free] - h * change

    assert_allclose(halving_rates(remainder, 1e-3 * 0.5 ** np.arange(5)), 2, atol=0.02)


def last_step(press, depths):
    """Return the states before and after the last step of a press, parts of the depths asked for included."""
    steps = []
    start = press.start(*specimens.CORNER)
    centres = start.centre - np.outer(depths, [0.0, 0.0, 1.0])
    for _ in press.follow(start, centres, watch=lambda *pair: steps.append(pair)):
        pass
    return steps[-1]


def test_global_tangent_with_contact(rng):
    """R(u) = internal minus contact forces, off equilibrium, with sticking and newly touched nodes.

    At this friction nothing slips: the derivative of a slipping node's force, which its own slip decides, is in
    tests/mechanics/test_contact.py.
    """
    press = specimens.press(specimens.CORNER, replace(specimens.TO_ROUNDING, friction=5.0))
    body, pattern = press.body, press.body.pattern
    old, now = last_step(press, [0.5, 1.0])
    on = now.contact_pressure > 0
    u = now.u + 2e-5 * free_direction(body, rng)  # gaps of 1e-5 mm: states stay
    step = press.contact.step(old, now.centre)

    def evaluate(u):
        gap = press.contact.gap(u, now.centre)
        at = Iterate(u, now.pressure, now.contact_pressure, now.friction_force, on, *gap)
        return press._evaluate(at), press.contact.forces(at, step)

    def unbalanced(u):
        response, contact = evaluate(u)
        force = response.f_condensed.copy()
        force[press.surface] -= contact.f_consistent
        return force, contact.state

    response, contact = evaluate(u)
    state, newly = contact.state, on & (old.contact_state == 0)
    assert (state == STICK).sum() >= 10
    assert newly.sum() >= 1
    values = np.empty(len(pattern.indices))
    body.response(u, response.p_volume, values)
    v = free_direction(body, rng)
    change = product(pattern, values, v)
    change[press.surface] += np.einsum("sij,sj->si", contact.stiffness_consistent, v[press.surface])
    start, _ = unbalanced(u)
    free = pattern.equation >= 0

    def remainder(h):
        force, moved = unbalanced(u + h * v)
        assert np.array_equal(moved, state)  # smooth only while no node changes between stick and slip
        return (force - start - h * change)[free]

    def contact_remainder(h):  # the same where contact acts: the body's stiffer nodes cannot hide it
        force, _ = unbalanced(u + h * v)
        return (force - start - h * change)[press.surface[on]]

    for rest in (remainder, contact_remainder):
        assert_allclose(halving_rates(rest, 1e-4 * 0.5 ** np.arange(4)), 2, atol=0.02)


def test_newton_factorises_the_derivative_up_to_friction():
    """Without friction and with a flat turn the factorised matrix itself is the derivative: nothing is left out."""
    settings = specimens.Settings(friction=0.0)
    press = specimens.press(specimens.CORNER, settings)
    old, now = last_step(press, [0.4, 0.8])
    on = now.contact_pressure > 0
    gap, normal, turn = press.contact.gap(now.u, now.centre)
    at = Iterate(now.u, now.pressure, now.contact_pressure, now.friction_force, on, gap, normal, turn)
    contact = press.contact.forces(at, press.contact.step(old, now.centre))
    left_out = contact.stiffness - contact.stiffness_consistent
    force = press.area * (now.contact_pressure - press.contact.eps_n * gap) * on
    assert_allclose(left_out, force[:, None, None] * turn, atol=1e-14)
