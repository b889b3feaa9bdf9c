"""`gelforge predict`: forces of images, frame by frame, and how long each step takes."""

from __future__ import annotations

import csv
import json
import math
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gelforge.cli.tables import print_table
from gelforge.config import load_camera
from gelforge.progress import tracked


def predict(
    source: str,
    model: Path,
    reference: Path | None,
    crop: list[int] | None,
    camera: Path | None,
    plane_z_mm: float | None,
    out: Path | None,
    frames: int | None,
) -> None:
    """Print the total force of each frame, write the distributions, and print how long each step took."""
    from itertools import islice

    from gelforge.learning.deployment.predictor import Predictor, Timing, predict_frames
    from gelforge.recording.imaging.flow import read_grey
    from gelforge.recording.imaging.frames import frames as frames_of

    zero = read_grey(reference) if reference else None
    timing = Timing(10)  # the first frames are not timed
    seen_by = load_camera(camera) if camera else None
    predictor = Predictor(model)
    predictions = predict_frames(predictor, frames_of(source), zero, crop, seen_by, plane_z_mm)
    predictions = islice(predictions, frames)
    if zero is None:
        print("the first frame is taken as the reference: nothing must touch the sensor in it")
    marked, touched = [], 0
    settings = predictor.model.settings
    if settings.get("trained_on"):
        print(f"the model was trained on {settings['trained_on']}")
    grid = settings["bins"]["nx"], settings["bins"]["ny"], np.array(settings["sensor_width_mm"])
    with distribution_table(out, grid) as write:
        for prediction in tracked(predictions, f"frames of {source}", frames):
            timing.add(prediction)
            write(prediction)
            marked.append(prediction.disagreement > 1)
            touched += bool(prediction.force_N.any())
    print(f"{len(marked)} frames, {touched} of them touched" + (f"; written to {out}" if out else ""))
    if marked and not touched:
        print(
            f"no bin exerts more than the {predictor.model.zero.contact_N:.3g} N below which this model reads no contact"
        )
    if any(marked):
        print(
            f"the total force of {sum(marked)} of {len(marked)} frames is not that of inverse elasticity: distrust it "
            "(another camera, gel or contact? docs/learning.md)"
        )
    print_timing(timing)


@contextmanager
def distribution_table(path: Path | None, grid: tuple):
    """Yield a function that writes a prediction as a row: name, time, total force, contacts, then every bin's force [N].

    Rows are written as they come, so that a live run that is interrupted keeps what it has seen; without a path the
    total force is printed instead, and each contact where there are several. Contacts are JSON. A time or a
    disagreement that is not known is left empty. grid: bins nx, ny and widths [mm].
    """
    from gelforge.learning.models.contacts import contacts

    if path is None:

        def show(p) -> None:
            print(f"{p.name}  F = {_newtons(p.force_N.sum(axis=0))}")
            if len(found := contacts(p.force_N, *grid)) > 1:
                for one in found:
                    print(
                        f"    at ({one.centre_mm[0]:.2f}, {one.centre_mm[1]:.2f}) mm  F = {_newtons(one.force_N)}"
                    )

        yield show
        return
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)

        def write(p) -> None:
            if file.tell() == 0:
                bins = [f"f{axis}_{k}_N" for k in range(len(p.force_N)) for axis in "xyz"]
                rows.writerow(["frame", "time_s", "disagreement", "fx_N", "fy_N", "fz_N", "contacts", *bins])
            apart = [
                {"force_N": one.force_N.round(6).tolist(), "cop_mm": one.centre_mm.round(3).tolist()}
                for one in contacts(p.force_N, *grid)
            ]
            total = [f"{value:.6g}" for value in p.force_N.sum(axis=0)]
            seconds = f"{p.time_s:.6f}" if math.isfinite(p.time_s) else ""
            disagreement = f"{p.disagreement:.3g}" if math.isfinite(p.disagreement) else ""
            bins = [f"{value:.6g}" for value in p.force_N.ravel()]
            rows.writerow([p.name, seconds, disagreement, *total, json.dumps(apart), *bins])

        yield write


def _newtons(force: np.ndarray) -> str:
    return "  ".join(f"{value:+.3f}" for value in force) + " N"


def print_timing(timing) -> None:
    """Print p50, p95 and p99 of every step [ms] and the frames per second that they allow."""
    counted = max(timing.seen - timing.warm_up, 0)
    if not counted:
        print(f"no times: {timing.seen} frames, and the first {timing.warm_up} are not counted")
        return
    table = timing.table().drop(columns="frames")
    formats = dict.fromkeys(("p50_ms", "p95_ms", "p99_ms"), ".2f")
    formats |= dict.fromkeys(("fps_at_p50", "fps_at_p99"), ".0f")
    title = f"time per frame ({counted} frames, after the first {timing.warm_up}, which are not counted)"
    print_table(table, formats, title)
