"""What a pressed sensor must balance: forces, moments, energy; measured at the default stopping rule and at rounding."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose
from specimens import CENTRE, CORNER, TO_ROUNDING

from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.solving.balances import force_balance, moment_balance

DEPTHS = [0.4, 0.8, 1.2]


@pytest.fixture(scope="module", params=[Settings(), TO_ROUNDING], ids=["default", "to rounding"])
def pressed(request):
    press = specimens.press(CORNER, request.param)
    return press, specimens.follow(press, CORNER, DEPTHS)


@pytest.fixture(scope="module")
def frictionless():
    press = specimens.press(
        CORNER, Settings(0.0, force_tolerance=1e-11, gap_tolerance=1e-11, volume_tolerance=1e-12)
    )
    return press, specimens.follow(press, CORNER, DEPTHS)


def test_forces_and_moments_balance_about_the_deformed_nodes(pressed):
    """The reaction is summed from internal forces at the base, so that this is not true by construction."""
    press, states = pressed
    limit = 1e-6 if press.settings == Settings() else 1e-10
    for state in states:
        response = press.body.response(state.u, state.pressure)
        assert_allclose(state.reaction, response.f_mixed[press.body.mesh.fixed].sum(axis=0), rtol=1e-12)
        assert force_balance(state) < limit
        assert state.force[2] < -0.05

    # About the ball's centre, over the force times its radius.
    for state in states:
        assert moment_balance(press.body.mesh, state, press.indenter.radius) < limit

    # At finite strain the forces act at the deformed nodes: with the undeformed ones the moments do
    # not close.
    assert moment_balance(press.body.mesh, states[-1], press.indenter.radius, deformed=False) > 1e-3


def test_volumes_contact_and_friction_obey_their_laws(pressed):
    """Mixed and condensed forces agree: the element pressures are K (theta - 1)."""
    press, states = pressed
    for state in states:
        response = press.body.response(state.u, state.pressure)
        error = np.abs(response.p_volume - state.pressure) / press.body.element_bulk
        assert error.max() < press.settings.volume_tolerance

    # No contact node penetrates or pulls, no open node lies inside the ball.
    for state in states:
        on = state.contact_state > 0
        assert np.abs(state.gap[on]).max() < press.settings.gap_tolerance
        assert (state.contact_pressure[on] > 0).all()
        assert (state.contact_pressure[~on] == 0).all()
        assert (state.gap[~on] >= 0).all()
        ray = press.body.mesh.X[press.surface] + state.u[press.surface] - state.centre
        assert_allclose(state.gap, np.linalg.norm(ray, axis=1) - press.indenter.radius, atol=1e-14)

    # Friction is tangential, below mu times the normal force where it sticks, equal to it where it
    # slips.
    mu = press.settings.friction
    for state in states:
        normal, friction = (np.linalg.norm(f, axis=1) for f in (state.normal_force, state.friction_force))
        ray = press.body.mesh.X[press.surface] + state.u[press.surface] - state.centre
        assert np.abs((ray * state.friction_force).sum(axis=1)).max() < 1e-12 * normal.max()
        assert_allclose(friction[state.contact_state == 2], mu * normal[state.contact_state == 2], rtol=1e-12)
        assert (friction[state.contact_state == 1] < mu * normal[state.contact_state == 1]).all()


def test_without_friction_there_is_no_moment_and_a_cycle_closes(frictionless):
    """Normal forces of a ball pass through its centre."""
    press, states = frictionless
    for state in states:
        assert not state.friction_force.any()
        arms = press.body.mesh.X[press.surface] + state.u[press.surface] - state.centre
        moment = np.cross(arms, state.normal_force).sum(axis=0)
        assert np.linalg.norm(moment) < 1e-13 * np.linalg.norm(state.force) * press.indenter.radius

    # Elastic: what is reached on the way back is what was there on the way in.
    press, loading = frictionless
    back = specimens.follow(press, CORNER, [0.8, 0.4], start=loading[-1])
    for there, here in zip(loading[1::-1], back):
        # The stopping rule of 1e-11 of F, times the compliance of the softest node, some ten times the depth over F.
        assert_allclose(here.u, there.u, atol=1e-9)
        assert_allclose(here.force, there.force, atol=1e-9 * np.linalg.norm(there.force))
        assert here.energy == pytest.approx(there.energy, rel=1e-9)


@pytest.mark.parametrize("body", [Body, SmallStrainBody])
def test_work_of_the_ball_is_the_energy(body):
    """d(energy)/d(depth) = F without friction: central differences converge at the second order.

    Depths between two events (a node that touches), where the force is smooth in the depth.
    """
    depth, steps = 0.805, [0.008, 0.004]
    press = specimens.press(CENTRE, Settings(0.0, force_tolerance=1e-11, gap_tolerance=1e-12), body)
    visited = sorted([depth] + [depth + sign * h for h in steps for sign in (-1, 1)])
    states = dict(zip(visited, specimens.follow(press, CENTRE, [0.4, *visited])[1:]))
    contact = [tuple(state.contact_state > 0) for state in states.values()]
    assert len(set(contact)) == 1
    force = -states[depth].force[2]
    errors = [(states[depth + h].energy - states[depth - h].energy) / (2 * h) - force for h in steps]
    assert abs(errors[0]) < 1e-3 * force
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def test_a_cycle_with_friction_costs_work():
    """Friction only dissipates: the ball's work over a closed path is positive, and less is felt on the way back.

    At a friction of 0.05 nodes slide well inside the contact; at 0.45 only those at its edge, which then separate.
    """
    press = specimens.press(CORNER, Settings(0.05, force_tolerance=1e-8, gap_tolerance=1e-8))
    depths = np.concatenate([np.arange(0.1, 0.85, 0.1), np.arange(0.7, 0.05, -0.1)])
    states = specimens.follow(press, CORNER, depths)
    force = np.array([0.0] + [-state.force[2] for state in states] + [0.0])
    path = np.concatenate([[0.0], depths, [0.0]])
    work = np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(path))
    assert work[-1] > 1e-4 * states[7].energy
    for up, down in zip(states[4:7], states[10:7:-1]):
        assert abs(down.force[2]) < abs(up.force[2])


@pytest.fixture(scope="module", params=[0.05, 0.45])
def there_and_back(request):
    """Return a press, and the states before and after every step: down, aside by 0.4 mm, back and up until released.

    At a friction of 0.05 most nodes slide, at 0.45 most stick until the ball moves aside.
    """
    settings = Settings(request.param, force_tolerance=1e-8, gap_tolerance=1e-8)
    press, steps = specimens.press(CORNER, settings), []
    far = 0.1 * np.arange(1, 5)
    aside, deep = np.outer(far, [1.0, 0.3, 0.0]), [0.0, 0.0, -0.8]
    down = np.outer(np.arange(-0.1, -0.85, -0.1), [0.0, 0.0, 1.0])
    path = np.concatenate([down, deep + aside, deep + aside[-2::-1], down[::-1], [[0.0, 0.0, 0.5]]])
    start = press.start(*CORNER)
    for _ in press.follow(start, start.centre + path, watch=lambda *pair: steps.append(pair)):
        pass
    return press, steps


def slip_of(press, before, after):
    """Return the motion (S, 3) [mm] of the surface nodes along the ball in a step; the ball does not turn."""
    return (after.u - before.u)[press.surface] - (after.centre - before.centre)


def test_friction_dissipates_what_the_ball_s_work_does_not_store(there_and_back):
    """Its work -t . slip is never negative: what sticks does not move along the ball, what slips is dragged against it.

    Nodes that touch in the step are left out: part of their motion is free.
    """
    press, steps = there_and_back
    lost = []
    for before, after in steps:
        on = before.contact_state > 0
        lost.append(-(after.friction_force * slip_of(press, before, after)).sum(axis=1)[on])
    # The stopping rule: 1e-8 of forces of 0.3 N times paths of 0.1 mm.
    assert min(work.min(initial=0) for work in lost) > -1e-9
    assert sum(work.sum() for work in lost) > 1e-4

    # Step by step by trapezoids, which miss 0.9 and 0.5 % of friction's work here: nodes come and
    # go in steps of 0.1 mm. The first steps, in which the contact grows from nothing, and the last,
    # in which it ends, are left out.
    by_ball = stored = lost = 0.0
    for before, after in steps[3:-4]:
        mean = (before.force + after.force) / 2
        by_ball += mean @ (after.centre - before.centre)
        stored += after.energy - before.energy
        friction = (before.friction_force + after.friction_force) / 2
        lost -= (friction * slip_of(press, before, after)).sum()
    assert by_ball - stored == pytest.approx(lost, rel=0.02)
    assert lost > 0.003
