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


def test_it_solves_within_its_steps_also_as_the_preconditioner_changes(system, rng):
    # It solves within its steps and target
    A, b = system
    for target in (1e-2, 1e-6, 1e-12):
        x, steps = flexible_gmres(lambda v: A @ v, lambda v: v, b, target, 40)
        assert np.linalg.norm(b - A @ x) <= 1.01 * target  # rounding of the residual's recurrence
        assert steps < 40

    # An exact preconditioner takes one step
    inverse = np.linalg.inv(A)
    x, steps = flexible_gmres(lambda v: A @ v, lambda v: inverse @ v, b, 1e-10, 40)
    assert steps == 1
    assert_allclose(A @ x, b, atol=1e-10)

    # Of too few steps the least residual is returned
    x, steps = flexible_gmres(lambda v: A @ v, lambda v: v, b, 0.0, 3)
    space = np.stack([b, A @ b, A @ A @ b], axis=1)
    best = space @ np.linalg.lstsq(A @ space, b, rcond=None)[0]
    assert steps == 3
    assert_allclose(x, best, atol=1e-9)

    # What is within the target already is left alone
    x, steps = flexible_gmres(lambda v: A @ v, lambda v: v, b, 2 * np.linalg.norm(b), 40)
    assert steps == 0 and not x.any()

    # The preconditioner may change from step to step
    scales = iter(rng.uniform(0.5, 2.0, 100))
    x, _ = flexible_gmres(lambda v: A @ v, lambda v: next(scales) * v, b, 1e-9, 40)
    assert_allclose(A @ x, b, atol=1e-8)
