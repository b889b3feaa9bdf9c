"""Images moved by a field."""

import cv2
import numpy as np
from numpy.testing import assert_allclose

from gelforge.recording.imaging.warp import warped


def test_a_warp_moves_every_pixel_by_its_field():
    """Of a smooth picture, by a field of up to 3 px: what was at p is at p + field(p)."""
    v, u = np.meshgrid(np.arange(120.0), np.arange(160.0), indexing="ij")

    def smooth(u, v):
        return 100 + 50 * np.sin(u / 9) * np.cos(v / 11)

    field = np.stack([3 * np.sin(v / 25), 2 * np.cos(u / 30)], axis=-1).astype(np.float32)
    moved = warped(smooth(u, v), field)
    there = u + field[..., 0], v + field[..., 1]
    inside = (slice(8, -8), slice(8, -8))
    found = cv2.remap(moved, *(one.astype(np.float32) for one in there), cv2.INTER_CUBIC)
    # cubic interpolation, at 1/32 px, of slopes of 6 levels a pixel
    assert_allclose(found[inside], smooth(u, v)[inside], atol=0.3)
    assert np.abs(moved - smooth(u, v))[inside].max() > 10
