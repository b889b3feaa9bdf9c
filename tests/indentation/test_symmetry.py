"""The symmetries of the square: a group, acting alike on points, vectors and bins."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.config import Bins, Layer, Sensor, Shape
from gelforge.indentation.sensor.symmetry import D4, transform_bins, transform_points, transform_vectors
from gelforge.indentation.sensor.unrolled import bin_points

WIDTH, N = 12.0, 5
rng = np.random.default_rng(0)


def test_eight_elements_form_a_group_and_do_not_change_their_argument():
    # Eight different elements closed under products and inverses
    members = {tuple(matrix.ravel()) for matrix in D4.values()}
    assert len(members) == 8
    assert {tuple((a @ b).ravel()) for a in D4.values() for b in D4.values()} == members
    assert {tuple(matrix.T.ravel()) for matrix in D4.values()} == members
    assert all(np.array_equal(matrix @ matrix.T, np.eye(2)) for matrix in D4.values())

    # Transformations do not change their argument
    points, bins = rng.normal(size=(4, 3)), rng.normal(size=(N * N, 3))
    before = points.copy(), bins.copy()
    (
        transform_points("rotate_90", points, WIDTH),
        transform_vectors("rotate_90", points),
        transform_bins("swap_xy", bins, N),
    )
    assert np.array_equal(points, before[0])
    assert np.array_equal(bins, before[1])


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("identity", (10.0, 3.0)),
        ("rotate_90", (9.0, 10.0)),
        ("rotate_180", (2.0, 9.0)),
        ("rotate_270", (3.0, 2.0)),
        ("mirror_x", (2.0, 3.0)),
        ("mirror_y", (10.0, 9.0)),
        ("swap_xy", (3.0, 10.0)),
        ("swap_xy_negative", (9.0, 2.0)),
    ],
)
def test_names_say_what_they_do(name, image):
    """By hand: rotations are counter-clockwise seen from above, mirror_x turns x around."""
    assert_allclose(transform_points(name, np.array([10.0, 3.0]), WIDTH), image)
    assert_allclose(transform_points(name, np.array([10.0, 3.0, -1.0]), WIDTH), [*image, -1.0])


@pytest.mark.parametrize("name", D4)
def test_vectors_turn_with_the_points(name):
    points, arrows = rng.uniform(0, WIDTH, (7, 3)), rng.normal(size=(7, 3))
    moved = transform_points(name, points + arrows, WIDTH) - transform_points(name, points, WIDTH)
    assert_allclose(transform_vectors(name, arrows), moved, atol=1e-14)


@pytest.mark.parametrize("name", D4)
@pytest.mark.parametrize("n", [4, 5])
@pytest.mark.parametrize("over", ["plan", "surface"])
def test_bins_go_where_their_centres_go(name, n, over):
    """Brute force: each bin's force turns and lands in the bin whose centre is the transformed centre."""
    forces = rng.normal(size=(2, n * n, 3))
    layers = [Layer(name="gel", thickness_mm=0.3 * WIDTH, material="soft")]
    shape, bins = Shape(kind="dome"), Bins(nx=n, ny=n, over=over)
    dome = Sensor(width_x_mm=WIDTH, width_y_mm=WIDTH, layers=layers, shape=shape, bins=bins, wall_mm=0)
    centres = bin_points(dome)
    expected = np.full_like(forces, np.nan)
    for k, centre in enumerate(centres):
        landing = np.linalg.norm(centres - transform_points(name, centre, WIDTH), axis=1)
        assert landing.min() < 1e-7 * WIDTH  # the top of a dome, found by its area, which is flat there
        expected[:, landing.argmin()] = transform_vectors(name, forces[:, k])
    assert_allclose(transform_bins(name, forces, n), expected, atol=1e-15)
