"""Contact forces and their tangents against the NumPy twin and against finite differences of themselves."""

import numpy as np
import pytest
import twins
from numpy.testing import assert_allclose

from gelforge.mechanics.contact.forces import (
    OPEN,
    SLIP,
    STICK,
    ContactForces,
    ContactNodes,
    add_node_blocks,
    contact_forces,
)
from gelforge.mechanics.indenters.shapes import Sphere

rng = np.random.default_rng(5)
NODES = 200
BALL, CENTRE = Sphere(5.0), np.array([0.0, 0.0, 4.5])
MU = 0.45

# Nodes near the ball's surface, with pressures and slips that make every state and let some nodes separate.
AROUND = rng.normal(size=(NODES, 3)) - [0, 0, 2]
OUTWARD = AROUND / np.linalg.norm(AROUND, axis=1)[:, None]
POINTS = CENTRE + OUTWARD * (5 + 0.01 * rng.normal(size=(NODES, 1)))
REST = POINTS + 0.05 * rng.normal(size=(NODES, 3))  # where the nodes were at the last converged state
PRESSURE = rng.uniform(0.02, 0.5, NODES) * (rng.random(NODES) < 0.9)
ACTIVE = rng.random(NODES) < 0.8
AREA = rng.uniform(0.1, 0.5, NODES)
GIVEN = 0.02 * rng.normal(size=(NODES, 3))
EPS_N, WEIGHT, HOLD = (np.full(NODES, value) for value in (20.0, 3.0, 200.0))


def forces(points=POINTS, mu=MU, given=GIVEN, weight=WEIGHT, hold=HOLD, exponents=()):
    """Return all that the compiled loop fills, by name."""
    gap, normal, turn = BALL.gap(points, CENTRE)
    pressures = np.array((0.1, 0.3)[: len(exponents)], float)
    out = ContactForces.empty(NODES)
    for values in out:
        values[:] = 9 if values.dtype == np.int8 else np.nan
    nodes = ContactNodes(
        gap, normal, turn, points - REST, PRESSURE, ACTIVE, AREA, given, EPS_N, weight, hold, mu,
        np.array(exponents, float), pressures,
    )  # fmt: skip
    contact_forces(nodes, out)
    return out._asdict()


def slip_at(points):
    """Return the slip (NODES, 3) in the tangent plane."""
    normal, slip = BALL.gap(points, CENTRE)[1], points - REST
    return slip - normal * (normal * slip).sum(axis=1, keepdims=True)


@pytest.mark.parametrize("mu", [0.0, MU])
def test_forces_equal_the_twin(mu):
    gap, normal, _ = BALL.gap(POINTS, CENTRE)
    twin = twins.contact(gap, normal, POINTS - REST, PRESSURE, ACTIVE, AREA, GIVEN, EPS_N, WEIGHT, HOLD, mu)
    found = forces(mu=mu)
    for name, expected in twin.items():
        assert_allclose(found[name], expected, rtol=1e-12, atol=1e-15, err_msg=name)


def test_states_limits_and_stiffness_of_the_sample_and_blocks_are_added():
    # States limits and stiffness of the sample
    state = forces()["state"]
    for kind in (STICK, SLIP):
        assert (state == kind).sum() > 10
    assert (state[~ACTIVE] == OPEN).all()

    # Wanted friction is tangential and below its limit
    found = forces()
    _, normal, _ = BALL.gap(POINTS, CENTRE)
    limit = MU * AREA * PRESSURE * ACTIVE
    size = np.linalg.norm(found["wanted"], axis=1)
    assert_allclose(np.einsum("si,si->s", found["wanted"], normal), 0, atol=1e-16)
    assert (size <= limit * (1 + 1e-14)).all()
    slips = (found["state"] == SLIP) & (PRESSURE > 0)
    assert_allclose(size[slips], limit[slips], rtol=1e-13)
    assert (size[found["state"] == STICK] < limit[found["state"] == STICK]).all()

    # Symmetric stiffness is symmetric and positive
    stiffness = forces()["stiffness"]
    assert_allclose(stiffness, np.swapaxes(stiffness, 1, 2), atol=1e-15)
    assert np.linalg.eigvalsh(stiffness).min() > -1e-14

    # Blocks are added symmetrised and fixed entries skipped
    slots = np.array([[[0, 1, 2], [1, 3, 4], [2, 4, 5]], [[-1] * 3] * 3])
    blocks, data = rng.normal(size=(2, 3, 3)), np.ones(6)
    add_node_blocks(slots, blocks, data)
    half = (blocks[0] + blocks[0].T) / 2
    assert_allclose(data, 1 + half[np.triu_indices(3)], rtol=1e-15)


@pytest.mark.parametrize("weight", [0.3, 3.0, 300.0])
def test_what_solves_the_law_is_coulomb_s_whatever_the_weight(weight):
    """Sticking without slip, or slipping with the limit against the slip: there, and only there, wanted equals given."""
    limit = MU * AREA * PRESSURE
    slip = slip_at(POINTS)
    size = np.linalg.norm(slip, axis=1, keepdims=True)
    against = -limit[:, None] * slip / size
    on = ACTIVE & (PRESSURE > 0)
    for given, solves in [(against, True), (-against, False), (0.5 * against, False)]:
        found = forces(given=given, weight=np.full(NODES, weight))
        error = np.linalg.norm(found["wanted"] - found["friction"], axis=1)[on] / limit[on]
        assert (error < 1e-12).all() if solves else (error > 1e-3).all()
        if solves:
            assert (found["state"][on] == SLIP).all()


def test_consistent_stiffness_is_the_derivative_of_what_sticks():
    """Taylor: the remainder of f_consistent falls with the square of the step, node by node."""
    remainders, start = remainders_of(lambda points: forces(points)["f_consistent"], forces(), POINTS)
    check_rates(remainders, start["state"] == STICK)


@pytest.mark.parametrize("exponents", [(), (0.4, -0.3)])
def test_consistent_stiffness_is_the_derivative_of_coulomb_s_law_where_it_slips(exponents):
    """The kernel is Newton's method for t = Pi(t - w A s): at its solution its tangent is that of t = -mu p A s / |s|.

    The coefficient may depend on the pressure, by one factor for each exponent.
    """

    def mu_at(pressure):
        factors = [
            (1 + np.maximum(pressure, 0) / p0) ** -n for n, p0 in zip(exponents, (0.1, 0.3), strict=False)
        ]
        return MU * np.prod(factors, axis=0) if factors else MU

    on_ball = CENTRE + 5 * OUTWARD  # closed gaps: the limit now is that of the next pressure
    slip = slip_at(on_ball)
    solution = (
        -(mu_at(PRESSURE) * AREA * PRESSURE)[:, None] * slip / np.linalg.norm(slip, axis=1, keepdims=True)
    )

    def coulomb(points):
        gap, normal, _ = BALL.gap(points, CENTRE)
        p, slip = PRESSURE - EPS_N * gap, slip_at(points)
        friction = (mu_at(p) * AREA * p)[:, None] * slip / np.linalg.norm(slip, axis=1, keepdims=True)
        return (AREA * p)[:, None] * normal - friction

    start = forces(
        on_ball, given=solution, hold=1e7 * HOLD, exponents=exponents
    )  # springs as stiff as the law wants them
    remainders, start = remainders_of(coulomb, start, on_ball)
    check_rates(remainders, ACTIVE & (PRESSURE > 0) & (start["state"] == SLIP))


def remainders_of(function, start, points):
    """Return what the tangent leaves of a function (NODES, 3) of the points at two steps, one half of the other."""
    direction = np.random.default_rng(8).normal(size=(NODES, 3))
    before, found = function(points), []
    for step in (1e-5, 5e-6):
        change = np.einsum("sij,sj->si", start["stiffness_consistent"], step * direction)
        found.append(np.linalg.norm(function(points + step * direction) - before + change, axis=1))
    return found, start


def check_rates(remainders, nodes):
    chosen = nodes & (remainders[1] > 1e-13)  # above rounding
    assert chosen.sum() > 10
    rate = np.log2(remainders[0][chosen] / remainders[1][chosen])
    # A wrong derivative has the rate 1. Near a zero of the second derivative the third one shows and the rate grows.
    assert rate.min() > 1.8
    assert np.abs(np.median(rate) - 2) < 0.02
