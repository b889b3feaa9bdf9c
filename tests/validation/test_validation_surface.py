"""The surface through a few solved places: through them, with the symmetry of the square, without a swing at a kink."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from validation.surface import Surface

NODES, DEPTHS = np.array([0.0, 2.0, 4.0, 5.5, 6.0, 6.4, 6.8]), np.array([0.2, 0.4, 0.8, 1.2, 1.6])


def over(of_x, of_y, degree=1, sign=1):
    """Return the surface through of_x(x) of_y(y) (1 + depth) at the nodes."""
    values = of_x(NODES)[:, None, None] * of_y(NODES)[None, :, None] * (1 + DEPTHS)
    return Surface.through(NODES, DEPTHS, values, degree, sign)


def pull(x):
    """Return a sideways pull that sets in where the contact reaches the wall."""
    return 0.002 * x + 0.07 * np.maximum(x - 5.7, 0.0)


def test_it_passes_through_what_was_solved_without_swings_or_jumps():
    # It passes through what was solved
    surface = over(pull, lambda y: 1 + 0.01 * y**2, sign=-1)
    x, y, depth = (a.ravel() for a in np.meshgrid(NODES, NODES, DEPTHS, indexing="ij"))
    assert_allclose(surface.at(x, y, depth), pull(x) * (1 + 0.01 * y**2) * (1 + depth), atol=1e-13)

    # It does not swing next to a kink. A polynomial through all nodes falls below 0 and rises again there; between
    # nodes the pull only grows
    x = np.linspace(0.0, 6.8, 400)
    found = over(pull, np.ones_like, sign=-1).at(x, 0 * x, 0 * x)
    assert (np.diff(found) > 0).all() and found[0] == 0
    # a kink between two nodes is rounded, by less than their chord passes next to it
    assert np.abs(found - pull(x)).max() < 0.07 * (5.7 - 5.5) * (6.0 - 5.7) / (6.0 - 5.5)

    # Over depth it is the nearest polynomial
    jumps = np.broadcast_to(1 + DEPTHS + np.array([1, -4, 6, -4, 1]) * 1e-3, (7, 7, 5))
    surface = Surface.through(NODES, DEPTHS, jumps, 3)
    fit = np.polynomial.Polynomial.fit(DEPTHS, jumps[0, 0], 3)
    depth = np.linspace(0.2, 1.6, 9)
    assert_allclose(surface.at(0 * depth + 4.7, 0 * depth + 0.3, depth), fit(depth), rtol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_it_has_the_symmetry_of_the_square(sign):
    rng = np.random.default_rng(3)
    x, y, depth = rng.uniform(0.1, 7, 50), rng.uniform(0.1, 7, 50), rng.uniform(0.2, 1.8, 50)
    surface = over(lambda x: x if sign < 0 else 1 + x**2, lambda y: 2 + np.cos(y), degree=2, sign=sign)
    assert_allclose(surface.at(-x, y, depth), sign * surface.at(x, y, depth), atol=1e-13)
    assert_allclose(surface.at(x, -y, depth), surface.at(x, y, depth), atol=1e-13)
    alike = over(lambda x: np.cos(1.3 * x), lambda y: np.cos(1.3 * y))
    assert_allclose(alike.at(x, y, depth), alike.at(y, x, depth), atol=1e-13)
