"""How long one frame takes on the live path, step by step, on one core.

usage: python benchmarks/live_latency.py [--sizes 640x480] [--crop 400x400] [--cases 1:fine 0.8:fine 0.5:full]
       [--frames 500] [--rounds 5] [--session FOLDER] [--model FILE] [--steps]

Prints a Markdown table [ms], a row per size of frames and case image_scale:flow_preset: p50 of each step, p50, p95 and p99
of the whole, and of its CPU time, which other work on the machine inflates less than the clock's. Each row is of the round
with the least p50 of the whole, the one that other work disturbed least; rounds are taken in turn. --steps adds a table of
p50, p95 and p99 of each step. --crop takes the middle of frames, as crop_px does.

The frames are drawn speckle that moves by some pixels, in colour as a camera gives them; with --session they are of a
recorded session, in the middle of an empty frame (speckle has texture everywhere, so that no flow is filled in). The network
is an untrained U-Net of the usual settings (40 x 40 regions, 20 x 20 bins) in ONNX Runtime, as fast as a trained one, unless
a model is given, which takes images of its own size only, at its own scale. Reading from the camera is not in the table: a
thread does it meanwhile (decoding a JPEG of 640 x 480 px: 1 ms).
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
import time  # noqa: E402
from itertools import islice  # noqa: E402
from pathlib import Path  # noqa: E402

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from gelforge.config import Learning  # noqa: E402
from gelforge.learning.basis.network import Grids  # noqa: E402
from gelforge.learning.basis.scaling import Scaling  # noqa: E402
from gelforge.learning.deployment.onnx_export import onnx_bytes  # noqa: E402
from gelforge.learning.deployment.onnx_model import OnnxModel, model_of, open_for_prediction  # noqa: E402
from gelforge.learning.deployment.predictor import Predictor  # noqa: E402
from gelforge.learning.elasticity.check import Check  # noqa: E402
from gelforge.learning.elasticity.inverse import Inverse  # noqa: E402
from gelforge.learning.models.model_file import Model  # noqa: E402
from gelforge.learning.models.reliability import Intervals, Zero  # noqa: E402
from gelforge.learning.networks import make_network  # noqa: E402
from gelforge.live.capture import Shot  # noqa: E402
from gelforge.live.compute import LiveForce  # noqa: E402
from gelforge.live.messages import of_reading, text_of  # noqa: E402
from gelforge.recording.imaging.flow import grey, read_grey  # noqa: E402
from gelforge.recording.imaging.frames import Frame, frames  # noqa: E402

WARM_UP = 20  # frames that are not counted
IMAGES, IMAGES_STEP = 30, 7  # of a session: so many, one of every so many
REGIONS, BINS = 40, 20


def untrained(scale: float, preset: str) -> OnnxModel:
    """Return a U-Net of the usual size with seeded weights, as the live path runs it on images reduced to a scale."""
    learning = Learning()
    network = make_network(learning, Grids(REGIONS, BINS, BINS), seed=0)
    zeros = np.zeros((BINS**2, 3), np.float32)
    scales = np.ones(2, np.float32), np.ones(3, np.float32)
    scaling = Scaling("vector", "mirror_y", np.zeros(2 * REGIONS**2, np.float32), scales[0], zeros, scales[1])
    settings = {
        "learning": learning.model_dump(mode="json"),
        "bins": {"nx": BINS, "ny": BINS},
        "features": {"regions": REGIONS, "flow_preset": preset, "moved_px": 0.05, "image_scale": scale},
        "sensor_width_mm": [32.0, 32.0],
    }
    of_bins = np.linspace(0.01, 0.1, 7), np.ones((8, 3)), np.ones((8, 3))
    of_totals = np.linspace(0.1, 1, 5), np.ones((6, 3)), np.ones((6, 3))
    # worked out for each frame, too; 234 singular values are the benchmark study's
    rng = np.random.default_rng(0)
    parts = (np.linalg.qr(rng.normal(size=(n, 234)))[0] for n in (2 * REGIONS**2, 3 * BINS**2))
    left, right = (part.astype(np.float32) for part in parts)
    inverse = Inverse(left, np.geomspace(1600, 5, 234).astype(np.float32), right, 0.45)
    intervals, check = Intervals(*of_bins, *of_totals), Check(np.ones(3), 0.2)
    model = Model(network, scaling, settings, Zero(), intervals, inverse, check)
    return model_of(onnx_bytes(model, ""), "untrained")


def speckle(width: int, height: int, shift: float) -> np.ndarray:
    """Return a frame (height, width, 3) uint8 of blurred noise, its middle moved to the right by a shift [px]."""
    noise = np.random.default_rng(0).normal(128, 60, (height, width)).astype(np.float32)
    image = cv2.GaussianBlur(noise, (0, 0), 1.5)
    image = (128 + 5 * (image - 128)).clip(0, 255).astype(np.uint8)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    bump = np.exp(-((u - width / 2) ** 2 + (v - height / 2) ** 2) / (height / 5) ** 2)
    return cv2.cvtColor(
        cv2.remap(image, u - np.float32(shift) * bump, v, cv2.INTER_LINEAR), cv2.COLOR_GRAY2BGR
    )


def recorded(session: Path, width: int, height: int) -> list[np.ndarray]:
    """Return the reference and some images of a session in the middle of empty frames (height, width, 3) uint8."""
    chosen = islice(frames(session / "images"), 0, IMAGES * IMAGES_STEP, IMAGES_STEP)
    found = []
    for image in (read_grey(session / "reference.png"), *(shown.image for shown in chosen)):
        frame = np.zeros((height, width), np.uint8)
        top, left = (height - image.shape[0]) // 2, (width - image.shape[1]) // 2
        frame[top : top + image.shape[0], left : left + image.shape[1]] = image
        found.append(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    return found


def timed(model: OnnxModel, images: list[np.ndarray], crop_px: list[int] | None, count: int) -> pd.DataFrame:
    """Return the time [ms] of each step and of the whole, and its CPU time, a row per frame; the first is the reference."""
    predictor = Predictor.__new__(Predictor)
    predictor.model = model
    force = LiveForce(predictor, grey(images[0]), crop_px)
    rows = []
    for number in range(WARM_UP + count):
        start, busy = time.perf_counter(), time.thread_time()
        shot = Shot(number, time.time(), Frame("frame", 0.0, grey(images[number % len(images)])))
        turned = time.perf_counter()
        reading = force(shot)
        computed = time.perf_counter()
        text_of(of_reading(reading, {}, field=False))
        sent = time.perf_counter()
        if reading.problem:
            raise SystemExit(reading.problem)
        rows.append(
            {
                "grey": turned - start,
                **reading.seconds,
                "message": sent - computed,
                "whole": sent - start,
                "CPU": time.thread_time() - busy,
            }
        )
    return 1e3 * pd.DataFrame(rows[WARM_UP:])


def summary(table: pd.DataFrame) -> pd.Series:
    """Return p50 of each column, p95 and p99 of the whole and of its CPU time."""
    high = {f"{name} p{p}": table[name].quantile(p / 100) for name in ("whole", "CPU") for p in (95, 99)}
    return pd.Series({**table.median(), **high})[
        [*table.columns[:-1], "whole p95", "whole p99", "CPU", "CPU p95", "CPU p99"]
    ]


def size_of(text: str) -> tuple[int, int]:
    width, height = text.split("x")
    return int(width), int(height)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", nargs="+", type=size_of, default=[(640, 480)], help="of frames")
    parser.add_argument(
        "--crop", type=size_of, help="the middle of frames that is used; all of them if not given"
    )
    parser.add_argument("--cases", nargs="+", default=["1:fine", "0.8:fine", "0.6:fine", "0.5:full"])
    parser.add_argument("--frames", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--session", type=Path, help="a recorded session of grey images; drawn speckle if not given"
    )
    parser.add_argument("--model", type=Path, help="model.pt or model.onnx; an untrained one if not given")
    parser.add_argument("--steps", action="store_true", help="print p50, p95 and p99 of each step too")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    if arguments.model:
        models = {"its own": open_for_prediction(arguments.model)}
    else:
        asked = {case: case.split(":") for case in arguments.cases}
        models = {case: untrained(float(scale), preset) for case, (scale, preset) in asked.items()}
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    best: dict[str, pd.DataFrame] = {}
    for _ in range(arguments.rounds):
        for width, height in arguments.sizes:
            if arguments.session:
                images = recorded(arguments.session, width, height)
            else:
                images = [speckle(width, height, shift) for shift in np.linspace(0, 4, 8)]
            crop_px = None
            if arguments.crop:
                crop_px = [
                    (width - arguments.crop[0]) // 2,
                    (height - arguments.crop[1]) // 2,
                    *arguments.crop,
                ]
            for case, model in models.items():
                found = timed(model, images, crop_px, arguments.frames)
                name = f"{width} x {height}, {case}"
                if name not in best or found["whole"].median() < best[name]["whole"].median():
                    best[name] = found
    print(
        f"load after: {os.getloadavg()[0]:.1f}; the best of {arguments.rounds} rounds of {arguments.frames} frames\n"
    )
    print(pd.DataFrame({name: summary(table) for name, table in best.items()}).T.to_markdown(floatfmt=".2f"))
    for name, table in best.items() if arguments.steps else ():
        print(f"\n{name}\n")
        quantiles = table.quantile([0.5, 0.95, 0.99]).rename({0.5: "p50", 0.95: "p95", 0.99: "p99"})
        print(quantiles.to_markdown(floatfmt=".2f"))


if __name__ == "__main__":
    main()
