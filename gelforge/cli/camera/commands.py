"""Arguments of the commands for cameras: calibrate-camera, camera-pose."""

from __future__ import annotations

import argparse
from pathlib import Path

from gelforge.cli.common import add_command, add_study


def board_size(text: str) -> tuple[int, int]:
    """Return columns and rows of a board from `9x6`."""
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: write columns x rows, such as 9x6") from None
    return columns, rows


def add(commands) -> None:
    """Add the commands for cameras."""
    calibrate = add_command(
        commands,
        "calibrate-camera",
        "camera.calibration.calibrate_camera",
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

    pose = add_command(
        commands,
        "camera-pose",
        "camera.pose.camera_pose",
        "a camera's position and its turn about z from four indentations or more at known places",
    )
    pose.add_argument("session", type=Path, help="a session's folder with images")
    pose.add_argument(
        "--camera", type=Path, metavar="YAML", help="its calibration; that of session.yaml if not given"
    )
    pose.add_argument("--plane-z-mm", type=float, help="mean height of the particles [mm, sensor frame]")
    add_study(pose, text="or the study whose layers carry them")
    pose.add_argument("--out", type=Path, help="YAML to write: the camera with its pose")
