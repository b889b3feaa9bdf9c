"""Synthetic top and side views of an inflated circular membrane whose apex stretch and radius are known exactly.

The membrane is a spherical cap on its clamp, stretched evenly along its meridians: theta_e is the angle of the clamp,
r = a / sin(theta_e) and lam = theta_e / sin(theta_e) at the apex, along both directions. All of it is synthetic.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from synthetic_pictures.speckle import Camera, Speckle


@dataclass(frozen=True)
class MembraneFilm:
    """Frames of an inflation; stretch (n,) at the apex, above 1 but for the first frame of the top view.

    camera_distance_mm: of the top camera's pupil from the clamp, None for a telecentric lens; the apex comes closer to
    it by its height, and looks stretched by D / (D - height) more than it is. The side camera is telecentric.
    """

    stretch: np.ndarray
    clamp_radius_mm: float = 15.0
    mm_per_px: float = 0.1
    camera_distance_mm: float | None = None
    shape: tuple[int, int] = (360, 400)
    speckle: Speckle = field(default_factory=lambda: Speckle(2))
    camera: Camera = field(default_factory=Camera)
    seed: int = 0

    @property
    def clamp_angle(self) -> np.ndarray:
        """Return theta_e (n,) [rad] of theta / sin(theta) = stretch."""
        theta = np.linspace(0, np.pi - 0.05, 200_001)
        return np.interp(self.stretch, np.concatenate([[1.0], theta[1:] / np.sin(theta[1:])]), theta)

    @property
    def radius_mm(self) -> np.ndarray:
        """Return the radius (n,) [mm] of the cap; infinite where it is flat."""
        with np.errstate(divide="ignore"):
            return self.clamp_radius_mm / np.sin(self.clamp_angle)

    @property
    def height_mm(self) -> np.ndarray:
        """Return the height (n,) [mm] of the apex above the clamp."""
        return self.clamp_radius_mm * np.tan(self.clamp_angle / 2)

    @property
    def apparent_stretch(self) -> np.ndarray:
        """Return the stretch (n,) of the apex in the top view: magnified where the camera is near."""
        if self.camera_distance_mm is None:
            return np.asarray(self.stretch, float)
        return self.stretch * self.camera_distance_mm / (self.camera_distance_mm - self.height_mm)

    def top_view(self, number: int) -> np.ndarray:
        """Return a picture (rows, columns) uint8 from above, the apex in its middle."""
        rows, columns = self.shape
        y, x = np.mgrid[:rows, :columns] - np.array([(rows - 1) / 2, (columns - 1) / 2])[:, None, None]
        seen = np.hypot(x, y) * self.mm_per_px  # distance from the axis in the picture [mm]
        lam, angle = float(self.stretch[number]), float(self.clamp_angle[number])
        theta = np.linspace(0, min(angle, np.pi / 2), 20_001)
        if angle > 0:
            r = self.radius_mm[number]
            off_axis, z, material = r * np.sin(theta), r * (np.cos(theta) - np.cos(angle)), r * theta / lam
        else:
            off_axis = material = np.linspace(0, self.clamp_radius_mm, 20_001)
            z = np.zeros_like(off_axis)
        if self.camera_distance_mm is not None:
            off_axis = off_axis * self.camera_distance_mm / (self.camera_distance_mm - z)
        limb = int(np.argmax(off_axis))  # what lies behind it is hidden
        R = np.interp(seen, off_axis[: limb + 1], material[: limb + 1], right=np.nan)
        reflectance = np.full(self.shape, 0.3)
        on = np.isfinite(R)
        scale = R[on] / np.maximum(seen[on], 1e-9)
        X = np.stack([x[on] * scale, y[on] * scale], axis=-1) + 200.0
        reflectance[on] = self.speckle.reflectance(X)
        progress = number / max(len(self.stretch) - 1, 1)
        return self.camera.picture(reflectance, progress, np.random.default_rng([self.seed, number, 0]))

    def side_view(self, number: int) -> np.ndarray:
        """Return a picture (rows, columns) uint8 against a bright screen: dark cap on a dark clamp."""
        height, angle = float(self.height_mm[number]) / self.mm_per_px, float(self.clamp_angle[number])
        r = float(self.radius_mm[number]) / self.mm_per_px if angle > 0 else 1e6  # a flat membrane
        half = self.clamp_radius_mm / self.mm_per_px
        return silhouette(
            self.shape, r, r, height, half, self.camera, np.random.default_rng([self.seed, number, 1])
        )


def silhouette(
    shape: tuple[int, int],
    half_axis_x_px: float,
    half_axis_y_px: float,
    height_px: float,
    clamp_radius_px: float,
    camera: Camera,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return a side view (rows, columns) uint8 of an ellipse standing height_px above a clamp; apex radius a^2 / b.

    A pixel's share of dark is that of a straight edge at its distance from the outline (exact to the outline's
    curvature over one pixel). The clamp's plate is 30 px high and 10 % wider than the membrane.
    """
    rows, columns = shape
    base = rows - 30.3  # the clamp's upper face lies between pixels, as it would
    y, x = np.mgrid[:rows, :columns].astype(float)
    x = x - ((columns - 1) / 2 + 0.37)
    up = base - y
    centre = height_px - half_axis_y_px
    f = (x / half_axis_x_px) ** 2 + ((up - centre) / half_axis_y_px) ** 2 - 1
    slope = 2 * np.hypot(x / half_axis_x_px**2, (up - centre) / half_axis_y_px**2)
    cap = np.clip(0.5 - f / np.maximum(slope, 1e-12), 0, 1) * (up > -2)  # the rest of it is behind the plate
    plate = np.clip(0.5 - up, 0, 1) * (np.abs(x) < 1.1 * clamp_radius_px)
    return camera.picture(1 - 0.85 * np.maximum(cap, plate), 0.0, rng)
