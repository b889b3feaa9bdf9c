"""What must not matter (penalties, path of halvings) and what the variants of the model promise."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose
from specimens import CENTRE, CORNER, TO_ROUNDING

from gelforge.mechanics.bodies.body import SmallStrainBody
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.solving.equilibrium import NotConverged, Press

DEPTHS = [0.4, 0.8]


@pytest.fixture(scope="module")
def reference():
    """Return the states of a corner press at the default penalties, iterated to rounding."""
    return specimens.follow(specimens.press(CORNER), CORNER, DEPTHS)


@pytest.mark.parametrize("name", ["normal_augmentation", "tangential_augmentation"])
@pytest.mark.parametrize("factor", [0.25, 4.0, 16.0])
def test_forces_do_not_depend_on_how_fast_contact_is_found(reference, name, factor):
    """Pressure and friction are unknowns of their own; the augmentations decide only how fast they are found."""
    settings = replace(TO_ROUNDING, **{name: factor * getattr(TO_ROUNDING, name)})
    states = specimens.follow(specimens.press(CORNER, settings), CORNER, DEPTHS)
    for state, known in zip(states, reference):
        # Two solutions of the same equations, each to 1e-11 of F and gaps of 1e-11 of an element.
        assert_allclose(state.force, known.force, atol=1e-9 * np.linalg.norm(known.force))
        assert_allclose(state.friction_force, known.friction_force, atol=1e-9 * np.linalg.norm(known.force))
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


def test_only_an_open_node_newly_touches_and_what_slips_drags_at_the_limit():
    # Only a node that was open has newly touched. A node in contact with a gap of +1e-6 mm, within the tolerance,
    # keeps its whole slip
    press = specimens.press(CORNER)
    old, now = specimens.follow(press, CORNER, DEPTHS)
    kept = (old.contact_state > 0) & (now.contact_state > 0)
    for shift in (-1e-6, 1e-6):
        step = press.contact.step(replace(old, gap=np.where(kept, shift, old.gap)), now.centre)
        assert not step.touch_share[kept].any()
        assert not step.moved_free[kept].any()

    # What sticks does not slip and what slips drags at the limit
    press = specimens.press(CORNER, replace(TO_ROUNDING, friction=0.1))
    steps, start = [], press.start(*CORNER)
    path = start.centre + np.array([[0, 0, -0.4], [0, 0, -0.8], [0.1, 0.05, -0.8], [0.3, 0.15, -0.8]])
    for _ in press.follow(start, path, watch=lambda *pair: steps.append(pair)):
        pass
    seen = set()
    for before, after in steps:
        on = (before.contact_state > 0) & (after.contact_state > 0)
        normal = press.contact.gap(after.u, after.centre)[1]
        slip = (after.u - before.u)[press.surface] - (after.centre - before.centre)
        slip -= normal * (normal * slip).sum(axis=1, keepdims=True)
        size, friction = np.linalg.norm(slip, axis=1), np.linalg.norm(after.friction_force, axis=1)
        limit = 0.1 * after.contact_pressure * press.area
        stick, slides = on & (after.contact_state == 1), on & (after.contact_state == 2)
        seen |= {kind for kind, nodes in [("stick", stick), ("slip", slides)] if nodes.any()}
        # To rounding, of a path of 1 mm and of forces of 1e-2 N.
        assert size[stick].max(initial=0) < 1e-10
        assert (friction[stick] <= limit[stick] * (1 + 1e-9)).all()
        assert_allclose(friction[slides], limit[slides], rtol=1e-8)
        against = -(slip * after.friction_force).sum(axis=1)
        assert_allclose(against[slides], (size * friction)[slides], atol=1e-12)
    assert seen == {"stick", "slip"}


def test_a_path_in_ever_smaller_parts_converges_and_a_step_too_long_is_halved():
    # A path in ever smaller parts converges. Friction depends on the path: a quarter of the step leaves a quarter
    # of the error in the shear, or less

    def shear(part):
        settings = replace(TO_ROUNDING, longest_step=part)
        return specimens.follow(specimens.press(CORNER, settings), CORNER, DEPTHS)[-1].friction_force

    finest = shear(0.05)
    usual, finer = (np.linalg.norm(shear(part) - finest) for part in (0.8, 0.2))
    assert 0 < finer < usual / 4

    # A step too long is halved as often as allowed. From touch to 1.2 mm at once: in quarters, with the forces of
    # four asked-for steps
    plain = replace(TO_ROUNDING, friction=0.0)  # nothing but what fails parts its steps
    patient = specimens.follow(specimens.press(CENTRE, plain), CENTRE, [0.3, 0.6, 0.9, 1.2])[-1]
    press = specimens.press(CENTRE, plain)
    press = Cautious(press.body, press.indenter, press.settings)
    press.reached = []
    (hasty,) = specimens.follow(press, CENTRE, [1.2])
    assert press.reached == [0.3, 0.6, 0.9, 1.2]
    assert_allclose(hasty.u, patient.u, atol=1e-12)
    assert hasty.iterations > patient.iterations  # of all four steps

    # Halving ends after the allowed number
    body = specimens.press(CENTRE).body
    for halvings, depth in [(1, 1.2), (0, 0.6)]:
        press = Cautious(body, specimens.BALL, replace(TO_ROUNDING, friction=0.0, max_halvings=halvings))
        press.reached = []
        with pytest.raises(NotConverged, match=f"too long; step halved {halvings} times"):
            specimens.follow(press, CENTRE, [depth])

    # An absurd step is given up with its reason
    press = specimens.press(CENTRE, Settings(max_iterations=3, max_halvings=1))
    with pytest.raises(
        NotConverged, match=r"no equilibrium at centre .* after 9 iterations: .*; step halved 1 times"
    ):
        specimens.follow(press, CENTRE, [3.9])


# ------------------------------------------------------------------------------------------ small strain
@pytest.fixture(scope="module")
def small():
    """Return a press at small strain with current normals, and one with the normals of the undeformed surface."""
    current = specimens.press(CORNER, TO_ROUNDING, SmallStrainBody)
    initial = specimens.press(CORNER, replace(TO_ROUNDING, initial_normals=True), SmallStrainBody)
    return {"current": current, "initial": initial}


def test_small_strain_is_linear_and_initial_normals_measure_the_gap_straight_up(small, rng):
    # Small strain is linear and the limit of finite strain
    body = small["current"].body
    none = np.zeros(len(body.mesh.elements))
    u, v = rng.normal(size=(2, *body.mesh.X.shape))
    fu, fv, both = (body.response(w, none).f_condensed for w in (u, v, 2 * u - 3 * v))
    assert_allclose(both, 2 * fu - 3 * fv, atol=1e-11 * np.abs(both).max())  # sums of 81 terms that cancel

    # The difference of the forces falls with the square of the displacement.
    body, finite = small["current"].body, specimens.press(CORNER).body
    none, u = np.zeros(len(body.mesh.elements)), rng.uniform(-1, 1, body.mesh.X.shape)
    differences = [
        np.linalg.norm(finite.response(h * u, none).f_condensed - body.response(h * u, none).f_condensed)
        for h in (1e-3, 5e-4, 2.5e-4)
    ]
    assert_allclose(np.log2(np.divide(differences[:-1], differences[1:])), 2, atol=0.02)

    # Initial normals measure the gap straight up
    press = small["initial"]
    state = specimens.follow(press, CORNER, DEPTHS)[-1]
    on = state.contact_state > 0
    X = press.body.mesh.X[press.surface][on]
    ball = state.centre[2] - np.sqrt(25.0 - ((X[:, :2] - state.centre[:2]) ** 2).sum(axis=1))
    assert on.sum() > 5
    assert_allclose(state.u[press.surface][on, 2], ball, atol=1e-10)


@pytest.mark.parametrize("normals", ["current", "initial"])
def test_small_strain_press_balances(small, normals):
    press = small[normals]
    for state in specimens.follow(press, CORNER, DEPTHS):
        assert np.linalg.norm(state.force + state.reaction) < 1e-10 * np.linalg.norm(state.force)
        assert state.force[2] < 0
        horizontal = np.abs(state.normal_force[:, :2]).max()
        assert horizontal == 0 if normals == "initial" else horizontal > 1e-4


# ----------------------------------------------------------------------------------------------- failing
class Cautious(Press):
    """A press that takes no step longer than 0.35 mm, and remembers the depths it reached."""

    def step(self, previous, state, centre, **keys):
        if np.linalg.norm(centre - state.centre) > 0.35:
            raise NotConverged("too long")
        new = super().step(previous, state, centre, **keys)
        self.reached.append(round(5.0 - float(centre[2]), 9))
        return new
