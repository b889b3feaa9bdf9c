"""Flexible GMRES against dense solutions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.mechanics.linear.krylov import flexible_gmres


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.fixture
def system(rng):
    A = np.eye(40) + 0.3 * rng.standard_normal((40, 40)) / np.sqrt(40)
    return A, rng.standard_normal(40)


def test_it_solves_an_unsymmetric_system_to_the_target(system):
    A, b = system
    for target in (1e-2, 1e-6, 1e-12):
        x, steps = flexible_gmres(lambda v: A @ v, lambda v: v, b, target, 40)
        assert np.linalg.norm(b - A @ x) <= 1.01 * target  # rounding of the residual's recurrence
        assert steps < 40


def test_an_exact_preconditioner_takes_one_step(system):
    A, b = system
    inverse = np.linalg.inv(A)
    x, steps = flexible_gmres(lambda v: A @ v, lambda v: inverse @ v, b, 1e-10, 40)
    assert steps == 1
    assert_allclose(A @ x, b, atol=1e-10)


def test_the_preconditioner_may_change_from_step_to_step(system, rng):
    A, b = system
    scales = iter(rng.uniform(0.5, 2.0, 100))
    x, _ = flexible_gmres(lambda v: A @ v, lambda v: next(scales) * v, b, 1e-9, 40)
    assert_allclose(A @ x, b, atol=1e-8)


def test_of_too_few_steps_the_least_residual_is_returned(system):
    A, b = system
    x, steps = flexible_gmres(lambda v: A @ v, lambda v: v, b, 0.0, 3)
    space = np.stack([b, A @ b, A @ A @ b], axis=1)
    best = space @ np.linalg.lstsq(A @ space, b, rcond=None)[0]
    assert steps == 3
    assert_allclose(x, best, atol=1e-9)


def test_what_is_within_the_target_already_is_left_alone(system):
    A, b = system
    x, steps = flexible_gmres(lambda v: A @ v, lambda v: v, b, 2 * np.linalg.norm(b), 40)
    assert steps == 0 and not x.any()
