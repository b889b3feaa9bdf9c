"""Force distributions of images as they come, every step of the way timed."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Camera, Features
from gelforge.learning.deployment.onnx_model import open_for_prediction
from gelforge.learning.elasticity.inverse import State
from gelforge.recording.features import FlowFeatures
from gelforge.recording.imaging.flow import ImageError, crop, reduced
from gelforge.recording.imaging.frames import Frame
from gelforge.recording.optics.remap import Picture, remap_to

STEPS = ("read", "flow", "features", "network")


class Predictor:
    """A trained model in ONNX Runtime that turns features into force distributions.

    model_file: model.onnx, or model.pt, which takes some seconds more to open.
    """

    _state: State | None = None  # of inverse elasticity, of the frame before

    def __init__(self, model_file: str | Path, threads: int = 1):
        self.model = open_for_prediction(model_file, threads)

    @property
    def features(self) -> Features:
        """The feature settings that the model was trained with."""
        return Features.model_validate(self.model.settings["features"])

    def crop_for(self, frame: Frame, crop_px: list[int] | None) -> list[int] | None:
        """Return the part of frames like this one to use [px]: as asked, else as of the images that the model learnt from.

        Raises ImageError, naming the difference, where what is left has another size than those had: features in pixels
        mean another force then. A model that knows nothing of its images takes any.
        """
        size = [frame.image.shape[1], frame.image.shape[0]]
        views = self.model.settings.get("views") or {}
        known = []
        for session, view in views.items():
            learnt = view["crop_px"][2:] if view["crop_px"] else view["image_px"]
            crop = crop_px or (view["crop_px"] if size == view["image_px"] else None)
            if learnt is None or learnt == (crop[2:] if crop else size):
                return crop
            part = f" of which {view['crop_px']} was used" if view["crop_px"] else ""
            known.append(f"{' x '.join(map(str, view['image_px'] or learnt))} px{part} (session {session})")
        if not known:
            return crop_px
        stated = " x ".join(map(str, size)) + " px" + (f" of which {crop_px} is used" if crop_px else "")
        raise ImageError(
            f"{frame.name}: image of {stated}, but the model learnt from images of {', '.join(known)}; record with the same "
            "camera settings, or give --crop LEFT TOP WIDTH HEIGHT of that size"
        )

    def picture_for(
        self, frame: Frame, crop_px: list[int] | None, camera: Camera | None, plane_z_mm: float | None
    ) -> Picture:
        """Return what makes frames like this one those that the model learnt from: remapped to their view, or cropped, and
        reduced where those were.

        Raises ImageError, naming the difference, where they cannot be made so.
        """
        views, scale = self.model.settings.get("views") or {}, self.features.image_scale
        if remapper := remap_to(views, camera, plane_z_mm, crop_px, scale):
            return remapper
        part = self.crop_for(frame, crop_px)
        return lambda image: reduced(crop(image, part), scale)

    def __call__(self, feature: np.ndarray) -> np.ndarray:
        """Return the force distribution (B, 3) [N] on the sensor of one image's features (F,)."""
        return self.model.predict(feature)[0]

    def answer(self, feature: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the same, and how far its total is from inverse elasticity's: beyond 1 it is marked; NaN: not known."""
        force, disagreement = self.model.answer(feature)
        return force[0], float(disagreement[0])

    def follow(self, feature: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the same of the next frame of a camera, whose inverse elasticity goes on from the frame before."""
        force, disagreement, self._state = self.model.follow(feature, self._state)
        return force[0], float(disagreement[0])


@dataclass(frozen=True)
class Prediction:
    """The force distribution of one frame, and the seconds that each step took."""

    name: str
    time_s: float
    force_N: np.ndarray  # (B, 3)
    feature: np.ndarray  # (F,) of the image
    seconds: dict[str, float]  # by STEPS
    disagreement: float = float("nan")  # beyond 1 the total is not that of inverse elasticity

    def __repr__(self) -> str:
        total = ", ".join(f"{value:.4g}" for value in self.force_N.sum(axis=0))
        return (
            f"Prediction {self.name} at {self.time_s:.4g} s: ({total}) N in total, {len(self.force_N)} bins,"
            f" disagreement {self.disagreement:.3g}"
        )


@dataclass
class Timing:
    """Seconds of every frame and step, without the first frames, which pay for what is set up once."""

    warm_up: int = 0  # frames that are not counted
    seconds: dict[str, list[float]] = field(default_factory=lambda: {step: [] for step in STEPS})
    seen: int = 0  # frames, with those not counted

    def add(self, prediction: Prediction) -> None:
        self.seen += 1
        if self.seen > self.warm_up:
            for step in STEPS:
                self.seconds[step].append(prediction.seconds[step])

    def table(self) -> pd.DataFrame:
        """Return p50, p95, p99 [ms] of each step and of the whole, and the frames per second that p50 and p99 allow.

        Without a row where no frame is counted.
        """
        columns = ["step", "frames", "p50_ms", "p95_ms", "p99_ms", "fps_at_p50", "fps_at_p99"]
        total = np.sum([self.seconds[step] for step in STEPS], axis=0)
        rows = []
        for name, values in (*self.seconds.items(), ("whole", total)) if len(total) else ():
            p50, p95, p99 = np.percentile(values, [50, 95, 99])
            rows.append((name, len(values), 1e3 * p50, 1e3 * p95, 1e3 * p99, 1 / p50, 1 / p99))
        return pd.DataFrame(rows, columns=columns)


def predict_frames(
    predictor: Predictor,
    frames: Iterable[Frame],
    reference: np.ndarray | None = None,
    crop_px: list[int] | None = None,
    camera: Camera | None = None,
    plane_z_mm: float | None = None,
) -> Iterator[Prediction]:
    """Yield the prediction of each frame.

    Every frame is read, reduced and predicted anew. The first one pays for what is set up once (search buffers, first call
    of the network).

    Parameters
    ----------
    predictor : Predictor
        A loaded model.
    frames : iterable of Frame
        As `frames` yields them.
    reference : numpy.ndarray, optional
        (H, W) uint8 zero-force frame; None for the first frame.
    crop_px : list of int, optional
        Left, top, width and height [px].
    camera : Camera, optional
        Frames are remapped to the model's view where it differs (`remap_to`).
    plane_z_mm : float, optional
        Height of the plane [mm, sensor frame] that both views show at one scale.

    Yields
    ------
    Prediction
        Forces of the bins (B, 3) [N], features, and seconds by step.

    Raises
    ------
    ImageError
        For a frame of another size than the reference, or than the images that the model learnt from.
    """
    settings = predictor.features
    extract, source, first = None, iter(frames), True
    while True:
        start = time.perf_counter()
        frame = next(source, None)
        if frame is None:
            return
        if first:
            picture, first = predictor.picture_for(frame, crop_px, camera, plane_z_mm), False
        image = picture(frame.image)
        if extract is None:
            extract = FlowFeatures(image if reference is None else picture(reference), settings)
        marks = [start, time.perf_counter()]
        flow = extract.flow(image)
        marks.append(time.perf_counter())
        feature = extract.of_flow(flow)
        marks.append(time.perf_counter())
        force, disagreement = predictor.answer(feature)
        marks.append(time.perf_counter())
        seconds = dict(zip(STEPS, np.diff(marks).tolist()))
        yield Prediction(frame.name, frame.time_s, force, feature, seconds, disagreement)
