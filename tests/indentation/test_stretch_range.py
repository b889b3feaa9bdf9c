"""Stretches of elements and whether they leave a law's tested range, against deformations that are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.indentation.solving.stretch_range import element_stretches, stretch_ranges, unstable_shares
from gelforge.materials.fitting.valid_range import ValidRange
from gelforge.mechanics.laws.homogeneous import principal_stretches
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.laws.models.yeoh import Yeoh
from gelforge.mechanics.meshes.elements import element_gradient, mean_gradient
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block


@pytest.fixture(scope="module")
def mesh():
    block = Block(width_x=8.0, width_y=8.0, layers=(("gel", 2.0), ("skin", 1.0)), wall=1.0)
    return layered_block(block, 4.0, 4.0, Sizes(near=1.0, near_radius=2.0, far=2.0))


def stretches(mesh, F):
    gradient, weight = element_gradient(mesh.X, mesh.elements)
    u = mesh.X @ (np.asarray(F) - np.eye(3)).T
    return element_stretches(mean_gradient(gradient, weight), mesh.elements, u), weight.sum(axis=1)


def test_principal_stretches_of_known_deformations(mesh):
    Q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    R, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    lam, _ = stretches(mesh, Q @ np.diag([1.5, 0.9, 0.7]) @ R)
    assert_allclose(lam, np.broadcast_to([0.7, 0.9, 1.5], lam.shape), rtol=1e-10)  # rounding of X of 10 mm

    # Simple shear has reciprocal stretches
    lam, _ = stretches(mesh, [[1, 0, 0.5], [0, 1, 0], [0, 0, 1]])
    l = (0.5 + np.sqrt(0.5**2 + 4)) / 2
    assert_allclose(lam[0], [1 / l, 1, l], rtol=1e-10)


def test_the_range_is_judged_by_region_depth_and_volume(mesh):
    valid = ValidRange.of(principal_stretches("uniaxial", np.array([1.0, 1.5])))
    states = [stretches(mesh, np.diag(principal_stretches("uniaxial", np.array(v))))[0] for v in (1.4, 1.6)]
    volume = stretches(mesh, np.eye(3))[1]
    regions = len(mesh.regions)
    found = stretch_ranges(states, volume, mesh.region, [valid.outside] * regions)
    assert found["leaves_valid_range"].tolist() == [0, 1]
    assert_allclose(found["stretch_range"][:, 0], [[1.4**-0.5, 1.4], [1.6**-0.5, 1.6]], rtol=1e-10)
    assert_allclose(found["volume_outside_valid_range"], [[0.0] * regions, [1.0] * regions])
    some = stretch_ranges(states, volume, mesh.region, [valid.outside] + [None] * (regions - 1))
    assert some["leaves_valid_range"].tolist() == [-1, 1]  # not known of one region, left by another
    assert np.isnan(some["volume_outside_valid_range"][:, 1:]).all()

    # A part of the volume is counted by volume
    lam, volume = stretches(mesh, np.eye(3))
    lam, marked = lam.copy(), np.flatnonzero(mesh.region == 0)[:3]
    lam[marked] = [0.5, 1.0, 2.0]
    found = stretch_ranges([lam], volume, mesh.region, [lambda s: s[:, 2] > 1.5] * len(mesh.regions))
    share = volume[marked].sum() / volume[mesh.region == 0].sum()
    assert found["volume_outside_valid_range"][0, 0] == pytest.approx(share)

    # A cell without depths has empty attributes
    found = stretch_ranges([], np.ones(3), np.zeros(3, int), [None])
    assert found["stretch_range"].shape == (0, 1, 2) and found["leaves_valid_range"].shape == (0,)


def test_a_law_that_is_unstable_where_it_went_is_told_by_region_depth_and_volume(mesh):
    falling, stable = (
        Yeoh(0.01, -0.006, 0.0),
        NeoHooke(0.01),
    )  # the first falls from a uniaxial stretch of 1.4 on
    lam, volume = stretches(mesh, np.eye(3))
    far, marked = lam.copy(), np.flatnonzero(mesh.region == 0)[:3]
    far[marked] = [2**-0.5, 2**-0.5, 2.0]
    laws = [falling] + [stable] * (len(mesh.regions) - 1)
    found = unstable_shares([lam, far], volume, mesh.region, laws)
    assert found["law_unstable"].tolist() == [0, 1]
    share = volume[marked].sum() / volume[mesh.region == 0].sum()
    assert_allclose(found["volume_law_unstable"][1], [share] + [0.0] * (len(laws) - 1))
    assert not unstable_shares([far], volume, mesh.region, [None] * len(laws))["law_unstable"].any()
    assert unstable_shares([], volume, mesh.region, laws)["law_unstable"].shape == (0,)
