"""Cohesive contact against closed forms of a rigid body, and friction that falls with the pressure."""

from functools import cache

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.forces import SLIP, STICK
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Cylinder, Sphere
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import Press

WORK, RANGE = 1e-4, 0.2  # N/mm, mm
STIFF = {
    "gel": NeoHooke(50.0)
}  # MPa: moves by less than 1e-5 mm under these pulls, so that it is rigid next to RANGE


def adhesive_press(indenter, near=0.5, law=STIFF, **settings):
    mesh = layered_block(
        Block(10.0, 10.0, (("gel", 2.0),)), 5.0, 5.0, Sizes(near, near_radius=4.0, growth=0.3, far=1.0)
    )
    tight = {"force_tolerance": 1e-9, "gap_tolerance": 1e-9}
    settings = Settings(**({"friction": 0.0, "adhesion_range": RANGE} | tight | settings))
    return Press(Body(mesh, law, 100.0), indenter, settings)


def heights(press, *gaps):
    """Return the states with the indenter this far above the first touch."""
    start = press.start(5.0, 5.0)
    return list(press.follow(start, start.centre + np.outer(gaps, [0.0, 0.0, 1.0])))


def test_cohesion_draws_punch_and_ball_and_holds_on_the_way_up():
    # Punch and ball are drawn by the cohesive law. All of the rigid face is at one gap: F = 2 w / range (1 - gap /
    # range) A, A the area of the nodes under it
    press = adhesive_press(Cylinder(2.6, 4.0, 0.5), adhesion_approach=WORK)
    flat = np.hypot(*(press.body.mesh.X[press.surface, :2] - 5.0).T) < 2.1 - 1e-9
    for gap, state in zip((0.15, 0.05), heights(press, 0.15, 0.05)):
        pull = 2 * WORK / RANGE * (1 - gap / RANGE) * press.area[flat].sum()
        assert state.normal_force[flat, 2].sum() == pytest.approx(
            pull, rel=1e-3
        )  # the body is not quite rigid
        assert (state.normal_force[:, 2] >= 0).all()  # upwards: it draws

    # Bradley 1932: rigid ball and plane in touch, the range small against R: F = 2 pi R w.
    press = adhesive_press(Sphere(5.0), near=0.25, adhesion_approach=WORK)
    (state,) = heights(press, 1e-4)
    assert state.force[2] == pytest.approx(2 * np.pi * 5.0 * WORK, rel=0.03)  # 6 elements across the range

    # Pull off is seen in unloading only
    plain, sticky = cycle(0.0), cycle(5e-4)
    assert_allclose(sticky[:2], plain[:2], rtol=2e-2)  # the way down; the rim holds what has touched
    assert (plain <= 1e-9).all()
    assert sticky.max() > 1e-3  # drawn back before it parts
    assert (sticky[2:6] > plain[2:6]).all()
    assert abs(sticky[-1]) < 1e-9  # parted: beyond the range nothing is felt
    # JKR 1971: at least 3/2 pi R w holds a ball on a half-space; a thin bonded layer holds more
    assert sticky.max() < 10 * 1.5 * np.pi * 5.0 * 5e-4


@cache
def cycle(work):
    """Return Fz [N] of a soft layer pressed and released again, step by step."""
    press = adhesive_press(
        Sphere(5.0), law={"gel": NeoHooke(0.02)}, adhesion_work=work, force_tolerance=1e-7, gap_tolerance=1e-7
    )
    depths = [0.2, 0.4, 0.2, 0.1, 0.05, 0.0, -0.05, -0.1, -0.2, -0.4]
    return np.array([state.force[2] for state in heights(press, *-np.array(depths))])


def test_friction_falls_with_the_pressure_and_is_coulombs_without_exponent():
    # Friction falls with the pressure. Nodes that slip carry mu times (1 + p / p0)^-n by each exponent times their
    # pressure, to the stopping rule
    (n, p0), (m, p1), mu = (0.5, 0.01), (-0.2, 0.03), 0.45
    settings = {"friction": mu, "friction_exponents": (n, m), "friction_pressures": (p0, p1)}
    press = adhesive_press(Sphere(5.0), law={"gel": NeoHooke(0.02)}, **settings)
    start = press.start(5.0, 5.0)
    path = start.centre + np.array([[0, 0, -0.3], [0.1, 0, -0.3], [0.3, 0, -0.3]])
    state = list(press.follow(start, path))[-1]
    slips = state.contact_state == SLIP
    assert slips.sum() > 5
    p = state.contact_pressure[slips]
    limit = mu * (1 + p / p0) ** -n * (1 + p / p1) ** -m * p * press.area[slips]
    assert_allclose(np.linalg.norm(state.friction_force[slips], axis=1), limit, rtol=1e-5)
    sticks = state.contact_state == STICK
    assert (
        np.linalg.norm(state.friction_force[sticks], axis=1)
        <= mu * press.area[sticks] * state.contact_pressure[sticks]
    ).all()

    # No exponent is coulomb bit for bit
    plain = specimens.follow(specimens.press(settings=Settings()), specimens.CENTRE, [0.4])[-1]
    named = Settings(friction_exponents=(0.0,), friction_pressures=(0.5,), adhesion_work=0.0)
    again = specimens.follow(specimens.press(settings=named), specimens.CENTRE, [0.4])[-1]
    assert np.array_equal(plain.force, again.force)
    assert np.array_equal(plain.u, again.u)
