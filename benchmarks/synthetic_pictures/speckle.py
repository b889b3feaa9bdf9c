"""Synthetic picture sequences of a stretched test piece: speckle of ink whose deformation is known exactly.

The texture is a function T(X) of the material point X. A frame is T(x^-1(x)) at its pixel centres: the deformed
position is inverted in closed form and no picture is ever resampled, so the stretch of every frame is exact.
Blur, brightness drift and grey noise are added in the picture, where a camera adds them. All of it is synthetic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

LATTICE = 128  # cells after which the dots repeat; far more than a test piece holds
NEIGHBOURS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
STICK_SLIP_EVENTS = 7  # sudden slips over a test; the number only has to make steps that a smooth curve lacks


@dataclass(frozen=True)
class Speckle:
    """Ink dots, one per cell of a square lattice of the spacing given, as reflectance in (0, 1)."""

    seed: int
    spacing_px: float = 6.0

    def reflectance(self, X: np.ndarray, wear: float = 0.0) -> np.ndarray:
        """Return the reflectance (...) at material points X (..., 2) [px].

        T = exp(-sum_k a_k (1 - r_k^2 / R_k^2)_+^3): twice differentiable, so that pixels may sample it. wear in
        [0, 1] replaces the dots' ink a_k by that of another pattern, as paint that flakes off and is uncovered.
        """
        rng = np.random.default_rng(self.seed)
        place = rng.uniform(0, 1, (LATTICE, LATTICE, 2))
        radius = rng.uniform(0.45, 1.0, (LATTICE, LATTICE))  # of the spacing: a dot stays in its 3 x 3 cells
        ink = (1 - wear) * rng.gamma(1.0, 0.8, (LATTICE, LATTICE)) + wear * rng.gamma(
            1.0, 0.8, (LATTICE, LATTICE)
        )
        x, y = np.moveaxis(np.asarray(X, float) / self.spacing_px, -1, 0)
        column, row = np.floor(x).astype(int), np.floor(y).astype(int)
        absorbed = np.zeros(x.shape)
        for i, j in NEIGHBOURS:
            u, v = (column + i) % LATTICE, (row + j) % LATTICE
            dx, dy = x - (column + i) - place[u, v, 0], y - (row + j) - place[u, v, 1]
            absorbed += ink[u, v] * np.clip(1 - (dx * dx + dy * dy) / radius[u, v] ** 2, 0, None) ** 3
        return np.exp(-absorbed)


@dataclass(frozen=True)
class Camera:
    """What a camera does to a picture: blur, brightness that drifts over the sequence, grey noise."""

    blur_px: float = 0.7
    noise_grey: float = 2.0  # standard deviation
    gain_drift: float = 0.0  # change of exposure over the sequence, as a fraction
    offset_drift_grey: float = 0.0
    gradient_drift: float = 0.0  # change of exposure from left to right that grows over the sequence

    def picture(self, reflectance: np.ndarray, progress: float, rng: np.random.Generator) -> np.ndarray:
        """Return the grey picture (rows, columns) uint8 of a reflectance; progress runs 0..1 over the sequence."""
        grey = 20 + 190 * gaussian_filter(reflectance, self.blur_px)
        across = np.linspace(-0.5, 0.5, grey.shape[1])
        grey = grey * (1 + progress * (self.gain_drift + self.gradient_drift * across))
        grey = grey + progress * self.offset_drift_grey + self.noise_grey * rng.standard_normal(grey.shape)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class TensileFilm:
    """A strip between two clamps, the left one fixed, filmed with a camera at rest; loading along x.

    stretch (n,): the true lam1 of the piece. slip: share of the clamp's travel d that the right clamp loses, in
    sudden steps: material of reference length L0 + s then fills the length L0 + d, so lam1 = (L0 + d) / (L0 + s).
    test: `uniaxial` (lam2 = lam1^-1/2) or `pure_shear` (lam2 = 1). turn_rad: rigid rotation at the end of the film.
    contrast (n,) or None: 1 is the full texture, 0 none. wear: see Speckle, at the end of the film.
    """

    stretch: np.ndarray
    test: str = "uniaxial"
    slip: float = 0.0
    turn_rad: float = 0.0
    wear: float = 0.0
    contrast: np.ndarray | None = None
    length_px: float = 180.0  # of the reference, between the clamps
    width_px: float = 90.0
    shape: tuple[int, int] = (200, 660)  # rows, columns of the picture
    left_px: float = 50.0  # the fixed clamp's edge
    speckle: Speckle = Speckle(1)
    camera: Camera = Camera()
    seed: int = 0

    @property
    def principal_stretches(self) -> np.ndarray:
        """Return the true lam1, lam2 (n, 2) of every frame."""
        lam = np.asarray(self.stretch, float)
        return np.stack([lam, lam**-0.5 if self.test == "uniaxial" else np.ones_like(lam)], axis=-1)

    @property
    def slipped(self) -> np.ndarray:
        """Return the reference length / L0 (n,) that has come out of the clamp: steps up to slip x travel."""
        lam = np.asarray(self.stretch, float)
        smooth = self.slip * (lam - 1) / (1 - self.slip * lam)  # s = slip d, with d from lam1 above
        step = smooth.max() / STICK_SLIP_EVENTS
        return np.floor(smooth / step + 1e-9) * step if step > 0 else smooth

    @property
    def window(self) -> tuple[float, float, float, float]:
        """Return a window x, y, width, height [px] at the centre of the piece in the first frame."""
        width, height = 0.45 * self.length_px, 0.65 * self.width_px
        return (self.left_px + (self.length_px - width) / 2, (self.shape[0] - 1 - height) / 2, width, height)

    def reference_points(self, frame: int) -> np.ndarray:
        """Return the material point X (rows, columns, 2) [px, first frame] that each pixel of a frame shows."""
        lam1, lam2 = self.principal_stretches[frame]
        middle = (self.shape[0] - 1) / 2
        y, x = np.mgrid[: self.shape[0], : self.shape[1]].astype(float)
        x, y = x - self.left_px, y - middle
        turn = self.turn_rad * frame / max(len(self.stretch) - 1, 1)
        x, y = np.cos(turn) * x + np.sin(turn) * y, -np.sin(turn) * x + np.cos(turn) * y  # R^T x
        return np.stack([self.left_px + x / lam1, middle + y / lam2], axis=-1)

    def points(self, X: np.ndarray, frame: int) -> np.ndarray:
        """Return where material points X (..., 2) lie in a frame [px]; the inverse of reference_points."""
        lam1, lam2 = self.principal_stretches[frame]
        middle = (self.shape[0] - 1) / 2
        x, y = lam1 * (X[..., 0] - self.left_px), lam2 * (X[..., 1] - middle)
        turn = self.turn_rad * frame / max(len(self.stretch) - 1, 1)
        return np.stack(
            [
                self.left_px + np.cos(turn) * x - np.sin(turn) * y,
                middle + np.sin(turn) * x + np.cos(turn) * y,
            ],
            axis=-1,
        )

    def frame(self, number: int) -> np.ndarray:
        """Return one picture (rows, columns) uint8: background, speckled piece, plain clamps."""
        progress = number / max(len(self.stretch) - 1, 1)
        X = self.reference_points(number)
        contrast = 1.0 if self.contrast is None else float(self.contrast[number])
        along = X[..., 0] - self.left_px
        across = np.abs(X[..., 1] - (self.shape[0] - 1) / 2)
        clamp = (along < 0) | (along > self.length_px * (1 + self.slipped[number]))
        piece = ~clamp & (across < self.width_px / 2)
        reflectance = np.where(clamp, 0.35, 0.12)
        reflectance[piece] = 0.6 + contrast * (self.speckle.reflectance(X[piece], self.wear * progress) - 0.6)
        return self.camera.picture(reflectance, progress, np.random.default_rng([self.seed, number]))

    def frames(self) -> Iterator[np.ndarray]:
        """Return the pictures one after the other."""
        return (self.frame(number) for number in range(len(self.stretch)))
