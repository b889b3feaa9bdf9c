"""Nodal forces to bins: the rule against numerical integration, nothing lost."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.indentation.binning import bin_centres, bin_forces, hat_shares, node_shares, without_dust

WIDTH, N = 8.0, 5
LINES = np.array(
    [0.0, 0.5, 1.6, 1.9, 2.0, 4.4, 4.8, 6.0, 7.9, 8.0]
)  # on edges, several in a bin, one over two bins
rng = np.random.default_rng(6)


@pytest.mark.parametrize("rule", [hat_shares, node_shares])
def test_every_node_gives_all_it_has(rule):
    for lines in (LINES, np.linspace(0, WIDTH, 4), np.linspace(0, WIDTH, 37)):
        shares = rule(lines, WIDTH, N)
        assert_allclose(shares.sum(axis=0), 1, rtol=1e-14)
        assert shares.min() >= 0


def test_hat_shares_equal_numerical_integration():
    fine = (np.arange(400_000) + 0.5) * WIDTH / 400_000
    bins = (fine / WIDTH * N).astype(int)
    for line, unit in enumerate(np.eye(len(LINES))):
        hat = np.interp(fine, LINES, unit)
        expected = np.bincount(bins, hat, minlength=N) / hat.sum()
        # midpoint rule, 4 points per 1e-4 of the narrowest hat (0.1 mm): edges cost half a point each
        assert_allclose(hat_shares(LINES, WIDTH, N)[:, line], expected, atol=1e-6)


def test_hat_share_by_hand():
    """Hat of 0-1-2 with an edge at 1.6: its right end of length 0.4 holds 0.4^2 / 2 of an area of 1."""
    shares = hat_shares(np.array([0.0, 1.0, 2.0, 8.0]), WIDTH, N)
    assert_allclose(shares[:, 1], [0.92, 0.08, 0, 0, 0], atol=1e-14)


def test_a_uniform_pressure_fills_all_bins_alike():
    """Forces of a uniform pressure are hat integrals; the bins then carry equal forces, whatever the lines."""
    size = np.diff(LINES)
    integral = (np.append(size, 0) + np.insert(size, 0, 0)) / 2
    assert_allclose(hat_shares(LINES, WIDTH, N) @ integral, WIDTH / N, rtol=1e-13)


def test_node_rule_gives_a_node_on_an_edge_to_both_bins():
    shares = node_shares(np.array([0.0, 0.5, 1.6, 1.7, 8.0]), WIDTH, N)
    expected = [[1, 1, 0.5, 0, 0], [0, 0, 0.5, 1, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 1]]
    assert_allclose(shares, expected)


def test_node_rule_sees_an_edge_through_rounding():
    lines = np.array([0.0, 1.6 - 1e-13, 4.8 + 1e-13, 8.0])
    assert_allclose(node_shares(lines, WIDTH, N)[:, 1:3].max(axis=0), 0.5)


def test_bins_equal_brute_force_and_keep_the_total():
    ly = np.array([0.0, 1.0, 3.3, 6.0])
    forces = rng.normal(size=(2, len(ly) * len(LINES), 3))
    sx, sy = hat_shares(LINES, WIDTH, N), hat_shares(ly, 6.0, 3)
    found = bin_forces(forces, sx, sy)
    expected = np.zeros((2, 3 * N, 3))
    for j in range(len(ly)):
        for i in range(len(LINES)):
            for iy in range(3):
                for ix in range(N):
                    expected[:, N * iy + ix] += sx[ix, i] * sy[iy, j] * forces[:, len(LINES) * j + i]
    assert_allclose(found, expected, atol=1e-14)
    assert_allclose(found.sum(axis=1), forces.sum(axis=1), atol=1e-12)


def test_bin_centres_count_x_first():
    centres = bin_centres(8.0, 6.0, 4, 3)
    assert centres.shape == (12, 2)
    assert_allclose(centres[[0, 1, 4, 11]], [[1, 1], [3, 1], [1, 3], [7, 5]])


def test_dust_becomes_exact_zeros():
    assert np.array_equal(without_dust(np.array([1e-10, -9e-10, 2e-9, -0.1])), [0, 0, 2e-9, -0.1])
