"""Commands that use a model: export, predict, live."""

from __future__ import annotations

import argparse
from pathlib import Path

from gelforge.cli.parsers.common import add_command


def add(commands) -> None:
    """Add the commands that use a model."""
    export = add_command(
        commands, "export", "live.export", "a trained model as an ONNX file, compared with PyTorch's"
    )
    export.add_argument("--model", type=Path, required=True, help="model.pt of a study")
    export.add_argument("--out", type=Path, required=True, help=".onnx file to write")

    predict = add_command(
        commands, "predict", "bench.predict", "force distribution of images [N], frame by frame, timed"
    )
    _source(predict)
    predict.add_argument(
        "--out", type=Path, help="CSV to write: total force and every bin [N], one row per frame"
    )
    predict.add_argument("--frames", type=int, help="stop after this many frames")

    live = add_command(
        commands,
        "live",
        "live.live",
        "forces of a camera as they come: a page in the browser, and JSON over a WebSocket for robots",
    )
    _source(live)
    live.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to serve on; others than this machine's own let the network read and command it",
    )
    live.add_argument("--port", type=int, default=8765, help="port to serve on; 0: any free one")
    live.add_argument("--record", type=Path, metavar="FOLDER", help="record from the start, into this folder")
    live.add_argument("--fps", type=float, default=30.0, help="frames per second of a folder or a video")
    live.add_argument("--loop", action="store_true", help="play a folder or a video again and again")
    live.add_argument("--open", dest="browser", action="store_true", help="open the page in the browser")


def _source(command: argparse.ArgumentParser) -> None:
    command.add_argument("source", help="folder of images, video file, or camera number")
    command.add_argument("--model", type=Path, required=True, help="model.onnx, or model.pt of a study")
    command.add_argument(
        "--reference", type=Path, help="zero-force image; the source's first frame if not given"
    )
    command.add_argument(
        "--crop",
        type=int,
        nargs=4,
        metavar=("LEFT", "TOP", "WIDTH", "HEIGHT"),
        help="part of each image to use [px]",
    )
    command.add_argument(
        "--camera",
        type=Path,
        metavar="YAML",
        help="calibration and pose of the camera (or a session.yaml): frames are remapped to the model's view",
    )
    command.add_argument(
        "--plane-z-mm",
        type=float,
        help="mean height of the particles, for a model whose sessions had no `remap` [mm, sensor frame]",
    )
