"""Arguments of the network's commands: model; train, adapt, evaluate; export, predict, live."""

from __future__ import annotations

import argparse
from pathlib import Path

from gelforge.cli.common import add_command, add_study, study_command
from gelforge.dataset.exports import NAMES


def add_use(commands) -> None:
    """Add the commands that use a model, and the one that builds a shipped sensor's."""
    _model(commands)
    _export(commands)

    predict = add_command(
        commands,
        "predict",
        "model.predict.predict",
        "force distribution of images [N], frame by frame, timed",
    )
    _source(predict)
    predict.add_argument(
        "--out", type=Path, help="CSV to write: total force and every bin [N], one row per frame"
    )
    predict.add_argument("--frames", type=int, help="stop after this many frames")

    live = add_command(
        commands,
        "live",
        "model.live.live",
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
    live.add_argument("--max-recordings", type=int, metavar="N", help="recordings that the folder may hold")
    live.add_argument("--max-recording-mb", type=float, metavar="MB", help="size at which a recording ends")
    live.add_argument("--fps", type=float, default=30.0, help="frames per second of a folder or a video")
    live.add_argument("--loop", action="store_true", help="play a folder or a video again and again")
    live.add_argument("--open", dest="browser", action="store_true", help="open the page in the browser")


def add_learning(commands) -> None:
    """Add the commands by which a model comes to be."""
    train = study_command(
        commands, "train", "model.learning.train", "train the network; goes on from its last checkpoint"
    )
    train.add_argument("--model", type=Path, required=True, help="model.pt to write")
    train.add_argument("--loss", type=Path, required=True, help="loss.csv to write")

    adapt = study_command(
        commands,
        "adapt",
        "model.learning.adapt",
        "gains of a model for another sensor, from a few indentations with measured forces",
    )
    adapt.add_argument("--model", type=Path, required=True, help="model.pt as trained")
    adapt.add_argument(
        "--presses", type=int, default=20, help="recorded indentations to fit, drawn from those that train"
    )
    adapt.add_argument("--seed", type=int, default=0, help="seed of the draw")
    adapt.add_argument("--out", type=Path, required=True, help="model.pt to write")

    evaluate = study_command(commands, "evaluate", "model.learning.evaluate", "predict the held-out cells")
    evaluate.add_argument("--model", type=Path, required=True, help="model.pt as trained")
    evaluate.add_argument("--out", type=Path, required=True, help="HDF5 file of predictions to write")

    check = study_command(
        commands,
        "onnx-check",
        "model.export.onnx_check",
        "forces of held-out images by ONNX Runtime against PyTorch's predictions",
    )
    check.add_argument("--model", type=Path, required=True, help="model.onnx as exported")
    check.add_argument("--out", type=Path, required=True, help="JSON to write")


def _model(commands) -> None:
    model = add_command(
        commands,
        "model",
        "model.build.model",
        "a model for a shipped sensor, trained on simulated images alone (SYNTHETIC)",
    )
    model.add_argument("--sensor", required=True, help="name of a shipped sensor, such as gelsight_mini")
    model.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder to work in")
    model.add_argument("--cores", type=int, default=2, help="processor cores to use")


def _export(commands) -> None:
    export = add_command(
        commands,
        "export",
        "model.export.export_model",
        "a trained model as an ONNX file, compared with PyTorch's; export dataset: a dataset in another format",
    )
    # left out of the arguments where `dataset` follows
    add_study(export, text="the study whose model is exported", default=argparse.SUPPRESS)
    export.add_argument(
        "--model", type=Path, default=argparse.SUPPRESS, help="model.pt of a study, instead of --study"
    )
    export.add_argument(
        "--out",
        type=Path,
        default=argparse.SUPPRESS,
        help=".onnx file to write; next to the model if not given",
    )
    dataset = add_command(
        export.add_subparsers(metavar="dataset"),
        "dataset",
        "model.export.export_dataset",
        "a study's dataset in another format: " + ", ".join(NAMES),
    )
    dataset.add_argument("--format", dest="form", choices=NAMES, required=True, help="see docs/exports.md")
    where = dataset.add_mutually_exclusive_group(required=True)
    add_study(where)
    where.add_argument(
        "--results", type=Path, metavar="FOLDER", help="results/<study>, or the folder of a dataset"
    )
    dataset.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="new folder to write")
    dataset.add_argument("--images", action="store_true", help="put the images into the export, compressed")
    dataset.add_argument(
        "--sample-mb",
        type=float,
        metavar="MB",
        help="a part of at most this size: indentations drawn by the study's seed, of every split its share",
    )
    dataset.add_argument(
        "--fps",
        type=float,
        default=10.0,
        help="frames per second of formats that need times; shards hold none",
    )
    dataset.add_argument("--licence", help="identifier of the licence that you grant, e.g. cc-by-4.0")
    dataset.add_argument("--published", metavar="DATE", help="date of publication, e.g. 2026-11-27")


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
