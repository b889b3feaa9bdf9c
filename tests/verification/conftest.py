"""Fixtures of the verification tests."""

import numpy as np
import pytest


@pytest.fixture
def rng():
    """Return a generator of its own for every test, so that a test does not depend on those before it."""
    return np.random.default_rng(21)
