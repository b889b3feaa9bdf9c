"""Local principal stretches at the centre of a test piece, tracked in a picture sequence by optical flow.

As in Sferrazza et al. 2019, sec. II-C: strains from the clamps' travel are wrong where the piece slips in them, so
the stretch is measured where the law needs it. The map x = phi(X) of a material window (first frame to current
frame) is kept as a polynomial about the window's centre. Each frame:

1. the frame is pulled back to the first one by the map predicted from the frames before it,
2. pyramidal Lucas-Kanade flow (Bouguet 2001) gives what is left at a grid of points, forward and backward,
3. a robust fit (Tukey's biweight) of all points corrects the map; both are repeated until the map rests,
4. the same against the oldest key frame that still looks similar, so that errors do not add up frame by frame.

F = d phi / d X at the centre, F = R U, and lam1, lam2 are the eigenvalues of U. Pictures are compared after local
normalisation (mean and standard deviation), so brightness and contrast may drift. A frame that cannot be trusted is
reported with its reason and has no stretch (NaN).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gelforge.materials.imaging.plane_stretch import leading_direction, principal_stretches_2d, robust_fit

# Errors and speed on drawn films: `python benchmarks/stretch_tracking.py`:
NORMALISATION_PATCHES = 0.2  # sigma of the local mean: the piece's edges must not reach the points near them
# Of the grid: more of them overlap and add little (benchmarks/stretch_tracking.py prints error and speed).
MOST_POINTS = 400
# Change of the map after which another pass would change a stretch by less than 1e-3: both stretches are then within 0.5 %
# up to a stretch of three (tests/materials/test_stretch_tracking.py).
AT_REST_PX = 0.02
WINDOW_OF_STRIP = (0.45, 0.65)  # share of the textured area, along and across: away from clamps and edges
WINDOW_OF_MEMBRANE = (0.33, 0.33)  # of its diameter: there a cubic map holds


class TrackingError(ValueError):
    """Pictures that cannot be tracked at all: what was found, the limit, the remedy."""


@dataclass(frozen=True)
class TrackingSettings:
    """When a point counts and when a frame is trusted. Pixels are those of the first frame."""

    patch_px: int = 21  # side of the patch that is compared: several dots of ink
    degree: int = (
        1  # of the map: 1 for a strip; 3 where the stretch varies over the window (inflated membrane)
    )
    forward_backward_px: float = 0.3  # a point must come back to where it started
    point_correlation: float = 0.5  # of a patch after alignment
    frame_correlation: float = 0.7  # median over the points, below which the texture counts as lost
    key_correlation: float = 0.9  # below which a new key frame is taken
    anchor_correlation: float = 0.8  # above which an old key frame still looks similar
    key_stretch: float = 1.2  # deformation since the last key frame after which a new one is taken
    seen_share: float = 0.4  # of the points of the window that must lie in the picture
    held_share: float = 0.6  # of these, that must move together: a background must not outvote the piece
    standard_error: float = 0.005  # of a stretch, above which the frame is reported as lost


@dataclass(frozen=True)
class LostFrame:
    """A frame without a stretch, and why."""

    frame: int
    reason: str


@dataclass(frozen=True)
class StretchTrack:
    """The tracked window of n frames; rows of lost frames are NaN (0 and -1 in the counts)."""

    stretch: np.ndarray  # (n, 2) lam1 along the load, lam2 across
    standard_error: np.ndarray  # (n, 2) of the fit within each frame; drift comes on top
    F: np.ndarray  # (n, 2, 2) deformation gradient at the centre; x right, y down
    centre_px: np.ndarray  # (n, 2) where the centre of the window lies
    correlation: np.ndarray  # (n,) median of the patches, against the key frame used
    points: np.ndarray  # (n,) points that hold
    anchor: np.ndarray  # (n,) key frame that the frame was compared with
    lost: tuple[LostFrame, ...]
    window_px: tuple[float, float, float, float]  # x, y, width, height in the first frame
    grid_of_frame_px: np.ndarray  # (n, m, 2) the points in every frame


def read_grey(path: str | Path) -> np.ndarray:
    """Return a picture (rows, columns) uint8 in grey; TrackingError where there is none."""
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if Path(path).is_file() else None
    if picture is None:
        raise TrackingError(f"{path}: no readable picture; PNG, TIFF, BMP and JPEG are read")
    return picture


def track_stretches(
    frames: Iterable[np.ndarray],
    window: Sequence[float] | None = None,
    settings: TrackingSettings | None = None,
) -> StretchTrack:
    """Return the principal stretches at the centre of a window of the test piece, frame by frame.

    frames: grey pictures (rows, columns) uint8 in order, the first undeformed. window: x, y, width, height [px] in
    the first frame, inside the piece; by default the middle of its textured area. lam1 is the principal stretch
    whose direction (in the first frame) is that of the largest |ln lam| over the sequence: the load's.
    """
    settings = settings or TrackingSettings()
    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise TrackingError("no frames; at least one picture is needed")
    x, y, width, height = (float(v) for v in (window if window is not None else textured_window(first)))
    tracker = _Tracker(first, (x, y, width, height), settings)
    for frame in frames:
        tracker.advance(frame)
    return tracker.result()


def flow_at_points(
    before: np.ndarray, after: np.ndarray, points: np.ndarray, patch_px: int = 21
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return displacement (n, 2), forward-backward error (n,) [px] and whether flow was found (n,) at points (n, 2).

    Pyramidal Lucas-Kanade (Bouguet 2001) on pictures (rows, columns) uint8; reaches about 1.5 patches.
    """
    arguments: dict[str, Any] = {
        "winSize": (patch_px, patch_px),
        "maxLevel": 3,
        "criteria": (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3),
        "minEigThreshold": 1e-4,
    }
    start = np.ascontiguousarray(points, np.float32)[:, None]
    there, tracked, _ = cv2.calcOpticalFlowPyrLK(before, after, start, np.empty_like(start), **arguments)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, np.empty_like(start), **arguments)
    error = np.linalg.norm((back - start)[:, 0], axis=1)
    tracked = (tracked[:, 0] == 1) & (found_back[:, 0] == 1)
    return (there - start)[:, 0].astype(float), error, tracked


def textured_window(
    frame: np.ndarray, share: tuple[float, float] = WINDOW_OF_STRIP
) -> tuple[float, float, float, float]:
    """Return x, y, width, height [px] of the middle of the largest textured area of a picture.

    Texture is local contrast above Otsu's threshold; share is that of its longer and its shorter side.
    """
    grey = cv2.GaussianBlur(frame.astype(np.float32), (0, 0), 1.0)
    contrast = cv2.absdiff(grey, cv2.GaussianBlur(grey, (0, 0), 4.0))
    contrast = cv2.GaussianBlur(contrast, (0, 0), 6.0)
    scaled = cv2.normalize(contrast, np.empty_like(contrast), 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    mask = cv2.threshold(scaled, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[1]
    number, _, areas, _ = cv2.connectedComponentsWithStats(mask)
    largest = 1 + int(np.argmax(areas[1:, cv2.CC_STAT_AREA])) if number > 1 else 0
    x, y, width, height = (float(v) for v in areas[largest, :4])
    along, across = share if width >= height else share[::-1]
    w, h = along * width, across * height
    return x + (width - 1 - w) / 2, y + (height - 1 - h) / 2, w, h


@dataclass(frozen=True)
class _KeyFrame:
    number: int
    picture: np.ndarray  # pulled back to the first frame and normalised
    F: np.ndarray  # (2, 2)


@dataclass(frozen=True)
class _Fit:
    """A map of the window and how well it holds."""

    coefficients: np.ndarray  # (terms, 2)
    standard_error: np.ndarray  # (2, 2) of F
    correlation: float
    points: int
    fault: str  # "" where the frame can be trusted


class _Tracker:
    """The state from frame to frame: the last maps, the key frames, what has been found."""

    def __init__(
        self, first: np.ndarray, window: tuple[float, float, float, float], settings: TrackingSettings
    ):
        self.settings, self.window = settings, window
        x0, y0, width, height = window
        patch, (rows, columns) = settings.patch_px, first.shape
        least = 1.5 * patch
        if not (width >= least and height >= least):
            raise TrackingError(
                f"window of {width:.0f} x {height:.0f} px; patches of {patch} px need {least:.0f} px at least:"
                " state a larger window, use a smaller patch, or film from closer"
            )
        if x0 < 0 or y0 < 0 or x0 + width > columns - 1 or y0 + height > rows - 1:
            raise TrackingError(
                f"window x {x0:.0f}..{x0 + width:.0f}, y {y0:.0f}..{y0 + height:.0f} px leaves the picture of"
                f" {columns} x {rows} px; state a window inside it"
            )
        self.centre = np.array([x0 + width / 2, y0 + height / 2])
        self.scale = max(width, height) / 2
        spacing = max(patch / 2, np.sqrt(width * height / MOST_POINTS))
        xs = np.linspace(x0, x0 + width, max(3, int(width / spacing) + 1))
        ys = np.linspace(y0, y0 + height, max(3, int(height / spacing) + 1))
        self.grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        self.overlap = max(
            1.0, patch**2 / ((xs[1] - xs[0]) * (ys[1] - ys[0]))
        )  # points that share their pixels
        # of picture around the window: what flow needs beyond the outermost points
        margin = round(1.5 * patch)
        self.corner = np.floor(np.array([x0, y0])).astype(int) - margin
        size = np.ceil(np.array([width, height])).astype(int) + 2 * margin
        pixels = np.stack(np.meshgrid(*(np.arange(n) for n in size)), axis=-1) + self.corner
        self.size = size
        self.pixel_basis = self._basis(pixels.reshape(-1, 2).astype(float))
        self.grid_basis = self._basis(self.grid)
        identity = np.zeros((self.grid_basis.shape[1], 2))
        identity[0], identity[1, 0], identity[2, 1] = self.centre, self.scale, self.scale
        picture, _ = self._pulled_back(first, identity)
        self.keys = [_KeyFrame(0, picture, np.eye(2))]
        self.oldest = 0  # of the key frames that still look similar
        self.maps: list[np.ndarray | None] = [identity]
        self.fits: list[_Fit] = [_Fit(identity, np.zeros((2, 2)), 1.0, len(self.grid), "")]
        self.anchors = [0]
        self.lost: list[LostFrame] = []

    def advance(self, frame: np.ndarray) -> None:
        """Track one more frame."""
        number = len(self.maps)
        newest = len(self.keys) - 1
        fit = self._aligned(frame, self.keys[newest], self._predicted())
        used = newest
        if fit.fault and newest > 0:  # the piece may have come back to an earlier state
            other = self._aligned(frame, self.keys[self.oldest], fit.coefficients)
            fit, used = (other, self.oldest) if not other.fault else (fit, used)
        if fit.fault:
            self.lost.append(LostFrame(number, fit.fault))
            self.maps.append(None)
            self.fits.append(fit)
            self.anchors.append(-1)
            return
        for index in range(self.oldest, used):
            older = self._aligned(frame, self.keys[index], fit.coefficients)
            if not older.fault and older.correlation >= self.settings.anchor_correlation:
                fit, used = older, index
                break
            self.oldest = index + 1
        self.maps.append(fit.coefficients)
        self.fits.append(fit)
        self.anchors.append(self.keys[used].number)
        F = self._gradient(fit.coefficients)
        since = np.linalg.svd(F @ np.linalg.inv(self.keys[-1].F), compute_uv=False)
        stretched = max(since.max(), 1 / since.min()) > self.settings.key_stretch
        if stretched or (fit.correlation < self.settings.key_correlation and self.anchors[-1] < number - 1):
            self.keys.append(_KeyFrame(number, self._pulled_back(frame, fit.coefficients)[0], F))

    def result(self) -> StretchTrack:
        """Return everything found so far."""
        good = np.array([m is not None for m in self.maps])
        blank = np.full_like(self.maps[0], np.nan)
        maps = np.stack([blank if m is None else m for m in self.maps])  # (n, terms, 2)
        F = np.swapaxes(maps[:, 1:3], 1, 2) / self.scale
        largest = np.full(len(F), -1.0)
        stretch, error = np.full((len(F), 2), np.nan), np.full((len(F), 2), np.nan)
        largest[good] = np.abs(np.log(np.linalg.svd(F[good], compute_uv=False))).max(-1)
        direction = leading_direction(F[int(np.argmax(largest))])
        stretch[good] = principal_stretches_2d(F[good], direction)
        errors_F = np.stack([f.standard_error for f in self.fits])
        for k, d in enumerate((direction, np.array([-direction[1], direction[0]]))):
            r = F @ d / np.linalg.norm(F @ d, axis=-1, keepdims=True)  # (n, 2): d lam = r . dF d
            error[good, k] = np.sqrt((r**2 * (errors_F**2 @ d**2)).sum(-1))[good]
        return StretchTrack(
            stretch,
            error,
            F,
            maps[:, 0],
            np.array([f.correlation if g else np.nan for f, g in zip(self.fits, good)]),
            np.array([f.points if g else 0 for f, g in zip(self.fits, good)]),
            np.array(self.anchors),
            tuple(self.lost),
            self.window,
            np.einsum("mt,ntk->nmk", self.grid_basis, maps),
        )

    def _basis(self, X: np.ndarray) -> np.ndarray:
        """Return the monomials (n, terms) of (X - centre) / scale up to the degree: 1, xi, eta, xi^2, ..."""
        xi, eta = ((X - self.centre) / self.scale).T
        return np.stack(
            [xi ** (d - k) * eta**k for d in range(self.settings.degree + 1) for k in range(d + 1)], axis=-1
        )

    def _gradient(self, coefficients: np.ndarray) -> np.ndarray:
        return coefficients[1:3].T / self.scale

    def _predicted(self) -> np.ndarray:
        """Return the map that the last two frames lead to, or the last one that is known."""
        if len(self.maps) > 1 and self.maps[-1] is not None and self.maps[-2] is not None:
            return 2 * self.maps[-1] - self.maps[-2]
        return next(m for m in reversed(self.maps) if m is not None)

    def _pulled_back(self, frame: np.ndarray, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the frame seen from the first one, normalised, and its pixels that lie in the picture, both uint8."""
        x = (self.pixel_basis @ coefficients).astype(np.float32).reshape(self.size[1], self.size[0], 2)
        pulled = cv2.remap(frame, x[..., 0], x[..., 1], cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
        rows, columns = frame.shape
        inside = (x >= 0).all(-1) & (x[..., 0] <= columns - 1) & (x[..., 1] <= rows - 1)
        return _normalised(pulled, NORMALISATION_PATCHES * self.settings.patch_px), inside.astype(np.uint8)

    def _aligned(self, frame: np.ndarray, key: _KeyFrame, coefficients: np.ndarray) -> _Fit:
        """Return the map of a frame by flow against a key frame, from a first guess."""
        s = self.settings
        points = self.grid - self.corner
        for _ in range(6):
            pulled, inside = self._pulled_back(frame, coefficients)
            d, error, tracked = flow_at_points(key.picture, pulled, points, s.patch_px)
            likeness = _local_correlation(key.picture, pulled, s.patch_px)
            row, column = np.rint(points[:, 1]).astype(int), np.rint(points[:, 0]).astype(int)
            seen = cv2.erode(inside, np.ones((s.patch_px, s.patch_px), np.uint8))[row, column] > 0
            likeness = likeness[row, column]
            came_back = tracked & (error < s.forward_backward_px)
            good = seen & came_back
            if good.sum() < 2 * self.grid_basis.shape[1]:
                return self._failed(coefficients, seen, came_back, likeness)
            target = self._basis(self.grid + d) @ coefficients
            fitted, covariance, weight = robust_fit(self.grid_basis[good], target[good])
            step = np.abs(self.grid_basis @ (fitted - coefficients)).max()
            coefficients = fitted
            if step < AT_REST_PX:
                break
        correlated = likeness > s.point_correlation
        held = np.zeros(len(good), bool)
        held[good] = weight > 0
        held &= correlated
        correlation = float(np.median(likeness[seen]))
        F_error = np.sqrt(covariance[1:3].T * self.overlap) / self.scale
        columns = np.linalg.norm(self._gradient(coefficients), axis=0)  # stretch of the x and of the y fibre
        relative = float((np.linalg.norm(F_error, axis=0) / columns).max())
        fault = ""
        if (
            seen.mean() < s.seen_share
            or correlation < s.frame_correlation
            or (correlated & good).sum() < s.held_share * seen.sum()
        ):
            return self._failed(coefficients, seen, came_back, likeness)
        if held.sum() < s.held_share * seen.sum():
            fault = (
                f"only {held.sum()} of {seen.sum()} points move together (limit {s.held_share:.0%}):"
                " the window shows more than the piece, or the deformation is not smooth"
            )
        elif relative > s.standard_error:
            fault = f"standard error of the stretch {relative:.2%} (limit {s.standard_error:.2%}): texture too weak"
        return _Fit(coefficients, F_error, correlation, int(held.sum()), fault)

    def _failed(self, coefficients, seen, came_back, likeness) -> _Fit:
        """Return a fit with the reason why a frame is lost."""
        s, n = self.settings, len(seen)
        correlation = float(np.median(likeness[seen])) if seen.any() else 0.0
        if seen.mean() < s.seen_share:
            fault = f"only {seen.sum()} of {n} points lie in the picture (limit {s.seen_share:.0%})"
        else:
            fault = (
                f"texture lost (or too large a step between frames): correlation {correlation:.2f} (limit"
                f" {s.frame_correlation:g}), {int((seen & came_back).sum())} of {n} points pass the forward-backward check"
            )
        return _Fit(coefficients, np.full((2, 2), np.nan), correlation, 0, fault)


def _normalised(picture: np.ndarray, sigma_px: float) -> np.ndarray:
    """Return a picture with local mean 128 and local standard deviation 40, uint8."""
    grey = picture.astype(np.float32)
    grey -= cv2.GaussianBlur(grey, (0, 0), sigma_px)
    deviation = np.sqrt(
        cv2.GaussianBlur(grey * grey, (0, 0), sigma_px) + 1.0
    )  # + 1: quantisation is no texture
    return np.clip(128 + 40 * grey / deviation, 0, 255).astype(np.uint8)


def _local_correlation(a: np.ndarray, b: np.ndarray, patch_px: int) -> np.ndarray:
    """Return the zero-mean normalised cross-correlation of the patches around every pixel."""
    a, b = a.astype(np.float32), b.astype(np.float32)

    def mean(values: np.ndarray) -> np.ndarray:
        return cv2.blur(values, (patch_px, patch_px))

    mean_a, mean_b = mean(a), mean(b)
    variance = (mean(a * a) - mean_a**2) * (mean(b * b) - mean_b**2)
    return (mean(a * b) - mean_a * mean_b) / np.sqrt(np.maximum(variance, 1.0))
