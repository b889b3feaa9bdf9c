"""The commands and their arguments; standard library only."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

GROUPS = """\
a study            init, check, show, explain, report, tables, adapt
by hand            press, characterise, verify, mismatch, mismatch-materials
live               export, predict, live
cameras            calibrate-camera, camera-pose
what the workflow runs
                   fit-law, plan, simulate, level, derive, sensitivities, simulate-session, readings, features, join,
                   manifest, agreement, train, evaluate
synthetic data     synthesise, virtual-materials, virtual-cell, virtual-session
"""


FRESH = "solve anew what an earlier job that was broken off has solved from the same inputs"


def depth_list(text: str) -> list[float]:
    """Return increasing depths [mm] from `0.25:2:0.25` (first:last:step) or `0.5,1,2`."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = math.floor((last - first) / step + 1e-9) + 1
            depths = [round(first + i * step, 9) for i in range(count)]
        else:
            depths = [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError):
        raise argparse.ArgumentTypeError(
            f"{text!r}: write first:last:step or a comma-separated list"
        ) from None
    if not depths or depths[0] <= 0 or any(b <= a for a, b in zip(depths, depths[1:])):
        raise argparse.ArgumentTypeError(f"{text!r} gives {depths}; depths must be positive and increase")
    return depths


def board_size(text: str) -> tuple[int, int]:
    """Return columns and rows of a board from `9x6`."""
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: write columns x rows, such as 9x6") from None
    return columns, rows


def parser() -> argparse.ArgumentParser:
    """Return the parser of every command."""
    from gelforge import __version__

    top = argparse.ArgumentParser(
        prog="gelforge",
        description="Force-distribution labels, datasets and models for soft, vision-based tactile sensors.",
        epilog=GROUPS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=__version__)
    commands = top.add_subparsers(metavar="COMMAND", required=True)
    _studies(commands)
    _by_hand(commands)
    _live(commands)
    _workflow(commands)
    _virtual(commands)
    return top


def _command(commands, name: str, run: str, text: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=text, description=text)
    command.add_argument("--debug", action="store_true", help="show the traceback of an error")
    command.set_defaults(run=run)
    return command


def _study_command(commands, name: str, run: str, text: str) -> argparse.ArgumentParser:
    command = _command(commands, name, run, text)
    command.add_argument(
        "--study", type=Path, required=True, metavar="YAML", help="the study's configuration"
    )
    return command


def _studies(commands) -> None:
    init = _command(
        commands, "init", "studies.init", "write a commented configuration and sample tables for a new study"
    )
    init.add_argument("study", help="name of the new study")

    check = _command(
        commands, "check", "studies.check", "validate a study; draw it; print cells, minutes and disk"
    )
    check.add_argument("study", help="a study's name (config/NAME.yaml) or its YAML file")
    check.add_argument("--picture", type=Path, help="PNG to write; results/<study>/check.png if not given")

    show = _command(
        commands, "show", "studies.show", "draw a label: a cell's or a shard's force distribution"
    )
    show.add_argument("path", type=Path, metavar="CELL_OR_SHARD", help="an HDF5 file")
    show.add_argument(
        "row", type=int, nargs="?", help="depth step of a cell or row of a shard; the last if not given"
    )
    show.add_argument(
        "--out", type=Path, help="PNG to write; beside the working directory's name of the file if not given"
    )

    explain = _command(
        commands, "explain", "studies.explain", "say where one row of a shard comes from, down to raw files"
    )
    explain.add_argument("path", type=Path, metavar="SHARD", help="a shard")
    explain.add_argument("row", type=int, help="row of the shard")


def _by_hand(commands) -> None:
    press = _command(
        commands, "press", "bench.press", "press once on a sensor and print the force-depth table"
    )
    press.add_argument("--x", type=float, required=True, help="position along x [mm], origin at the corner")
    press.add_argument("--y", type=float, required=True, help="position along y [mm]")
    press.add_argument(
        "--depths",
        type=depth_list,
        required=True,
        help="depths [mm]: first:last:step, or a comma-separated list",
    )
    press.add_argument(
        "--indenter", type=Path, metavar="YAML", help="any indenter, see config/indenters; else the study's"
    )
    press.add_argument(
        "--shear",
        type=float,
        nargs=2,
        metavar=("X", "Y"),
        help="then move sideways by this [mm] at the last depth",
    )
    press.add_argument(
        "--twist",
        type=float,
        default=0.0,
        metavar="DEG",
        help="then turn the indenter about z by this [deg]; the table shows the torque",
    )
    press.add_argument(
        "--unload", action="store_true", help="then take the indenter away again, by the same depths"
    )
    press.add_argument(
        "--sensitivities", metavar="NAMES", help="derivatives to effects: comma-separated names, or all"
    )
    press.add_argument("--out", type=Path, help="the cell's HDF5 file")
    press.add_argument(
        "--study", type=Path, metavar="YAML", help="a study's sensor and settings; else the paper's sensor"
    )
    press.add_argument(
        "--laws", type=Path, nargs="*", default=[], metavar="JSON", help="laws of materials with tests"
    )

    mesh = _command(
        commands, "mesh", "bench.mesh", "write the mesh of a press for ParaView or Gmsh, nothing is solved"
    )
    mesh.add_argument("--x", type=float, required=True, help="position along x [mm], origin at the corner")
    mesh.add_argument("--y", type=float, required=True, help="position along y [mm]")
    mesh.add_argument(
        "--depth", type=float, required=True, help="deepest depth [mm]: the mesh is fine so far around"
    )
    mesh.add_argument("--out", type=Path, required=True, help=".vtu, .vtk or Gmsh's .msh")
    mesh.add_argument(
        "--indenter", type=Path, metavar="YAML", help="any indenter, see config/indenters; else the study's"
    )
    mesh.add_argument(
        "--study", type=Path, metavar="YAML", help="a study's sensor and settings; else the paper's sensor"
    )

    _cameras(commands)

    characterise = _command(
        commands,
        "characterise",
        "characterise.characterise_command",
        "anybody's material tests to a law, its figure and measured effects",
    )
    characterise.add_argument(
        "sources", type=Path, nargs="+", help="folders with samples.csv or small tests, or files"
    )
    characterise.add_argument(
        "--mapping", type=Path, help="YAML that describes the files, see config/mappings"
    )
    characterise.add_argument("--laws", default="ogden2", help="laws to fit, e.g. ogden2,yeoh")
    characterise.add_argument(
        "--choose",
        choices=("aicc", "held_out", "first"),
        default="aicc",
        help="which of the laws is law.json",
    )
    characterise.add_argument("--out", type=Path, required=True, help="folder to write")
    characterise.add_argument(
        "--loss", choices=("linear", "soft_l1"), default="linear", help="soft_l1 forgives outliers"
    )
    characterise.add_argument("--bootstrap", type=int, default=0, help="refits over samples, 0 for none")
    characterise.add_argument("--workers", type=int, default=1, help="processes of the bootstrap")

    verify = _command(
        commands,
        "verify",
        "bench.verify",
        "check the finite elements against solutions from outside; a minute",
    )
    verify.add_argument("--out", type=Path, help="folder for verification.csv and verification.md")

    tests = _command(
        commands,
        "mismatch-materials",
        "mismatch_materials.mismatch_materials",
        "what a law fitted to the fastest loading leaves out of a material's other tests",
    )
    tests.add_argument(
        "sources", type=Path, nargs="+", help="folders with samples.csv or small tests, or files"
    )
    tests.add_argument("--mapping", type=Path, help="YAML that describes the files, see config/mappings")
    tests.add_argument("--out", type=Path, required=True, help="folder to write")

    mismatch = _command(
        commands,
        "mismatch",
        "mismatch.mismatch",
        "which physics was left out: judge a recording; `limits`: what the plan could show; `plan`: what to record next",
    )
    mismatch.add_argument(
        "what",
        help="a session's folder, a folder of sessions, or `limits`, or `plan` (after a verdict in --out)",
    )
    mismatch.add_argument(
        "--config", type=Path, required=True, metavar="YAML", help="the study it is judged against"
    )
    mismatch.add_argument("--out", type=Path, help="folder to write; results/<study>/mismatch if not given")
    mismatch.add_argument(
        "--laws", type=Path, nargs="*", default=[], metavar="JSON", help="laws of materials with tests"
    )
    mismatch.add_argument("--kept", type=Path, help="folder of kept solutions; solves in --out if not given")
    mismatch.add_argument("--workers", type=int, default=1, help="presses that are solved side by side")
    mismatch.add_argument(
        "--no-page", dest="page", action="store_false", help="verdict and tables only, no report.html"
    )

    published = _command(
        commands,
        "mismatch-published",
        "mismatch.published",
        "judge the article's own readings against its two curves and against our cells",
    )
    published.add_argument("--config", type=Path, required=True, metavar="YAML", help="the article's study")
    published.add_argument("--out", type=Path, required=True, help="folder to write")
    published.add_argument("--workers", type=int, default=1, help="presses that are solved side by side")

    _command(commands, "warm-up", "bench.warm_up", "compile the kernels and keep them for later runs")


def _live(commands) -> None:
    export = _command(
        commands, "export", "live.export", "a trained model as an ONNX file, compared with PyTorch's"
    )
    export.add_argument("--model", type=Path, required=True, help="model.pt of a study")
    export.add_argument("--out", type=Path, required=True, help=".onnx file to write")

    predict = _command(
        commands, "predict", "bench.predict", "force distribution of images [N], frame by frame, timed"
    )
    _source(predict)
    predict.add_argument(
        "--out", type=Path, help="CSV to write: total force and every bin [N], one row per frame"
    )
    predict.add_argument("--frames", type=int, help="stop after this many frames")

    live = _command(
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


def _cameras(commands) -> None:
    calibrate = _command(
        commands,
        "calibrate-camera",
        "cameras.calibrate_camera",
        "a camera's focal length, principal point and distortion from images of a board",
    )
    calibrate.add_argument("folder", type=Path, help="folder with images of the board")
    calibrate.add_argument(
        "--board",
        type=board_size,
        required=True,
        metavar="9x6",
        help="inner corners of a checkerboard, or squares of a ChArUco board",
    )
    calibrate.add_argument("--square-mm", type=float, required=True, help="side of a square [mm]")
    calibrate.add_argument("--charuco", action="store_true", help="the board has markers in its squares")
    calibrate.add_argument("--marker-mm", type=float, help="side of a marker [mm]")
    calibrate.add_argument("--dictionary", default="DICT_4X4_50", help="OpenCV's name of the markers")
    calibrate.add_argument("--model", choices=("pinhole", "fisheye"), default="pinhole", help="the lens")
    calibrate.add_argument(
        "--largest-rms-px", type=float, default=1.0, help="refuse a larger reprojection error [px]"
    )
    calibrate.add_argument("--out", type=Path, required=True, help="YAML to write")
    calibrate.add_argument("--report", type=Path, help="PNG: corners, residuals, an image without distortion")

    pose = _command(
        commands,
        "camera-pose",
        "cameras.camera_pose",
        "a camera's position and its turn about z from four presses or more at known places",
    )
    pose.add_argument("session", type=Path, help="a session's folder with images")
    pose.add_argument(
        "--camera", type=Path, metavar="YAML", help="its calibration; that of session.yaml if not given"
    )
    pose.add_argument("--plane-z-mm", type=float, help="mean height of the particles [mm, sensor frame]")
    pose.add_argument("--study", type=Path, metavar="YAML", help="or the study whose layers carry them")
    pose.add_argument("--out", type=Path, help="YAML to write: the camera with its pose")


def _workflow(commands) -> None:
    law = _study_command(
        commands, "fit-law", "factory.fit_law", "material tests, or parameters, to a law and measured effects"
    )
    law.add_argument("--material", required=True)
    law.add_argument("--out", type=Path, required=True, help="folder to write")

    plan = _study_command(commands, "plan", "factory.plan", "the study's cells as a table")
    plan.add_argument("--out", type=Path, required=True)

    simulate = _study_command(commands, "simulate", "factory.simulate", "one cell of a study")
    simulate.add_argument("--cell", required=True)
    simulate.add_argument(
        "--laws", type=Path, nargs="+", required=True, metavar="JSON", help="laws of the materials"
    )
    simulate.add_argument(
        "--mirrored", type=Path, nargs="*", default=[], metavar="H5", help="cell that this one mirrors"
    )
    simulate.add_argument(
        "--between",
        action="store_true",
        help="the cell is one of the sites between which labels are interpolated (plan.interpolation)",
    )
    simulate.add_argument("--variant", help="solve the cell as this variant of the study has it")
    simulate.add_argument(
        "--session", help="solve the cell at the age and temperature that this session states"
    )
    simulate.add_argument("--out", type=Path, required=True)
    simulate.add_argument("--fresh", action="store_true", help=FRESH)

    level = _study_command(
        commands, "level", "between.level", "which sites are solved after a level (plan.interpolation)"
    )
    level.add_argument("--level", type=int, required=True, help="number of the level, from 0")
    level.add_argument("--laws", type=Path, nargs="+", required=True, metavar="JSON")
    level.add_argument("--out", type=Path, required=True)

    derive = _study_command(
        commands,
        "derive",
        "between.derive",
        "a job's mirrored and interpolated cells, written beside the solved ones",
    )
    derive.add_argument("--number", type=int, required=True, help="number of the job, from 0")
    derive.add_argument("--laws", type=Path, nargs="+", required=True, metavar="JSON")

    slopes = _study_command(
        commands,
        "sensitivities",
        "mismatch.sensitivities",
        "the derivatives of one site's forces along all that a verdict may ask for",
    )
    slopes.add_argument("--cell", required=True)
    slopes.add_argument("--laws", type=Path, nargs="+", required=True, metavar="JSON")
    slopes.add_argument("--out", type=Path, required=True)

    in_order = _study_command(
        commands,
        "simulate-session",
        "factory.simulate_session",
        "a session's presses in recorded order on a sensor that softens; goes on where it was broken off",
    )
    in_order.add_argument("--session", required=True)
    in_order.add_argument(
        "--laws", type=Path, nargs="+", required=True, metavar="JSON", help="laws of the materials"
    )
    in_order.add_argument("--out", type=Path, required=True)
    in_order.add_argument("--fresh", action="store_true", help=FRESH)

    for name, text in (
        ("readings", "a session's forces on the sensor, zero subtracted"),
        ("features", "optical-flow features of a session's images"),
    ):
        command = _study_command(commands, name, f"factory.{name}", text)
        command.add_argument("--session", required=True)
        command.add_argument("--out", type=Path, required=True)
        if name == "features":
            command.add_argument("--workers", type=int, default=1, help="threads that read and reduce images")

    join = _study_command(commands, "join", "factory.join", "one shard of the dataset")
    join.add_argument("--shard", type=int, required=True, help="number of the shard")
    join.add_argument("--out", type=Path, required=True)

    _study_command(commands, "manifest", "factory.manifest", "checksums, provenance and card of the dataset")

    agreement = _study_command(
        commands, "agreement", "factory.agreement", "simulated beside measured total force, per press"
    )
    agreement.add_argument("--out", type=Path, required=True)

    synthesise = _study_command(
        commands, "synthesise", "learning.synthesise", "SYNTHETIC training rows of one drawn indentation"
    )
    synthesise.add_argument("--number", type=int, required=True, help="number of the indentation, from 0")
    synthesise.add_argument(
        "--laws", type=Path, nargs="+", required=True, metavar="JSON", help="laws of the materials"
    )
    synthesise.add_argument("--out", type=Path, required=True)

    train = _study_command(
        commands, "train", "learning.train", "train the network; goes on from its last checkpoint"
    )
    train.add_argument("--model", type=Path, required=True, help="model.pt to write")
    train.add_argument("--loss", type=Path, required=True, help="loss.csv to write")

    adapt = _study_command(
        commands,
        "adapt",
        "learning.adapt",
        "gains of a model for another sensor, from a few presses with measured forces",
    )
    adapt.add_argument("--model", type=Path, required=True, help="model.pt as trained")
    adapt.add_argument(
        "--presses", type=int, default=20, help="recorded presses to fit, drawn from those that train"
    )
    adapt.add_argument("--seed", type=int, default=0, help="seed of the draw")
    adapt.add_argument("--out", type=Path, required=True, help="model.pt to write")

    evaluate = _study_command(commands, "evaluate", "learning.evaluate", "predict the held-out cells")
    evaluate.add_argument("--model", type=Path, required=True)
    evaluate.add_argument("--out", type=Path, required=True)

    _study_command(commands, "tables", "factory.tables", "the article's tables from saved predictions")

    report = _study_command(commands, "report", "factory.report", "the study's offline page")
    report.add_argument("--out", type=Path, required=True)


def _virtual(commands) -> None:
    materials = _study_command(
        commands,
        "virtual-materials",
        "factory.virtual_materials",
        "SYNTHETIC raw material tests of a virtual lab",
    )
    materials.add_argument("--material", help="one material; all of the virtual lab if not given")

    cell = _study_command(
        commands, "virtual-cell", "factory.virtual_cell", "one cell of the virtual sensor's truth"
    )
    cell.add_argument("--cell", required=True)
    cell.add_argument("--out", type=Path, required=True)
    cell.add_argument("--fresh", action="store_true", help=FRESH)

    session = _study_command(
        commands, "virtual-session", "factory.virtual_session", "one SYNTHETIC session of a virtual lab"
    )
    session.add_argument("--session", required=True)
    session.add_argument("--workers", type=int, default=1, help="threads that draw images")
