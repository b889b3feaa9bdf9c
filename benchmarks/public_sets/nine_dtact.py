"""Real images without markers, and the depth that the contact circle of a ball implies: linchangyi1/9DTact.

usage: python benchmarks/public_sets/nine_dtact.py --source FOLDER

Two sensors, each with an image at rest and one under a ball of 4.0 mm radius (MIT licence). Neither depth nor force was
recorded, so that they make no session and validate nothing. The circle is where the image darkens; its radius is taken at
the threshold of the authors' calibration and at others. The depth lies between that of the ball's cap, as if the gel next to
the contact stayed flat, and that of Hertz, a^2 / R, at most the gel's thickness.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from shared import found, parser_of, show_table

from gelforge.config import load_study
from gelforge.recording.imaging.flow import Flow, grey
from gelforge.recording.imaging.image_measures import Measurer
from gelforge.recording.imaging.images import image_size, refuse_turned

REPOSITORY = "linchangyi1/9DTact"
FOLDER = "shape_reconstruction/calibration"
STUDY = Path("config/smoke/9dtact.yaml")
BALL_MM = 4.0  # shape_config.yaml, BallRad
THRESHOLDS = (2, 3, 5, 8)  # grey levels darker than at rest; theirs is 3


def read(path: Path) -> np.ndarray:
    """Return an image (H, W, 3), tested as those of a session are."""
    refuse_turned(path)
    image_size(path)
    return cv2.imread(str(path))


def radius_px(rest: np.ndarray, pressed: np.ndarray, threshold: int) -> float:
    """Return the radius [px] of the largest darkened spot, by its area."""
    darker = np.mean(rest.astype(float) - pressed, axis=2)
    outlines, _ = cv2.findContours(
        (darker > threshold).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    return float(np.sqrt(max(map(cv2.contourArea, outlines)) / np.pi))


def of_flow(rest: np.ndarray, pressed: np.ndarray) -> list[str]:
    """Return the share of pixels with texture, the flow [px] rms, and the share of the former that it does not fit."""
    before, after = (grey(image) for image in (rest, pressed))
    search = Flow(before, "fine")
    measures = Measurer(search)(after, search(after), with_lost=True)
    shares = f"{100 * search.texture.mask.mean():.1f} %", f"{100 * measures.flow_lost:.0f} %"
    return [shares[0], f"{measures.flow_px:.0f}", shares[1]]


def main() -> None:
    source = found(parser_of(__doc__, REPOSITORY).parse_args().source, FOLDER)
    thickness = load_study(STUDY).sensor.height_mm
    rows, seen = [], []
    for folder in sorted(source.glob("sensor_*")):
        own = folder / "depth_calibration"
        rest, pressed = read(own / "rectify_crop_ref.png"), read(own / "rectify_crop_sample.png")
        scale = float(np.load(folder / "camera_calibration" / "position_scale.npy")[2])
        radii = [scale * radius_px(rest, pressed, level) for level in THRESHOLDS]
        low = BALL_MM - np.sqrt(BALL_MM**2 - min(radii) ** 2)
        high = min(max(radii) ** 2 / BALL_MM, thickness)
        widths = [f"{radius:.2f}" for radius in radii]
        rows.append([folder.name, f"{scale:.4f}", *widths, f"{low:.2f} to {high:.2f}"])
        seen.append([folder.name, f"{rest.shape[1]} x {rest.shape[0]}", *of_flow(rest, pressed)])
    print(
        "radius of the contact circle [mm] by the threshold in grey levels, and the depth that it implies\n"
    )
    show_table(rows, ["sensor", "mm per px", *map(str, THRESHOLDS), "depth [mm]"])
    show_table(seen, ["sensor", "px", "pixels with texture", "flow [px] rms", "flow_lost (limit 2 %)"])
    print("Depth and force were not recorded: these figures validate nothing.")


if __name__ == "__main__":
    main()
