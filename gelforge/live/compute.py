"""From one frame to forces, their intervals and the centre of pressure; and whether the camera is still as it was."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from gelforge.config import Camera
from gelforge.learning.deployment.predictor import Predictor
from gelforge.learning.models.contacts import Contact, contacts
from gelforge.learning.models.reliability import centre_of_pressure
from gelforge.live.capture import Shot
from gelforge.recording.features import FlowFeatures
from gelforge.recording.imaging.flow import crop, reduced
from gelforge.recording.imaging.frames import Frame
from gelforge.recording.optics.remap import remap_to

STEPS = ("crop", "flow", "features", "network", "intervals", "camera check")
# Of the reference's mean grey level; grey levels. Measured on the benchmark study: indentations change its mean grey level
# by 0.5 at most, an exposure of a fifth more or less by a fifth, which warns (tests/learning/test_live.py).
GREY_SHARE, GREY_LEAST = 0.1, 5.0
# Of the reference's sharpness. Measured on the benchmark study: indentations change it by 2 % at most, a blur of one pixel
# takes 36 % away; 0.6 of the contrast warns (tests/learning/test_live.py).
SHARP_SHARE = 0.25
SPARSE = 4  # every so many pixels are looked at


@dataclass(frozen=True)
class Reading:
    """What one frame says; force_N is None where it says nothing, and problem says why."""

    number: int
    t_capture: float  # s since 1970
    force_N: np.ndarray | None = None  # (B, 3)
    half_N: np.ndarray | None = None  # (B, 3) half widths of 90 % intervals of the true force
    total_N: np.ndarray | None = None  # (3,)
    total_half_N: np.ndarray | None = None  # (3,)
    cop_mm: np.ndarray | None = None  # (2,)
    contacts: tuple[Contact, ...] = ()
    problem: str = ""
    warnings: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)  # by STEPS
    zero: int = 0  # how often the reference was taken anew

    @property
    def touched(self) -> bool:
        return self.force_N is not None and bool(self.force_N.any())


@dataclass(frozen=True)
class Look:
    """What shows that light, exposure or focus have changed."""

    grey: float  # mean [grey levels]
    sharp: float  # mean step between neighbouring pixels over the mean [-]

    @classmethod
    def of(cls, image: np.ndarray) -> Look:
        """Return the look of an image (H, W), from every fourth row and column."""
        rows = image[::SPARSE]
        left, right = rows[:, :-1:SPARSE].astype(np.int16), rows[:, 1::SPARSE].astype(np.int16)
        grey = float(left.mean())
        return cls(grey, float(np.abs(right - left).mean()) / max(grey, 1.0))

    def warnings(self, image: np.ndarray) -> tuple[str, ...]:
        """Return in words how an image differs from this look, the reference's; empty where it does not."""
        now, words = Look.of(image), []
        limit = max(GREY_SHARE * self.grey, GREY_LEAST)
        if abs(now.grey - self.grey) > limit:
            words.append(
                f"mean grey level {now.grey:.0f}, of the reference {self.grey:.0f}, limit +-{limit:.0f}: light or exposure "
                "has changed; fix it, then zero again"
            )
        ratio = now.sharp / max(self.sharp, 1e-6)
        if abs(ratio - 1) > SHARP_SHARE:
            words.append(
                f"sharpness {ratio:.2f} of the reference's, limit 1 +- {SHARP_SHARE:g}: focus has changed or the lens is "
                "dirty; fix it, then zero again"
            )
        return tuple(words)


class LiveForce:
    """Turns frames into readings against a reference frame; not shared between threads."""

    def __init__(
        self,
        predictor: Predictor,
        reference: np.ndarray | None,
        crop_px: list[int] | None,
        camera: Camera | None = None,
        plane_z_mm: float | None = None,
    ):
        self.predictor, self.crop_px = predictor, crop_px
        self.settings, self.features = predictor.model.settings, predictor.features
        self.scale = self.features.image_scale
        self.remapped = remap_to(self.settings.get("views") or {}, camera, plane_z_mm, crop_px, self.scale)
        bins = self.settings["bins"]
        self.grid = bins["nx"], bins["ny"], np.array(self.settings["sensor_width_mm"])
        self.zero = -1
        self.extract: FlowFeatures | None = None  # from the frame of zero force
        self.look: Look | None = None  # of that frame
        if reference is not None:
            self.take_reference(Frame("reference", 0.0, reference))

    def take_reference(self, frame: Frame) -> None:
        """Take a frame as the one of zero force. Raises ImageError for one that the model cannot use."""
        image = self.image_of(frame)
        extract = FlowFeatures(image, self.features)
        # so that no frame pays for what is set up once; says too what cannot be used
        self.predictor(extract(image))
        self.extract, self.look = extract, Look.of(image)
        self.zero += 1

    def image_of(self, frame: Frame) -> np.ndarray:
        """Return the part (H, W) uint8 of a frame that the model reads, or the frame as the model's camera would see it.

        Reduced where the images that the model learnt from were.
        """
        if self.remapped:
            return self.remapped(frame.image)
        return reduced(crop(frame.image, self.predictor.crop_for(frame, self.crop_px)), self.scale)

    def __call__(self, shot: Shot) -> Reading:
        """Return the reading of a frame; one that cannot be used gives a reading with its problem.

        The first frame becomes the reference where there is none.
        """
        try:
            if self.extract is None:
                self.take_reference(shot.frame)
            return self._measured(shot)
        except ValueError as error:
            if not type(error).__module__.startswith("gelforge."):
                raise
            return Reading(shot.number, shot.t_capture, problem=str(error), zero=max(self.zero, 0))

    def _measured(self, shot: Shot) -> Reading:
        marks = [time.perf_counter()]

        def mark(value):
            marks.append(time.perf_counter())
            return value

        assert (
            self.extract is not None and self.look is not None
        )  # __call__ has taken the frame of zero force
        model = self.predictor.model
        image = mark(self.image_of(shot.frame))
        flow = mark(self.extract.flow(image))
        feature = mark(self.extract.of_flow(flow))
        force, disagreement = mark(self.predictor.follow(feature))
        batch, half, total_half = force[None], None, None
        if bars := model.intervals:
            half, total_half = bars.of_true_bins(batch)[0], bars.of_true_totals(batch)[0]
        place = centre_of_pressure(batch, *self.grid)[0] if force[:, 2].any() else np.array([np.nan, np.nan])
        apart = tuple(mark(contacts(force, *self.grid)))
        warnings = mark(self.look.warnings(image))
        if disagreement > 1:
            warning = (
                f"the total force is not that of inverse elasticity ({disagreement:.1f} times the usual difference): do not "
                "rely on it"
            )
            warnings = (*warnings, warning)
        return Reading(
            shot.number,
            shot.t_capture,
            force,
            half,
            force.sum(axis=0),
            total_half,
            place if np.isfinite(place).all() else None,
            apart,
            warnings=warnings,
            seconds=dict(zip(STEPS, np.diff(marks).tolist())),
            zero=self.zero,
        )
