"""What is measured of one image: light, texture, how far it moved, and how much of that motion fits the image."""

from __future__ import annotations

import hashlib
from dataclasses import astuple, dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from gelforge.progress import tracked
from gelforge.recording.imaging.flow import Flow, read_grey
from gelforge.recording.imaging.images import image_path, reference_path
from gelforge.recording.imaging.texture import textured
from gelforge.recording.imaging.warp import read_along

PRESET = "fine"  # of the flow where no study's settings are known

# Of 14 kinds of honest SYNTHETIC images each passes, and each fault is found (tests/recording/test_image_plausibility.py):
# A session is judged by this many runs of this many indentations one after another, spread over it: enough to see a lag, a
# frozen camera or a surface that the flow does not fit, in seconds. `features` measures every image.
RUNS, RUN_LENGTH = 3, 8
# A textured pixel is lost where forward and backward flow miss each other by this much, or where the image moved back hardly
# correlates with the reference. Measured on speckle, dots and drawn particles: flow that is right has at most 1 % of such
# pixels, flow with 2 % of its pixels wrong has 3.5 % and more (tests/recording/test_flow_lost.py).
APART_PX, APART_SHARE, LEAST_CORRELATION = 3.0, 0.25, 0.5  # share: of the flow's length, whichever is larger
# Standard deviation of an image over the reference's, above which its texture is not counted. Black, white and blurred
# images fall below it, honest ones do not (tests/recording/test_image_plausibility.py).
CONTRAST_KEPT = 0.5
# Side of the square in which images are correlated. About two of the 8 px patches of the search; right and wrong flow
# are distinguished (tests/recording/test_flow_lost.py).
WINDOW_PX = 17


@dataclass(frozen=True)
class Measures:
    """What is measured of one image."""

    grey: float  # mean [grey levels]
    gain: float  # mean over that of the reference frame
    texture: float  # textured pixels over those of the reference frame
    flow_px: float  # root mean square of the flow's length over all pixels, in pixels of the image before it was reduced
    flow_lost: (
        float  # share of the textured pixels whose flow does not fit the image; NaN where not asked for
    )
    pixels: str  # digest of the pixels
    bands: float = (
        0.0  # relative brightness of bright over mean rows (or columns), against those of the reference frame
    )


NAMES = list(Measures.__dataclass_fields__)


class Measurer:
    """Measures images against one reference frame, reduced to a scale as it is. Not shared between threads, as `Flow`."""

    def __init__(self, search: Flow, scale: float = 1.0):
        self.search, self.scale = search, scale
        self.mean, self.spread = float(search.reference.mean()), float(search.reference.std())
        self.textured = max(int(search.texture.mask.sum()), 1)

    def __call__(self, image: np.ndarray, flow: np.ndarray, with_lost: bool = False) -> Measures:
        """Return the measures of an image (H, W) uint8 whose flow (H, W, 2) is known."""
        grey = float(image.mean())
        return Measures(
            grey=grey,
            gain=grey / max(self.mean, 1e-9),
            texture=self._texture(image),
            flow_px=float(np.sqrt(np.mean(np.square(flow, dtype=np.float64).sum(axis=-1)))) / self.scale,
            flow_lost=flow_lost(self.search, image, flow, self.scale) if with_lost else float("nan"),
            pixels=pixel_digest(image),
            bands=banding(image, self.search.reference),
        )

    def _texture(self, image: np.ndarray) -> float:
        """Return the share of the reference's textured pixels; 1 without counting where contrast has not gone."""
        if image.std() > CONTRAST_KEPT * self.spread:
            return 1.0
        return float(textured(image, self.search.patch_px).sum() / self.textured)


def banding(image: np.ndarray, reference: np.ndarray) -> float:
    """Return half the range of relative brightness over the rows or columns of an image, against those of the reference.

    A quadratic is taken out: light that falls off to a side is no band. Motion of the texture averages out along a row.
    """
    amplitudes = []
    for axis in (0, 1):
        ratio = image.mean(axis=axis) / np.maximum(reference.mean(axis=axis), 1.0)
        size = max(3, len(ratio) // 40)
        ratio = np.convolve(ratio, np.full(size, 1 / size), "valid")
        at = np.linspace(-1, 1, len(ratio))
        even = ratio - np.polyval(np.polyfit(at, ratio, 2), at)
        amplitudes.append(np.ptp(np.quantile(even, [0.05, 0.95])) / 2 / max(float(np.median(ratio)), 1e-9))
    return float(max(amplitudes))


def pixel_digest(image: np.ndarray) -> str:
    """Return what two images share only if all their pixels are equal."""
    return hashlib.blake2b(image.tobytes(), digest_size=16).hexdigest()


def flow_lost(search: Flow, image: np.ndarray, flow: np.ndarray, scale: float = 1.0) -> float:
    """Return the share of the reference's textured pixels whose flow (H, W, 2) does not fit the image.

    It does not fit where the flow from the image back to the reference misses the start, or where the image, moved back,
    does not look like the reference around the pixel. What jumps to a like neighbour passes the second test where it lands,
    and fails the first. scale: to which the images were reduced; APART_PX is in pixels before, WINDOW_PX in those searched.
    """
    mask = search.texture.mask
    if not mask.any():
        return 0.0
    back = search.backward(image)
    missed = np.linalg.norm(flow + read_along(back, flow), axis=-1)
    apart = missed > np.maximum(APART_PX * scale, APART_SHARE * np.linalg.norm(flow, axis=-1))
    unlike = correlation(search.reference, read_along(image, flow)) < LEAST_CORRELATION
    return float((apart | unlike)[mask].mean())


def correlation(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the correlation (H, W) of two images in the square of WINDOW_PX around each pixel."""
    a, b = first.astype(np.float32), second.astype(np.float32)
    (ma, mb, aa, bb, ab) = (
        cv2.blur(product, (WINDOW_PX, WINDOW_PX)) for product in (a, b, a * a, b * b, a * b)
    )
    variances = np.maximum(aa - ma * ma, 1) * np.maximum(bb - mb * mb, 1)  # rounding alone has 1 / 12
    return (ab - ma * mb) / np.sqrt(variances)


def with_images(readings: pd.DataFrame) -> pd.DataFrame:
    """Return the readings before contact and under load that have an image."""
    return readings[(readings["image"] != "") & readings["phase"].isin(["zero", "load", "dwell"])]


def sample(readings: pd.DataFrame) -> pd.DataFrame:
    """Return the readings with images of a few runs of indentations, the column `run` numbering the runs."""
    rows = with_images(readings)
    order = rows["press"].drop_duplicates().to_list()
    if len(order) <= RUNS * RUN_LENGTH:
        return rows.assign(run=0)
    starts = np.linspace(0, len(order) - RUN_LENGTH, RUNS).round().astype(int)
    run_of = {press: k for k, start in enumerate(starts) for press in order[start : start + RUN_LENGTH]}
    rows = rows[rows["press"].isin(run_of)]
    return rows.assign(run=rows["press"].map(run_of))


def measured(folder: Path, crop_px: list[int] | None, rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows of readings with their images' measures as columns, `flow_lost` being NaN.

    Raises ImageError for an image that is missing, cannot be decoded or has another size.
    """
    if rows.empty:
        return add_measures(rows, [])
    search = Flow(read_grey(reference_path(folder), crop_px), PRESET)
    measurer = Measurer(search)
    names = tracked(list(rows["image"]), f"images of {folder.name} looked at")
    pictures = (read_grey(image_path(folder, name), crop_px) for name in names)
    return add_measures(rows, [measurer(picture, search(picture)) for picture in pictures])


def add_measures(rows: pd.DataFrame, measures: list[Measures]) -> pd.DataFrame:
    """Return rows with the measures of their images as columns."""
    columns = zip(*map(astuple, measures)) if measures else ([] for _ in NAMES)
    return rows.assign(**{name: list(column) for name, column in zip(NAMES, columns)})
