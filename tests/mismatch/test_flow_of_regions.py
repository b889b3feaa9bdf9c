"""Mean motion and flow of regions of an image, and how far placements of particles scatter: closed forms, no session."""

import sys
from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose
from scipy.sparse import csr_array

from gelforge.config import Camera, VirtualImaging
from gelforge.mismatch.images.flow_covariance import neighbours, scatter_of
from gelforge.mismatch.images.flow_images import (
    REGIONS,
    CameraView,
    mean_motion,
    mean_motion_slope,
    pinhole,
    region_means,
    region_middles,
)
from gelforge.recording.optics.camera import project

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import flow_channel


def test_mean_motion_of_a_shifted_and_a_growing_picture_and_its_slope():
    # Mean motion of a shifted and of a growing picture. Parallel rays: every region sees the same, whatever points
    # lie in it, cropped or not
    flat = Camera(**(flow_channel.CAMERA | {"focal_px": None, "mm_per_px": 0.05, "position_mm": [8, 8, -4]}))
    points = np.random.default_rng(0).uniform([0, 0, -4], [16, 16, 0], (400, 3))
    for crop in (None, (40, 30, 300, 200)):
        eye = CameraView(flat, crop, VirtualImaging())
        motion = mean_motion(eye, points, np.tile([0.1, -0.2, 0.0], (len(points), 1)))
        expected = project(flat, [0.1, -0.2, 0.0])[0] - project(flat, [0.0, 0.0, 0.0])[0]
        # rays are parallel within 1e-3
        assert_allclose(motion, np.tile(expected, (REGIONS**2, 1)), rtol=2e-3)

    # What grows by a about the optical axis moves each region by a times the distance of its
    # middle.
    middle = np.array([8.0, 8.0, 0.0])
    grid = np.stack(np.meshgrid(*[np.linspace(-6, 22, 281)] * 2), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.full(len(grid), -1.0)])
    for crop in (None, (40, 30, 300, 200)):
        motion = mean_motion(
            CameraView(flat, crop, VirtualImaging()), points, 0.01 * (points - middle) * [1, 1, 0]
        )
        left, top, width, height = crop or (0, 0, 400, 400)
        u, v = (
            (np.arange(REGIONS) + 0.5) * n / REGIONS + first - 200
            for n, first in ((width, left), (height, top))
        )
        expected = 0.01 * np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        # of up to 1.75 px: the grid's points against a region's edges
        assert_allclose(motion, expected, atol=0.01)

    # Slope of the mean motion is that of a difference. Of nodes whose weights are drawn, about a displaced state: a
    # difference of half a per cent of the motion
    rng = np.random.default_rng(3)
    eye = CameraView(Camera(**flow_channel.CAMERA), (40, 30, 300, 200), VirtualImaging())
    points = rng.uniform([0, 0, -4], [16, 16, 0], (300, 3))
    weights = csr_array(rng.uniform(0, 0.2, (300, 12)))
    nodes, step = 0.3 * rng.standard_normal((12, 3)), 1e-3 * rng.standard_normal((12, 3))
    slope = mean_motion_slope(eye, points, weights @ nodes, weights)
    assert slope.shape == (REGIONS**2, 2, 12, 3)
    there, here = (mean_motion(eye, points, weights @ u) for u in (nodes + step, nodes))
    difference = there - here
    # the projection's curvature over a step of a thousandth
    assert_allclose(np.tensordot(slope, step, 2), difference, atol=5e-3 * np.abs(difference).max())


def test_scatter_parts_what_regions_and_neighbours_share():
    """ARTIFICIAL flows off by a share of 10 % per region, and by 0.05 px in every image: each is found, within 10 %."""
    rng, K = np.random.default_rng(1), 40
    base = 3 * rng.standard_normal((6, 1, REGIONS**2, 2))
    share, own = 0.1 * rng.standard_normal((1, K, REGIONS**2, 1)), rng.standard_normal((6, K, REGIONS**2, 2))
    scatter = scatter_of(base * (1 + share) + 0.05 * own, np.ones(REGIONS**2, bool))
    assert_allclose(np.median(np.abs(scatter.shared / base[:, 0])), 0.1, rtol=0.1)
    assert_allclose(scatter.rest.mean(), 0.05, rtol=0.1)

    # ARTIFICIAL shares whose correlation falls by 0.4 from region to region, and a rest without
    # any.
    rng, K, m = np.random.default_rng(2), 400, REGIONS**2
    root = neighbours(0.4)
    base = 30 * rng.standard_normal((4, 1, m, 2))
    share = 0.1 * (rng.standard_normal((K, m)) @ root.T)
    own = rng.standard_normal((4, K, m, 2))
    shown = np.ones((REGIONS, REGIONS), bool)
    shown[0] = False
    shown, still = (
        shown.ravel(),
        np.arange(m) % REGIONS == 0,
    )  # a rim without the gel, and one that does not move
    base[:, :, still] = 0.0
    drawn = base * (1 + share[None, :, :, None]) + 0.05 * own
    drawn[:, :, ~shown] = rng.standard_normal((4, K, REGIONS, 2))  # whatever is found there
    scatter = scatter_of(drawn, shown)
    assert_allclose(scatter.correlation, 0.4, atol=0.03)
    assert scatter_of(np.zeros((2, K, m, 2)), shown).correlation == 0.0
    across = (root @ root.T).reshape(REGIONS, REGIONS, REGIONS, REGIONS)
    assert_allclose([across[2, 3, 2, 3], across[2, 3, 2, 4], across[2, 3, 4, 2]], [1.0, 0.4, 0.4**3])


def test_regions_have_means_by_area_and_a_flat_scale_is_a_pinhole_far_away():
    # Regions have means by area and middles of the image
    flow = np.arange(2.0 * 12 * 20).reshape(12, 20, 2)  # 12 / 8 and 20 / 8 pixels: regions share pixels
    means = region_means(flow)
    assert means.shape == (REGIONS**2, 2)
    assert_allclose(means.mean(axis=0), flow.mean(axis=(0, 1)), rtol=1e-12)
    # the first region: rows 0 and half of 1, columns 0, 1 and half of 2
    expected = (
        flow[0, 0] + flow[0, 1] + flow[0, 2] / 2 + (flow[1, 0] + flow[1, 1] + flow[1, 2] / 2) / 2
    ) / 3.75
    assert_allclose(means[0], expected, rtol=1e-12)

    # Middles of regions are those of the image as taken
    camera = Camera(**flow_channel.CAMERA)
    whole, cut = (
        region_middles(CameraView(camera, crop, VirtualImaging())) for crop in (None, (40, 30, 320, 240))
    )
    assert_allclose([whole[0], whole[1], whole[REGIONS]], [[24.5, 24.5], [74.5, 24.5], [24.5, 74.5]])
    assert_allclose([cut[0], cut[-1]], [[40 + 19.5, 30 + 14.5], [40 + 320 - 20.5, 30 + 240 - 15.5]])

    # A flat scale is a pinhole far away
    flat = Camera(
        width_px=400,
        height_px=400,
        mm_per_px=0.04,
        centre_px=[199.5, 199.5],
        position_mm=[8, 8, -4],
        rotation_deg=[2, 0, 5],
    )
    points = np.random.default_rng(0).uniform([0, 0, -4], [16, 16, 0], (50, 3))
    # heights of 4 mm at 10 m: 4e-4 of at most 200 px
    assert_allclose(project(pinhole(flat), points)[0], project(flat, points)[0], atol=0.1)
