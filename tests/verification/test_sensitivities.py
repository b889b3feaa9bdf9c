"""Derivatives by neighbouring presses against central differences of the full solver."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from neighbouring_presses import Neighbour, follow_beside
from numpy.testing import assert_allclose

from gelforge.indentation.cells.binning import bin_forces, surface_shares
from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Sphere
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import layered_block
from gelforge.mechanics.solving.equilibrium import Press

SETTINGS = Settings(force_tolerance=1e-9, gap_tolerance=1e-8, volume_tolerance=1e-9, facets=0.75)
DEPTHS = np.array([0.25, 0.5, 0.75, 1.0])
AMOUNT = 1e-3  # relative, or mm
# Where no node is about to join the contact: there the forces of the discrete model jump, and differences with them.
PLACE = (10.7, 9.6)


def model(
    place=PLACE,
    gel=1.0,
    alpha=1.0,
    skin=1.0,
    friction=1.0,
    radius=1.0,
    bulk=1.0,
    deeper=0.0,
    thicker=0.0,
    block=None,
):
    """Return body, indenter, settings, first centre and path with these factors on the parameters."""
    g, s = specimens.GEL, specimens.SKIN
    gel_law = Ogden((g.mu[0] * gel, g.mu[1]), (g.alpha[0] * alpha, g.alpha[1]))
    skin_law = Ogden((s.mu[0] * skin, s.mu[1]), s.alpha)
    laws = {"gel": gel_law, "skin": skin_law, "wall": skin_law}
    mesh = layered_block(block or specimens.BLOCK, *place, specimens.SIZES)
    low = mesh.X[:, 2].min()
    stretched = mesh.X[:, 2] * (1 - thicker / low)  # nodes move, elements stay
    body = Body(replace(mesh, X=np.column_stack([mesh.X[:, :2], stretched])), laws, 1000.0 * bulk)
    ball = Sphere(5.0 * radius)
    start = ball.start(*place)
    centres = start - np.outer(DEPTHS + deeper, [0.0, 0.0, 1.0])
    return body, ball, replace(SETTINGS, friction=0.45 * friction), start, centres


PARAMETERS = {
    "gel modulus": lambda h: model(gel=1 + h),
    "gel exponent": lambda h: model(alpha=1 + h),
    "skin modulus": lambda h: model(skin=1 + h),
    "friction": lambda h: model(friction=1 + h),
    "ball radius": lambda h: model(radius=1 + h),
    "bulk modulus": lambda h: model(bulk=1 + h),
    "depth": lambda h: model(deeper=h),
    "x": lambda h: model(place=(PLACE[0] + h, PLACE[1])),
    "thickness": lambda h: model(thicker=h),
}


@pytest.fixture(scope="module")
def beside():
    """Return per parameter the forces (D, 3) and bins (D, B, 3) differentiated next to one base run."""
    body, ball, settings, start, centres = model()
    base = Press(body, ball, settings)
    neighbours = [Neighbour(base, *vary(AMOUNT)) for vary in PARAMETERS.values()]
    found = {name: [] for name in PARAMETERS}
    for state, states in follow_beside(base, base.start_at(start), centres, neighbours):
        for name, near in zip(PARAMETERS, states):
            found[name].append((nodal(near) - nodal(state)) / AMOUNT)
    return {name: np.array(values) for name, values in found.items()}, binned(body)


def nodal(state):
    return state.normal_force + state.friction_force


def binned(body):
    study = specimens.study()
    shares = surface_shares(body.mesh, study.sensor)
    return lambda forces: bin_forces(forces, shares)


def full_difference(vary):
    """Return the central difference (D, S, 3) of nodal forces by two solutions of their own."""
    ends = []
    for sign in (1, -1):
        body, ball, settings, start, centres = vary(sign * AMOUNT)
        press = Press(body, ball, settings)
        ends.append(np.array([nodal(state) for state in press.follow(press.start_at(start), centres)]))
    return (ends[0] - ends[1]) / (2 * AMOUNT)


@pytest.mark.thorough(but_first=4)  # it is the measure of test_direct_sensitivities.py only
@pytest.mark.parametrize("name", PARAMETERS)
def test_derivatives_agree_with_differences_of_the_full_solver(beside, name):
    found, bins = beside[0][name], beside[1]
    expected = full_difference(PARAMETERS[name])
    total, total_expected = found.sum(axis=1), expected.sum(axis=1)
    size = np.linalg.norm(total_expected, axis=1, keepdims=True)
    # Totals to 2 %, bins to 5 % of the largest derivative: what users of the derivatives are promised.
    worst = np.abs(total - total_expected).max(axis=1) / size.max()
    assert worst.max() < 0.02, worst
    per_bin, per_bin_expected = bins(found), bins(expected)
    largest = np.abs(per_bin_expected).max()
    assert_allclose(per_bin, per_bin_expected, atol=0.05 * largest, rtol=0)


def test_a_neighbour_that_differs_by_nothing_is_the_base_and_another_mesh_refused():
    body, ball, settings, start, centres = model()
    base = Press(body, ball, settings)
    near = Neighbour(base, *model())
    for state, (beside,) in follow_beside(base, base.start_at(start), centres, [near]):
        # what a further correction of a state converged to 1e-9 changes
        assert_allclose(nodal(beside), nodal(state), atol=1e-8 * np.abs(nodal(state)).max())

    # Another mesh is refused
    body, ball, settings, *_ = model()
    other = model(block=replace(specimens.BLOCK, layers=(("gel", 6.0), ("skin", 1.0))))
    with pytest.raises(ValueError, match="other elements"):
        Neighbour(Press(body, ball, settings), *other)
