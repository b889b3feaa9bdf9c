"""Images of a session in the order taken, with what is measured of them and what follows for the session."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Camera
from gelforge.recording.imaging.flow import ImageError, read_grey
from gelforge.recording.imaging.image_measures import measured, pixel_digest, sample
from gelforge.recording.imaging.images import reference_path
from gelforge.robust import SIGMA_OF_MEDIAN

# Of 14 kinds of honest SYNTHETIC images each passes, and each fault is found (tests/recording/test_image_plausibility.py):
LEAST_TEXTURE = 0.1  # of the reference's textured pixels; black, white and badly blurred images show none
# Of the reference frame's mean grey level: a session at 0.3 of the light passes, one at a hundredth is refused
# (test_image_plausibility.py).
LEAST_LIGHT = 0.1
# The search itself repeats no better. Noiseless cameras pass (tests/recording/test_image_plausibility.py).
LEAST_SPREAD_PX = 0.003
# Where no flow was measured: a pressed surface moves sideways by more than a fiftieth of the depth, and no image shows more
# than 100 mm.
LEAST_MOTION, WIDEST_MM = 0.02, 100.0


@dataclass(frozen=True)
class ImageSeries:
    """Images of one session in the order taken, with their measures."""

    table: pd.DataFrame  # readings with measures and `run`; index: line of indentations.csv
    reference: str  # digest of the reference frame's pixels
    least_px_per_mm: float  # by which a surface moves in the image per mm of depth, at least
    levels: float = 256.0  # grey levels between the reference frame's darkest and brightest thousandth
    error: str = ""  # why the images cannot be measured

    @cached_property
    def blank(self) -> pd.Series:
        """Return (N,) bool: the images that are black, white, or show hardly any of the reference frame's texture."""
        return (self.table["texture"] < LEAST_TEXTURE) | (self.table["gain"] < LEAST_LIGHT)

    @cached_property
    def shown(self) -> pd.DataFrame:
        """Return the images that are not blank."""
        return self.table[~self.blank]

    @cached_property
    def depth(self) -> pd.Series:
        """Return the depth [mm] of each of these, 0 before contact."""
        return self.shown["depth_mm"].where(self.shown["phase"] != "zero", 0.0).fillna(0.0)

    @cached_property
    def before(self) -> pd.DataFrame:
        """Return those before contact that are not the reference frame itself."""
        shown = self.shown
        return shown[(shown["phase"] == "zero") & (shown["pixels"] != self.reference)]

    @cached_property
    def deep(self) -> pd.DataFrame:
        """Return those of the deeper half of depths."""
        return self.shown[self.depth >= 0.5 * self.depth.max()] if len(self.shown) else self.shown

    @cached_property
    def floor_px(self) -> tuple[float, float]:
        """Return the median flow of the images before contact and its robust standard deviation; 0 where there are none."""
        flow = self.before["flow_px"]
        if flow.empty:
            return 0.0, LEAST_SPREAD_PX
        spread = SIGMA_OF_MEDIAN * (flow - flow.median()).abs().median()
        return float(flow.median()), float(max(spread, LEAST_SPREAD_PX))

    @cached_property
    def answer_px(self) -> float:
        """Return the median flow of the deeper images."""
        return float(self.deep["flow_px"].median()) if len(self.deep) else 0.0

    @cached_property
    def px_per_mm(self) -> float:
        """Return by how much the image moves per mm of depth, measured or at least."""
        depth = self.depth[self.deep.index].median() if len(self.deep) else 0.0
        return max(self.answer_px / depth if depth > 0 else 0.0, self.least_px_per_mm)

    @property
    def indentations(self) -> int:
        return self.table["press"].nunique()


def image_series(folder: Path, readings: pd.DataFrame, camera: Camera | None, crop_px) -> ImageSeries:
    """Return a sample of a session's images, measured; an empty series for a session without images."""
    rows = sample(readings)
    try:
        reference = None if rows.empty else read_grey(reference_path(folder), crop_px)
        table = measured(folder, crop_px, rows)
    except ImageError as error:
        return ImageSeries(measured(folder, crop_px, rows[:0]), "", 0.0, error=str(error))
    return series_of(table, reference, camera)


def series_of(table: pd.DataFrame, reference: np.ndarray | None, camera: Camera | None) -> ImageSeries:
    """Return measured images as a series; reference: the frame (H, W), None where there are no images."""
    if reference is None:
        return ImageSeries(table, "", 0.0)
    scale = reference.shape[1] / WIDEST_MM
    if camera is not None and camera.mm_per_px:
        scale = 1 / camera.mm_per_px
    elif camera is not None and camera.focal_px:
        scale = camera.focal_px / max(abs(camera.position_mm[2]), 1.0)
    levels = float(np.ptp(np.percentile(reference, [0.1, 99.9])))
    return ImageSeries(table, pixel_digest(reference), LEAST_MOTION * scale, levels)
