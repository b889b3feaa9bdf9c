"""What is solved at a few sites stands for all where the bend depends on depth alone."""

import numpy as np
import pytest

from gelforge.mismatch.inference.fits import bent

DEPTHS = np.tile(np.linspace(0.25, 2.0, 8), 12)
SITE = np.repeat(np.arange(12), 8)


def change(rng, bend):
    """Return a linear change (R, 3) of its own size at each site, and the same bent by a function of depth."""
    size = rng.uniform(0.5, 1.5, 12)[SITE]
    linear = size[:, None] * np.column_stack([0.1 * DEPTHS, -0.2 * DEPTHS, DEPTHS**1.5])
    return linear, linear * (1 + bend(DEPTHS))[:, None]


def test_a_bend_that_is_a_parabola_of_depth_is_carried_to_all_sites():
    linear, solved = change(np.random.default_rng(1), lambda d: 0.05 * d - 0.1 * d**2)
    near = np.isin(SITE, [0, 5])
    found = bent(linear, np.where(near[:, None], solved, np.nan), near, DEPTHS)
    assert np.array_equal(found[near], solved[near])
    assert np.abs(found - solved).max() < 0.02 * np.abs(solved - linear).max()

    # What is linear stays so
    linear, solved = change(np.random.default_rng(2), lambda d: 0 * d)
    assert bent(linear, solved, np.isin(SITE, [3]), DEPTHS) == pytest.approx(linear, abs=1e-12)

    # Without any change there is none
    none = np.zeros((len(SITE), 3))
    assert not bent(none, none, np.isin(SITE, [3]), DEPTHS).any()
