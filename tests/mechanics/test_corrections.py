"""Newton's corrections by the mixed tangent against the condensed tangent, factorised anew without symmetry."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.forces import OPEN, STICK
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.contact.surface import Iterate
from gelforge.mechanics.indenters.shapes import Sphere
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.linear.unsymmetric import UnsymmetricTangent
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import Press
from gelforge.mechanics.solving.prediction import extrapolated


def iterate_of(press, state):
    unknowns = state.u, state.pressure, state.contact_pressure, state.friction_force
    gap = press.contact.gap(state.u, state.centre)
    return Iterate(*unknowns, state.contact_pressure > 0, *gap)


def condensed(press: Press, at: Iterate, response, forces, consistent):
    """Return the corrections of displacements and pressures by a factorisation of the condensed tangent at an iterate."""
    body = press.body
    values = np.empty(len(body.pattern.indices))
    body.response(at.u, at.pressure, values)
    tangent = UnsymmetricTangent(body.pattern, press.surface, "superlu")
    tangent.factor(values, forces.stiffness_consistent if consistent else forces.stiffness)
    force = response.f_condensed.copy()
    force[press.surface] -= forces.f_consistent if consistent else forces.f_condensed
    du = np.zeros_like(force)
    du[press.free] = tangent.solve(-force[press.free][None])[0]
    du = body.spread(du)
    return du, body.linearised_pressure(response, du) - at.pressure


@pytest.fixture(params=["pardiso", "superlu"])
def pressed(request):
    """Return a press and states of it at four depths."""
    press = specimens.press()
    press = Press(press.body, press.indenter, press.settings, request.param)
    return press, specimens.follow(press, specimens.CENTRE, [0.3, 0.45, 0.6, 0.75])


@pytest.mark.parametrize("consistent", [False, True])
def test_a_kept_factorisation_gives_the_correction_of_the_condensed_tangent(pressed, consistent):
    """The factorisation is of a state before: other displacements, another contact, and another coupling of pressures."""
    press, (_, second, third, fourth) = pressed
    corrections, contact = press.corrections, press.contact
    at = iterate_of(press, third)
    corrections.response(at.u, at.pressure)
    corrections.factor(contact.forces(at, contact.step(second, third.centre)))
    at = extrapolated(contact, second, third, 1.0, fourth.centre)
    response = corrections.response(at.u, at.pressure)
    forces = contact.forces(at, contact.step(third, fourth.centre))
    changed = (forces.state != corrections._factored.state).sum()
    assert changed >= 3
    du, dp = corrections.correction(at.pressure, response, forces, consistent, 1e-11)
    expected, expected_dp = condensed(press, at, response, forces, consistent)
    assert_allclose(du, expected, atol=1e-6 * np.abs(expected).max(), rtol=0)
    assert_allclose(dp, expected_dp, atol=1e-6 * np.abs(expected_dp).max(), rtol=0)


def test_another_iterate_or_another_contact_is_corrected_by_the_same_factors(pressed):
    # The tangent of another iterate serves with the coupling of this one. Its correction leaves the linear
    # equations of this iterate: the volumes' exactly, the forces' nearly
    press, (_, second, third, _) = pressed
    corrections, contact = press.corrections, press.contact
    at = iterate_of(press, second)
    corrections.response(at.u, at.pressure)
    near = at.u + 0.02 * (third.u - second.u)
    moved = Iterate(
        near, at.pressure, at.contact_pressure, at.friction, at.active, at.gap, at.normal, at.turn
    )
    response = press.body.response(moved.u, moved.pressure)
    forces = contact.forces(moved, contact.step(second, second.centre))
    corrections.factor(forces)
    du, dp = corrections.correction(moved.pressure, response, forces, False, 1e-11)
    linearised = press.body.linearised_pressure(response, du)
    assert_allclose(moved.pressure + dp, linearised, atol=1e-6 * np.abs(linearised).max())
    expected, _ = condensed(press, moved, response, forces, False)
    assert_allclose(du, expected, atol=0.05 * np.abs(expected).max())

    # Nodes that change their contact cost no further steps. By Woodbury's formula the preconditioner is exact for
    # them; without it each would take a step of its own
    press, (_, second, third, _) = pressed
    at = iterate_of(press, third)
    response = corrections.response(at.u, at.pressure)
    forces = contact.forces(at, contact.step(second, third.centre))
    corrections.factor(forces)
    rim = np.flatnonzero(at.active)[np.argsort(at.contact_pressure[at.active])[:5]]
    active = at.active.copy()
    active[rim] = False
    friction = np.where(active[:, None], at.friction, 0.0)
    lam = np.where(active, at.contact_pressure, 0.0)
    fewer = Iterate(at.u, at.pressure, lam, friction, active, at.gap, at.normal, at.turn)
    others = contact.forces(fewer, contact.step(second, third.centre))
    assert (others.state[rim] == OPEN).all() and (forces.state[rim] != OPEN).all()
    size = np.linalg.norm(others.f_mixed)
    corrections.correction(at.pressure, response, others, False, 1e-4 * size)
    assert corrections._steps <= 2


def test_the_predicted_contact_is_nearly_the_next_one():
    """On a thick layer the contact of a ball grows by similarity; what is extrapolated are its area and its force."""
    mesh = layered_block(
        Block(8.0, 8.0, (("gel", 4.0),)), 4.0, 4.0, Sizes(near=0.25, near_radius=1.5, far=2.0)
    )
    press = Press(Body(mesh, {"gel": NeoHooke(0.01)}, 100.0), Sphere(4.0), Settings())
    _, second, third, fourth = specimens.follow(press, (4.0, 4.0), [0.15, 0.2, 0.25, 0.3])
    at = extrapolated(press.contact, second, third, 1.0, fourth.centre)
    area, on = press.contact.area, fourth.contact_pressure > 0
    assert area[at.active].sum() == pytest.approx(area[on].sum(), rel=0.1)
    assert (at.active & on).sum() > 0.85 * on.sum()
    force, expected = (area * at.contact_pressure).sum(), (area * fourth.contact_pressure).sum()
    assert force == pytest.approx(expected, rel=0.03)  # a straight line along d^1.5 misses 2.3 %
    wrong, change = (
        np.linalg.norm(p - fourth.contact_pressure) for p in (at.contact_pressure, third.contact_pressure)
    )
    assert wrong < 0.5 * change
    new = at.active & (third.contact_pressure == 0)
    assert new.sum() >= 5 and (at.contact_pressure[new] > 0).all()
    states = press.contact.forces(at, press.contact.step(third, fourth.centre)).state
    assert (states[new] == STICK).mean() > 0.5
