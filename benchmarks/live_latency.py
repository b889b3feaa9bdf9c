"""How long one frame takes on the live path, step by step and by image size, on one core.

usage: python benchmarks/live_latency.py [--frames 500] [--rounds 5] [--sizes 640x480 400x400 320x320 240x240] [--model FILE]

Prints a Markdown table [ms]: medians over rounds, in turn, of p50 of each step, of p50 and p99 of the whole, and of its CPU
time, which other work on the machine inflates less than the clock's. The frames are drawn speckle that moves by some pixels,
in colour as a camera gives them. The network is an untrained U-Net of the usual settings (40 x 40 regions, 20 x 20 bins) in
ONNX Runtime, as fast as a trained one, unless a model is given, which takes frames of its own size only. Reading from the
camera is not in the table: a thread does it meanwhile.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from gelforge.config import Learning  # noqa: E402
from gelforge.learning.model_file import Model  # noqa: E402
from gelforge.learning.networks import Grids, make_network  # noqa: E402
from gelforge.learning.onnx_export import onnx_bytes, open_for_prediction  # noqa: E402
from gelforge.learning.onnx_model import OnnxModel, model_of  # noqa: E402
from gelforge.learning.predictor import Predictor  # noqa: E402
from gelforge.learning.reliability import Intervals, Zero  # noqa: E402
from gelforge.learning.scaling import Scaling  # noqa: E402
from gelforge.live.capture import Shot  # noqa: E402
from gelforge.live.compute import STEPS, LiveForce  # noqa: E402
from gelforge.live.messages import of_reading, text_of  # noqa: E402
from gelforge.recording.flow import grey  # noqa: E402
from gelforge.recording.frames import Frame  # noqa: E402

WARM_UP = 20  # frames that are not counted
REGIONS, BINS = 40, 20


def untrained() -> OnnxModel:
    """Return a U-Net of the usual size with seeded weights, as the live path runs it."""
    learning = Learning()
    network = make_network(learning, Grids(REGIONS, BINS, BINS), seed=0)
    zeros = np.zeros((BINS**2, 3), np.float32)
    scales = np.ones(2, np.float32), np.ones(3, np.float32)
    scaling = Scaling("vector", "mirror_y", np.zeros(2 * REGIONS**2, np.float32), scales[0], zeros, scales[1])
    settings = {
        "bins": {"nx": BINS, "ny": BINS},
        "features": {"regions": REGIONS, "flow_preset": "fine", "moved_px": 0.05},
        "sensor_width_mm": [32.0, 32.0],
    }
    intervals = Intervals(np.linspace(0.01, 0.1, 7), np.ones((8, 3)), np.linspace(0.1, 1, 5), np.ones((6, 3)))
    return model_of(onnx_bytes(Model(network, scaling, settings, Zero(), intervals), ""), "untrained")


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


def timed(model: OnnxModel, size: tuple[int, int], frames: int) -> dict[str, float]:
    """Return p50 of each step, and p50 and p99 of the whole and of its CPU time [ms]."""
    predictor = Predictor.__new__(Predictor)
    predictor.model = model
    images = [speckle(*size, shift) for shift in np.linspace(0, 4, 8)]
    force = LiveForce(predictor, grey(images[0]), None)
    rows = []
    for number in range(WARM_UP + frames):
        start, busy = time.perf_counter(), time.thread_time()
        shot = Shot(number, time.time(), Frame("speckle", 0.0, grey(images[number % len(images)])))
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
    table = 1e3 * pd.DataFrame(rows[WARM_UP:])
    high = {f"{name} p99": table[name].quantile(0.99) for name in ("whole", "CPU")}
    return {**table.median(), **high}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--sizes", nargs="+", default=["640x480", "400x400", "320x320", "240x240"])
    parser.add_argument("--model", type=Path, help="model.pt or model.onnx; an untrained one if not given")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    model = open_for_prediction(arguments.model) if arguments.model else untrained()
    sizes = [tuple(int(part) for part in size.split("x")) for size in arguments.sizes]
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    found: dict[tuple, list] = {size: [] for size in sizes}
    for _ in range(arguments.rounds):
        for size in sizes:
            found[size].append(timed(model, size, arguments.frames))
    print(f"load after: {os.getloadavg()[0]:.1f}; {arguments.rounds} rounds of {arguments.frames} frames\n")
    columns = ["grey", *STEPS, "message", "whole", "whole p99", "CPU", "CPU p99"]
    table = {f"{w} x {h}": pd.DataFrame(rows).median()[columns] for (w, h), rows in found.items()}
    print(pd.DataFrame(table).T.to_markdown(floatfmt=".2f"))


if __name__ == "__main__":
    main()
