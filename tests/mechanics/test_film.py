"""A film between indenter and surface that gives way under pressure and is used up, against its limits."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.forces import film_given
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Cylinder, Sphere
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import Press

SOFT, RIGID = {"gel": NeoHooke(0.02)}, {"gel": NeoHooke(500.0)}  # MPa
THICK = 0.05  # mm


BALL = Sphere(5.0)


def pressed(depths, law=SOFT, indenter=BALL, **settings):
    """Return the press and its states at depths [mm]."""
    block = Block(10.0, 10.0, (("gel", 2.0),))
    mesh = layered_block(block, 5.0, 5.0, Sizes(0.5, near_radius=4.0, growth=0.3, far=1.0))
    tight = {"force_tolerance": 1e-10, "gap_tolerance": 1e-9, "max_iterations": 80}
    press = Press(Body(mesh, law, 100.0), indenter, Settings(**(tight | {"friction": 0.0} | settings)))
    start = press.start(5.0, 5.0)
    return press, list(press.follow(start, start.centre - np.outer(depths, [0.0, 0.0, 1.0])))


@pytest.mark.parametrize("friction", [0.0, 0.45])
def test_the_surface_stays_behind_by_what_the_film_has_given(friction):
    _, states = pressed(
        (0.2, 0.5), friction=friction, film_thickness=THICK, film_pressure=0.005, normal_augmentation=1000.0
    )
    for state in states:
        touches = state.contact_pressure > 0
        given, _ = film_given(state.contact_pressure, THICK, 0.005)
        assert touches.any() and 0 < given[touches].min() < 0.5 * THICK < given.max() < THICK
        assert_allclose(-state.gap[touches], given[touches], atol=1e-8)


def test_a_film_has_its_limits_of_a_smaller_ball_and_of_a_hyperbola():
    # A film that is used up at once leaves a smaller ball. At a vanishing pressure all of it has given way, along
    # the normal: a ball smaller by it about the same middle
    _, smaller = pressed((0.3 - THICK,), indenter=Sphere(5.0 - THICK))
    _, filmed = pressed((0.3,), film_thickness=THICK, film_pressure=1e-9)
    assert_allclose(filmed[0].force, smaller[0].force, rtol=1e-4, atol=1e-7)

    # Under a flat punch on a rigid body it alone gives way. F = A p with h p / (p + p_0) = depth: a hyperbola
    # (Bandis, Lumsden & Barton 1983)
    depth, half = 0.6 * THICK, 0.01
    press, (state,) = pressed(
        (depth,), RIGID, Cylinder(2.6, 4.0, 0.5), film_thickness=THICK, film_pressure=half
    )
    flat = np.hypot(*(press.body.mesh.X[press.surface, :2] - 5.0).T) < 2.1 - 1e-9
    p = half * depth / (THICK - depth)
    assert_allclose(state.contact_pressure[flat], p, rtol=0.02)  # the body gives by some of a thousandth
    assert -state.normal_force[flat, 2].sum() == pytest.approx(p * press.area[flat].sum(), rel=0.02)

    # Its slope is that of what it gives
    p = np.array([0.0, 1e-3, 0.02, 1.0])
    given, slope = film_given(p, THICK, 0.01)
    beside = film_given(p + 1e-8, THICK, 0.01)[0]
    assert_allclose(slope, (beside - given) / 1e-8, rtol=1e-4)
    assert given[0] == 0 and given[-1] == pytest.approx(THICK, rel=0.02)
