"""Flow that stress speeds up: closed forms, an integrator from outside, and its place among the verdict's shapes."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gelforge.mismatch.material.material_effects import LONGEST_STEP, flow, hereditary

RATES = np.array([1e-3, 0.1, 3.0])


def test_holds_ramps_and_stress_relax_as_closed_forms_and_integrators_do():
    # A hold relaxes and a ramp flows as the closed forms do. tanh(y / 2) decays exponentially, from whatever stress
    # a fast strain has left
    t = np.r_[0.0, np.geomspace(1e-3, 1e3, 40)]
    found = flow(t, np.full(len(t), 0.3), 0.0, np.full(3, 0.1), RATES)
    expected = 2 * np.arctanh(np.tanh(1.5) * np.exp(-RATES * t[:, None]))
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-9, atol=1e-12)

    # A steady ramp ends at its flow stress
    t = np.linspace(0, 40, 400)
    found = flow(t, 0.2 * t, 0.0, np.full(3, 0.05), RATES)[-1]
    expected = np.arcsinh(0.2 / (0.05 * RATES))
    # the splitting's error of a steady state: (its step of strain)^2 / 12 at most
    np.testing.assert_allclose(found, expected, atol=LONGEST_STEP**2)

    # Next to an integrator from outside
    t = np.linspace(0, 10, 200)
    strain = np.interp(t, [0, 2, 6, 8, 10], [0, 0.4, 0.4, 0.1, 0.25])
    found = flow(t, strain, 0.0, np.full(3, 0.1), RATES)
    for k, rate in enumerate(RATES):
        solved = solve_ivp(
            lambda s, y, r=rate: _speed(s) / 0.1 - r * np.sinh(y), (0, 10), [0.0], "LSODA", t, max_step=0.01,
            rtol=1e-9, atol=1e-9,
        )  # fmt: skip
        np.testing.assert_allclose(found[:, k], solved.y[0], atol=0.01)

    # Little stress is a maxwell element and much stays finite
    t = np.linspace(0, 10, 300)
    strain = 1e-3 * np.sin(t)
    found = flow(t, strain, 0.0, np.ones(3), RATES)
    np.testing.assert_allclose(found, hereditary(t, strain, 1 / RATES, 0.0), atol=1e-5)

    # A stress far beyond the flow stress stays finite
    found = flow(np.array([0.0, 1.0]), np.array([0.0, 500.0]), 0.0, np.ones(1), np.array([1e-8]))
    assert found[-1, 0] == pytest.approx(np.arcsinh(500 / 1e-8), abs=LONGEST_STEP**2)


def _speed(t):
    return np.interp(t, [0, 2, 2, 6, 6, 8, 8, 10], np.repeat([0.2, 0, -0.15, 0.075], 2))


@pytest.mark.parametrize("steps", [2, 7])
def test_rows_that_lie_far_apart_are_walked_in_steps(steps):
    few = np.linspace(0, 1, steps)
    many = np.linspace(0, 1, 600)
    last = [flow(t, t, 0.0, np.full(3, 0.02), RATES)[-1] for t in (few, many)]
    np.testing.assert_allclose(*last, atol=LONGEST_STEP**2)
