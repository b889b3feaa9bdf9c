"""Where a reference frame shows enough for a search to follow, and the flow that stands in elsewhere.

On smooth ground (between printed dots, on a wall without particles) a search finds the motion of the camera's noise: several
pixels where nothing moves. A pixel's flow is the mean of the patches that cover it, so all of these need texture in two
directions (Shi and Tomasi 1994, doi:10.1109/CVPR.1994.323794). Elsewhere the flow is that of the nearest texture, by
normalised convolution (Knutsson and Westin 1993, doi:10.1109/CVPR.1993.341081); far from all texture it falls to zero.
"""

from __future__ import annotations

import cv2
import numpy as np

# Immerkaer's operator of 1996 (doi:10.1006/cviu.1996.0060) divided by its norm: white noise keeps its standard deviation.
NOISE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6

# Untouched dots do not move in any light, stripes are no texture, speckle is (tests/recording/test_texture.py):
NOISE_PX = 16  # side of the squares among which the smoothest show the noise
# of these squares: most of a dotted image is smooth, and the lowest lie a fifth below the mean
# (tests/recording/test_texture.py)
NOISE_PERCENTILE = 2.0
# Rounding to whole grey levels leaves 1 / sqrt(12) = 0.29; a camera's own at most: above it the smoothest squares show
# texture. Noise of 1 to 3.5 is found to a quarter (tests/recording/test_texture.py).
NOISE_GREY = 0.3, 4.0
# Smaller eigenvalue of the gradients' mean product, over the noise's variance. Measured under noise of 2 grey levels: noise
# alone has 0.03, 0.06 at most; dots of 20 grey levels have 2 to 4, speckle 20.
LEAST_RATIO = 0.1
# Of texture in the weighted neighbourhood, below which the flow that stands in falls to zero: between dots it is far above
# (tests/recording/test_texture.py).
FAR_SHARE = 1e-4


def noise_grey(image: np.ndarray) -> float:
    """Return the standard deviation [grey levels] of the noise of an image (H, W), from its smoothest parts."""
    square = cv2.blur(cv2.filter2D(image.astype(np.float32), -1, NOISE) ** 2, (NOISE_PX, NOISE_PX))
    low, high = NOISE_GREY
    smoothest = max(float(np.percentile(square, NOISE_PERCENTILE)), 0.0)  # a running sum may round below zero
    return float(np.clip(np.sqrt(smoothest), low, high))


def textured(image: np.ndarray, patch_px: int) -> np.ndarray:
    """Return (H, W) bool: the pixels of which every square of patch_px that covers them shows texture in two directions."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    step = np.array([[-0.5, 0, 0.5]], np.float32)
    along, down = cv2.filter2D(smooth, -1, step), cv2.filter2D(smooth, -1, step.T)
    xx, xy, yy = (
        cv2.blur(product, (patch_px, patch_px)) for product in (along * along, along * down, down * down)
    )
    smaller = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy * xy)
    shown = smaller > LEAST_RATIO * noise_grey(image) ** 2
    cover = np.ones((patch_px + 1, patch_px + 1), np.uint8)
    return cv2.erode(shown.astype(np.uint8), cover, borderValue=1).astype(bool)


class Texture:
    """The textured pixels of a reference frame, and flow elsewhere from theirs."""

    def __init__(self, reference: np.ndarray, patch_px: int):
        self.mask = textured(reference, patch_px)
        self.everywhere = bool(self.mask.all())
        self.nowhere = not self.mask.any()
        if self.everywhere or self.nowhere:
            return
        away = cv2.distanceTransform((~self.mask).astype(np.uint8), cv2.DIST_L2, 5)[~self.mask].mean()
        # As wide as the gaps are: measured on dots 60 and 120 px apart, the best width is 0.9 of this one. The wide
        # convolution works on a smaller picture.
        self._reduced = max(1, round(away / 2))
        self._width = max(float(away), 1.0) / self._reduced
        share = self._convolved(self.mask.astype(np.float32))
        self._inverse = np.repeat((1 / (share + FAR_SHARE))[..., None], 2, axis=2)
        self._bytes = self.mask.astype(np.uint8)
        self._weight = np.repeat(self.mask[..., None], 2, axis=2).astype(np.float32)

    def fill(self, flow: np.ndarray) -> np.ndarray:
        """Return a flow (H, W, 2) float32 with that of the surrounding texture where there is none; textured pixels stay."""
        if self.everywhere or self.nowhere:
            return flow
        around = cv2.multiply(self._convolved(cv2.multiply(flow, self._weight)), self._inverse)
        filled = cv2.resize(around, flow.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        cv2.copyTo(flow, self._bytes, filled)
        return filled

    def _convolved(self, field: np.ndarray) -> np.ndarray:
        """Return the Gaussian mean of a field (H, W[, 2]) on the smaller picture."""
        height, width = (-(-pixels // self._reduced) for pixels in field.shape[:2])
        small = cv2.resize(field, (width, height), interpolation=cv2.INTER_AREA)
        return cv2.GaussianBlur(small, (0, 0), self._width)
