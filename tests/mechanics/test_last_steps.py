"""What a step needs where a press begins, ends or creeps: rounding is no contact, and the last halving has patience."""

import numpy as np
import pytest
import specimens

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.forces import OPEN
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Box
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import PATIENCE, NotConverged, Press

BLOCK = Block(12.0, 12.0, (("gel", 3.0),), wall=1.0)
LAWS = {"gel": NeoHooke(0.01)}
PUNCH = Box((4.0, 5.0, 8.0), 0.5)


def flat_press():
    mesh = layered_block(BLOCK, 6.0, 6.0, Sizes(near=1.0, far=2.0))
    return Press(Body(mesh, LAWS, 1000.0), PUNCH, Settings())


def test_a_flat_punch_touches_one_layer_beyond_rounding_and_leaves_it():
    # A flat punch touches beyond rounding and leaves the gel. Else nodes under it go in and out of contact for gaps
    # of 1e-16 mm, and a press that is taken back never ends
    (standing,) = specimens.follow(flat_press(), (6.0, 6.0), [1e-15])
    assert (standing.gap < 0).any()
    assert (standing.contact_state == OPEN).all() and not standing.force.any()
    (pressed,) = specimens.follow(flat_press(), (6.0, 6.0), [1e-6])
    assert (pressed.contact_state != OPEN).any() and pressed.force[2] < 0

    # A flat punch leaves the gel where it touched it
    press = flat_press()
    pressed, deepest, _, gone = specimens.follow(press, (6.0, 6.0), [0.3, 0.6, 0.3, 0.0])
    assert deepest.force[2] < pressed.force[2] < 0
    assert np.abs(gone.force).max() < press.contact.least_force

    # One layer has no wall around lower layers. A wall of no elements has no stretches to be reported: every region of
    # a mesh has elements
    mesh = layered_block(BLOCK, 6.0, 6.0, Sizes(near=1.0, far=2.0))
    assert mesh.regions == ("gel",)
    two = layered_block(specimens.BLOCK, 8.0, 8.0, specimens.SIZES)
    assert two.regions == ("gel", "skin", "wall")
    assert (np.bincount(two.region, minlength=3) > 0).all()


def test_a_step_that_cannot_be_halved_any_more_has_patience():
    def reached(max_iterations, max_halvings):
        settings = Settings(max_iterations=max_iterations, max_halvings=max_halvings)
        press = specimens.press(settings=settings)
        return specimens.follow(press, specimens.CENTRE, [0.5])[0]

    needed = reached(40, 0).iterations
    enough = -(-needed // PATIENCE)
    assert enough < needed
    assert reached(enough, 0).iterations == needed
    with pytest.raises(NotConverged, match=f"after {PATIENCE} iterations.*halved 0 times"):
        reached(1, 0)
    with pytest.raises(NotConverged, match=f"after {PATIENCE} iterations.*halved 1 times"):
        reached(1, 1)  # the whole step had one iteration, its half the patience
