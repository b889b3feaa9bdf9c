"""Contact forces and their tangents against the NumPy twin and against finite differences of themselves."""

import numpy as np
import pytest
import twins
from numpy.testing import assert_allclose

from gelforge.mechanics.contact import OPEN, SLIP, STICK, add_node_blocks, contact_forces
from gelforge.mechanics.indenters import Sphere

rng = np.random.default_rng(5)
NODES = 200
BALL, CENTRE = Sphere(5.0), np.array([0.0, 0.0, 4.5])
EPS_N, EPS_T, MU = 20.0, 3.0, 0.45

# Nodes near the ball's surface, with pressures and slips that make every state and let some nodes separate.
AROUND = rng.normal(size=(NODES, 3)) - [0, 0, 2]
POINTS = CENTRE + AROUND / np.linalg.norm(AROUND, axis=1)[:, None] * (5 + 0.01 * rng.normal(size=(NODES, 1)))
REST = POINTS + 0.05 * rng.normal(size=(NODES, 3))  # where the nodes were at the last converged state
PRESSURE = rng.uniform(0.02, 0.5, NODES) * (rng.random(NODES) < 0.9)
ACTIVE = rng.random(NODES) < 0.8
AREA = rng.uniform(0.1, 0.5, NODES)
T_OLD = 0.02 * rng.normal(size=(NODES, 3))
NEW = rng.random(NODES) < 0.3
EPS = np.full(NODES, EPS_N)


def forces(points=POINTS, mu=MU):
    """Return all that the compiled loop fills, by name."""
    gap, normal, turn = BALL.gap(points, CENTRE)
    out = {
        name: np.full((NODES, 3), np.nan) for name in ("f_mixed", "f_condensed", "f_consistent", "friction")
    }
    out |= {name: np.full((NODES, 3, 3), np.nan) for name in ("stiffness", "stiffness_consistent")}
    out["state"] = np.full(NODES, 9, np.int8)
    contact_forces(
        gap, normal, turn, points - REST, PRESSURE, ACTIVE, AREA, T_OLD, NEW, EPS, EPS_T, mu, *out.values()
    )
    return out


@pytest.mark.parametrize("mu", [0.0, MU])
def test_forces_equal_the_twin(mu):
    gap, normal, _ = BALL.gap(POINTS, CENTRE)
    twin = twins.contact(gap, normal, POINTS - REST, PRESSURE, ACTIVE, AREA, T_OLD, NEW, EPS_N, EPS_T, mu)
    found = forces(mu=mu)
    for name, expected in twin.items():
        assert_allclose(found[name], expected, rtol=1e-12, atol=1e-15, err_msg=name)


def test_the_sample_holds_every_state():
    state = forces()["state"]
    for kind in (STICK, SLIP):
        assert (state[NEW] == kind).sum() > 5
        assert (state[~NEW] == kind).sum() > 5
    assert (state[~ACTIVE] == OPEN).all()


def test_friction_is_tangential_and_below_its_limit():
    found = forces()
    _, normal, _ = BALL.gap(POINTS, CENTRE)
    limit = MU * AREA * PRESSURE * ACTIVE
    size = np.linalg.norm(found["friction"], axis=1)
    assert_allclose(np.einsum("si,si->s", found["friction"], normal), 0, atol=1e-16)
    assert (size <= limit * (1 + 1e-14)).all()
    slips = (found["state"] == SLIP) & (PRESSURE > 0)
    assert_allclose(size[slips], limit[slips], rtol=1e-13)
    assert (size[found["state"] == STICK] < limit[found["state"] == STICK]).all()


def test_friction_of_a_slipping_node_opposes_its_trial_slip():
    """Without an earlier force, friction points against the motion relative to the ball."""
    gap, normal, turn = BALL.gap(POINTS, CENTRE)
    out = forces()
    contact_forces(
        gap,
        normal,
        turn,
        POINTS - REST,
        PRESSURE,
        ACTIVE,
        AREA,
        0 * T_OLD,
        NEW,
        EPS,
        EPS_T,
        MU,
        *out.values(),
    )
    work = np.einsum("si,si->s", out["friction"], POINTS - REST)
    touching = ACTIVE & (PRESSURE > 0)
    assert (work[touching] < 0).all()


def test_symmetric_stiffness_is_symmetric_and_positive():
    stiffness = forces()["stiffness"]
    assert_allclose(stiffness, np.swapaxes(stiffness, 1, 2), atol=1e-15)
    assert np.linalg.eigvalsh(stiffness).min() > -1e-14


def test_consistent_stiffness_is_the_derivative_in_every_state():
    """Taylor: the remainder of f_consistent falls with the square of the step, node by node."""
    start = forces()
    direction = rng.normal(size=(NODES, 3))
    remainders = []
    for step in (1e-4, 5e-5):
        moved = forces(POINTS + step * direction)
        same = (moved["state"] == start["state"]) & (start["state"] != OPEN)
        change = np.einsum("sij,sj->si", start["stiffness_consistent"], step * direction)
        remainders.append(np.linalg.norm(moved["f_consistent"] - start["f_consistent"] + change, axis=1))
    for kind in (STICK, SLIP):
        chosen = same & (start["state"] == kind) & (remainders[1] > 1e-13)  # above rounding
        assert chosen.sum() > 10
        rate = np.log2(remainders[0][chosen] / remainders[1][chosen])
        # A wrong derivative has the rate 1. Near a zero of the second derivative the third one shows and the rate grows.
        assert rate.min() > 1.8
        assert np.abs(np.median(rate) - 2) < 0.02


def test_blocks_are_added_symmetrised_and_fixed_entries_skipped():
    slots = np.array([[[0, 1, 2], [1, 3, 4], [2, 4, 5]], [[-1] * 3] * 3])
    blocks, data = rng.normal(size=(2, 3, 3)), np.ones(6)
    add_node_blocks(slots, blocks, data)
    half = (blocks[0] + blocks[0].T) / 2
    assert_allclose(data, 1 + half[np.triu_indices(3)], rtol=1e-15)
