"""Indenters: the gap, its gradient (the normal) and the normal's gradient, by rates."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.mechanics.indenters import Sphere

INDENTERS = {"small ball": Sphere(2.0), "ball": Sphere(5.0)}
rng = np.random.default_rng(2)


@pytest.fixture(params=INDENTERS.values(), ids=INDENTERS.keys())
def indenter(request):
    return request.param


def cloud(indenter):
    """Return points around an indenter's lower half, and its centre."""
    centre = np.array([1.0, -2.0, 3.0])
    ray = rng.normal(size=(50, 3)) - [0, 0, 1.5]
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    return centre + ray * indenter.radius * rng.uniform(0.9, 1.3, (50, 1)), centre


def halving_rates(value, slope):
    """Return the rates with which |value(h) - value(0) - h slope| falls as h is halved."""
    steps = 1e-2 * 0.5 ** np.arange(4)
    remainder = [np.linalg.norm(value(h) - value(0) - h * slope) for h in steps]
    return np.log2(np.divide(remainder[:-1], remainder[1:]))


def test_start_touches_the_undeformed_top_from_above(indenter):
    centre = indenter.start(4.0, 7.0)
    gap, normal, _ = indenter.gap(np.array([[4.0, 7.0, 0.0], [4.5, 7.0, 0.0]]), centre)
    assert gap[0] == 0
    assert gap[1] > 0
    assert_allclose(normal[0], [0, 0, -1], atol=1e-16)


def test_gap_is_the_distance_to_the_surface(indenter):
    points, centre = cloud(indenter)
    gap, normal, _ = indenter.gap(points, centre)
    foot = points - gap[:, None] * normal
    assert_allclose(np.linalg.norm(foot - centre, axis=1), indenter.radius, rtol=1e-14)
    assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-14)


def test_normal_is_the_gradient_of_the_gap(indenter):
    points, centre = cloud(indenter)
    direction = rng.normal(size=points.shape)
    slope = np.einsum("ni,ni->n", indenter.gap(points, centre)[1], direction)
    rates = halving_rates(lambda h: indenter.gap(points + h * direction, centre)[0], slope)
    assert_allclose(rates, 2, atol=0.05)  # second order, the third one small at these steps


def test_turn_is_the_gradient_of_the_normal(indenter):
    points, centre = cloud(indenter)
    direction = rng.normal(size=points.shape)
    slope = np.einsum("nij,nj->ni", indenter.gap(points, centre)[2], direction)
    rates = halving_rates(lambda h: indenter.gap(points + h * direction, centre)[1], slope)
    assert_allclose(rates, 2, atol=0.05)


def test_vertical_gap_measures_straight_up_to_the_ball(indenter):
    points, centre = cloud(indenter)
    gap, normal, turn = indenter.vertical_gap(points, centre)
    below = np.linalg.norm(points[:, :2] - centre[:2], axis=1) < indenter.radius
    assert 10 < below.sum() < len(points)
    lifted = points[below] + gap[below][:, None] * [0, 0, 1]
    assert_allclose(np.linalg.norm(lifted - centre, axis=1), indenter.radius, rtol=1e-13)
    assert (lifted[:, 2] <= centre[2]).all()
    assert_allclose(gap[~below], centre[2] - points[~below, 2])
    assert (normal == [0, 0, -1]).all()
    assert not turn.any()
