"""Parts of a live run that need no trained model: moving patterns, and a model that reads the flow's mean."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.deployment.predictor import Predictor
from gelforge.learning.models.reliability import Intervals
from gelforge.live.compute import LiveForce
from gelforge.live.messages import about
from gelforge.live.record import LIMITS, Limits
from gelforge.live.run import run_live
from gelforge.live.server import Server
from gelforge.recording.imaging.frames import Frame

SETTINGS = {
    "study": "artificial",
    "bins": {"nx": 4, "ny": 5},
    "sensor_width_mm": [32.0, 40.0],
    "features": {"regions": 4, "flow_preset": "ultrafast", "moved_px": 0.05},
    "synthetic": True,
    "views": {"day1": {"image_px": [160, 120], "crop_px": None, "camera": None}},
}


def pattern(shift: float, size=(120, 160)) -> np.ndarray:
    """Return a smooth random image (H, W) uint8 shifted to the right [px]."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[: size[0], : size[1]]
    waves = rng.uniform(0.1, 0.5, (40, 2)) * rng.choice([-1, 1], (40, 2))
    grey = sum(np.sin(k[0] * (u - shift) + k[1] * v + p) for k, p in zip(waves, rng.uniform(0, 6, 40)))
    return (128 + 12 * grey).clip(0, 255).astype(np.uint8)


STILL, MOVED = pattern(0), pattern(2)


@dataclass
class MeanModel:
    """Gives bin 6 a vertical force of -0.1 N for each pixel that the mean magnitude is above 0.2 px."""

    settings: dict
    intervals: Intervals | None
    model_sha256: str = "0" * 64

    def predict(self, feature: np.ndarray) -> np.ndarray:
        feature = np.atleast_2d(feature)
        if not np.isfinite(feature).all():
            raise ModelError("the predicted force is not finite, 1 features are not; check the images")
        force = np.zeros((len(feature), 20, 3))
        force[:, 6, 2] = -0.1 * np.maximum(feature[:, :16].mean(axis=1) - 0.2, 0)
        return force

    def follow(self, feature: np.ndarray, state=None) -> tuple[np.ndarray, np.ndarray, None]:
        """The total disagrees where the mean magnitude is beyond 5 px."""
        return self.predict(feature), np.atleast_2d(feature)[:, :16].mean(axis=1) / 5, state


def force_of(reference: np.ndarray | None = STILL, scale: float = 1.0) -> LiveForce:
    predictor = Predictor.__new__(Predictor)
    of_bins = np.array([0.01]), np.array([[0.0] * 3, [0.003] * 3]), np.zeros((2, 3))
    bars = Intervals(*of_bins, np.empty(0), np.full((1, 3), 0.02), np.zeros((1, 3)))
    features = SETTINGS["features"] | {"image_scale": scale}
    predictor.model = MeanModel(SETTINGS | {"features": features}, bars)
    return LiveForce(predictor, reference, None)


class Source:
    """Frames that a test hands over one by one; hand(None) ends the source, an exception breaks it."""

    def __init__(self):
        self.given: list = []
        self.there = threading.Semaphore(0)

    def hand(self, *images) -> None:
        for image in images:
            self.given.append(image)
            self.there.release()

    def __call__(self):
        number = 0
        while True:
            self.there.acquire()
            image = self.given[number]
            if image is None:
                return
            if isinstance(image, Exception):
                raise image
            yield Frame(f"camera#{number}", 0.0, image)
            number += 1


class LiveRun:
    """A run in a thread with its server on a free port of the loopback; a context manager."""

    def __init__(self, folder: Path | None = None, fails: bool = False, limits: Limits = LIMITS):
        self.source, self.said, self.error, self.fails = Source(), [], None, fails
        self.force = force_of()
        self.server = Server("127.0.0.1", 0, about(SETTINGS, "0" * 64, "a test"))
        self.folder, self.limits = folder, limits
        self.thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        try:
            run_live(self.source, self.force, self.server, self.folder, self.said.append, self.limits)
        except Exception as error:
            self.error = error

    def __enter__(self):
        self.server.__enter__()
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.source.hand(None)
        self.thread.join(timeout=5)
        self.server.__exit__()
        assert not self.thread.is_alive()
        assert self.fails or self.error is None

    @property
    def url(self) -> str:
        return self.server.url.replace("http", "ws", 1) + "stream"
