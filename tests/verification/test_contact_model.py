"""What must not matter (penalties, path of halvings) and what the variants of the model promise."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose
from specimens import CENTRE, CORNER, TO_ROUNDING

from gelforge.mechanics.body import SmallStrainBody
from gelforge.mechanics.equilibrium import NotConverged, Press, Settings

DEPTHS = [0.4, 0.8]


@pytest.fixture(scope="module")
def reference():
    """Return the states of a corner press at the default penalties, iterated to rounding."""
    return specimens.follow(specimens.press(CORNER), CORNER, DEPTHS)


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_forces_do_not_depend_on_the_normal_penalty(reference, factor):
    """The contact pressure is an unknown of its own; the penalty decides only how fast it is found."""
    settings = replace(TO_ROUNDING, normal_stiffness=factor * TO_ROUNDING.normal_stiffness)
    states = specimens.follow(specimens.press(CORNER, settings), CORNER, DEPTHS)
    for state, known in zip(states, reference):
        # Two solutions of the same equations, each to 1e-11 of F and gaps of 1e-11 mm.
        assert_allclose(state.force, known.force, atol=1e-9 * np.linalg.norm(known.force))
        assert np.array_equal(state.contact_state, known.contact_state)


def test_forces_at_the_default_stopping_rule(reference):
    """Whatever the rule leaves must stay below what a label is good for: 1e-5 of F in totals and nodes.

    This holds only if a node in contact is known as such whichever sign the rounding of its gap has.
    """
    states = specimens.follow(specimens.press(CORNER, Settings()), CORNER, DEPTHS)
    for state, known in zip(states, reference):
        limit = 1e-5 * np.linalg.norm(known.force)
        assert_allclose(state.force, known.force, atol=limit)
        assert_allclose(state.friction_force, known.friction_force, atol=limit)


def test_only_a_node_that_was_open_has_newly_touched():
    """A node in contact with a gap of +1e-6 mm, within the tolerance, keeps its whole slip."""
    press = specimens.press(CORNER)
    old, now = specimens.follow(press, CORNER, DEPTHS)
    kept = (old.contact_state > 0) & (now.contact_state > 0)
    gap, normal, turn = press._gap(now.u, now.centre)
    forces = []
    for shift in (-1e-6, 1e-6):
        nudged = replace(old, gap=np.where(kept, shift, old.gap))
        on = now.contact_pressure > 0
        _, contact = press._evaluate(
            now.u, now.pressure, now.contact_pressure, on, gap, normal, turn, nudged, now.centre
        )
        forces.append(contact["friction"][kept])
    assert_allclose(forces[0], forces[1], atol=1e-15)


def test_softer_friction_springs_change_little():
    """Elastic slip 3 to 20 N/mm^3 changes Fz by less than 0.25 % (physics.md)."""
    stiff = specimens.follow(
        specimens.press(CENTRE, replace(TO_ROUNDING, tangential_stiffness=20.0)), CENTRE, DEPTHS
    )
    usual = specimens.follow(specimens.press(CENTRE), CENTRE, DEPTHS)
    assert stiff[-1].force[2] == pytest.approx(usual[-1].force[2], rel=2.5e-3)
    assert stiff[-1].force[2] != usual[-1].force[2]


# ------------------------------------------------------------------------------------------ small strain
@pytest.fixture(scope="module")
def small():
    """Return a press at small strain with current normals, and one with the normals of the undeformed surface."""
    current = specimens.press(CORNER, TO_ROUNDING, SmallStrainBody)
    initial = specimens.press(CORNER, replace(TO_ROUNDING, initial_normals=True), SmallStrainBody)
    return {"current": current, "initial": initial}


def test_small_strain_force_is_linear(small, rng):
    body = small["current"].body
    none = np.zeros(len(body.mesh.elements))
    u, v = rng.normal(size=(2, *body.mesh.X.shape))
    fu, fv, both = (body.response(w, none).f_condensed for w in (u, v, 2 * u - 3 * v))
    assert_allclose(both, 2 * fu - 3 * fv, atol=1e-11 * np.abs(both).max())  # sums of 81 terms that cancel


def test_small_strain_is_the_limit_of_finite_strain(small, rng):
    """The difference of the forces falls with the square of the displacement."""
    body, finite = small["current"].body, specimens.press(CORNER).body
    none, u = np.zeros(len(body.mesh.elements)), rng.uniform(-1, 1, body.mesh.X.shape)
    differences = [
        np.linalg.norm(finite.response(h * u, none).f_condensed - body.response(h * u, none).f_condensed)
        for h in (1e-3, 5e-4, 2.5e-4)
    ]
    assert_allclose(np.log2(np.divide(differences[:-1], differences[1:])), 2, atol=0.02)


@pytest.mark.parametrize("normals", ["current", "initial"])
def test_small_strain_press_balances(small, normals):
    press = small[normals]
    for state in specimens.follow(press, CORNER, DEPTHS):
        assert np.linalg.norm(state.force + state.reaction) < 1e-10 * np.linalg.norm(state.force)
        assert state.force[2] < 0
        horizontal = np.abs(state.normal_force[:, :2]).max()
        assert horizontal == 0 if normals == "initial" else horizontal > 1e-4


def test_initial_normals_measure_the_gap_straight_up(small):
    press = small["initial"]
    state = specimens.follow(press, CORNER, DEPTHS)[-1]
    on = state.contact_state > 0
    X = press.body.mesh.X[press.surface][on]
    ball = state.centre[2] - np.sqrt(25.0 - ((X[:, :2] - state.centre[:2]) ** 2).sum(axis=1))
    assert on.sum() > 5
    assert_allclose(state.u[press.surface][on, 2], ball, atol=1e-10)


# ----------------------------------------------------------------------------------------------- failing
class Cautious(Press):
    """A press that takes no step longer than 0.35 mm, and remembers the depths it reached."""

    def step(self, previous, state, centre, **keys):
        if np.linalg.norm(centre - state.centre) > 0.35:
            raise NotConverged("too long")
        new = super().step(previous, state, centre, **keys)
        self.reached.append(round(5.0 - float(centre[2]), 9))
        return new


def test_a_step_too_long_is_halved_and_ends_where_it_should():
    """From touch to 1.2 mm at once: in quarters, with the forces of four asked-for steps."""
    patient = specimens.follow(specimens.press(CENTRE), CENTRE, [0.3, 0.6, 0.9, 1.2])[-1]
    press = specimens.press(CENTRE)
    press = Cautious(press.body, press.indenter, press.settings)
    press.reached = []
    (hasty,) = specimens.follow(press, CENTRE, [1.2])
    assert press.reached == [0.3, 0.6, 0.9, 1.2]
    assert_allclose(hasty.u, patient.u, atol=1e-12)
    assert_allclose(hasty.friction_force, patient.friction_force, atol=1e-12)
    assert hasty.iterations > patient.iterations  # of all four steps


def test_halving_ends_after_the_allowed_number():
    body = specimens.press(CENTRE).body
    for halvings, depth in [(1, 1.2), (0, 0.6)]:
        press = Cautious(body, specimens.BALL, replace(TO_ROUNDING, max_halvings=halvings))
        press.reached = []
        with pytest.raises(NotConverged, match=f"too long; step halved {halvings} times"):
            specimens.follow(press, CENTRE, [depth])


def test_an_absurd_step_is_given_up_with_its_reason():
    press = specimens.press(CENTRE, Settings(max_iterations=3, max_halvings=1))
    with pytest.raises(
        NotConverged, match=r"no equilibrium at centre .* after 9 iterations: .*; step halved 1 times"
    ):
        specimens.follow(press, CENTRE, [3.9])
