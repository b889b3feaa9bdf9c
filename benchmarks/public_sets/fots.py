"""Optical flow of real images next to tracked markers, by search and size of the images: Rancho-zhao/FOTS.

usage: python benchmarks/public_sets/fots.py --source FOLDER

A marker GelSight, 320 x 240 px, with the displacement of 99 markers from rest in whole pixels. Flow is searched from one
image to another and averaged over a disk about each marker. Images that are equal are counted once: files 2 to 5
repeat the first two, and there is no image at rest, so that press and twist cannot be tested.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from shared import found, parser_of, show_table

from gelforge.recording.features import flow_features
from gelforge.recording.imaging.flow import PRESETS, Flow, read_grey, reduced

REPOSITORY = "Rancho-zhao/FOTS"
FOLDER = "marker_calib/data"
DISK_PX = 6  # about a marker, whose radius it is
SCALES = (1.0, 0.8, 0.5)
CLASSES = ((0.0, 3.0), (3.0, 6.0), (6.0, np.inf))  # of markers, by how far they moved [px]
REGIONS = 3  # along each side of the image, for features: some ten markers in each
WHOLE_PX = np.sqrt(2 / 12)  # standard deviation of the difference of two whole numbers


def frames(folder: Path) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return name, image (240, 320) and markers (99, 4: place at rest, displacement) [px] of the images that differ."""
    out: list[tuple[str, np.ndarray, np.ndarray]] = []
    paths = sorted(folder.glob("*.png"))
    for path in paths:
        image, markers = read_grey(path), pd.read_csv(path.with_suffix(".csv")).to_numpy(float)
        if not any(np.array_equal(image, known) for _, known, _ in out):
            out.append((path.name, image, markers))
    print(f"{len(paths)} images, {len(out)} of them differ: {', '.join(name for name, _, _ in out)}\n")
    return out


def at_markers(flow: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the mean flow (n, 2) [px] over a disk about each place (n, 2) [px] of a flow (H, W, 2)."""
    rows, columns = np.mgrid[: flow.shape[0], : flow.shape[1]]
    near = [np.hypot(columns - x, rows - y) <= DISK_PX for x, y in places]
    return np.array([flow[disk].mean(axis=0) for disk in near])


def of_regions(places: np.ndarray, values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the mean of values (n,) at places (n, 2) [px] over each region of an image, row by row."""
    column, row = (places / size * REGIONS).astype(int).T
    return np.array([values[row * REGIONS + column == k].mean() for k in range(REGIONS**2)])


def main() -> None:
    seen = frames(found(parser_of(__doc__, REPOSITORY).parse_args().source, FOLDER))
    (first, before, rest), (second, after, moved) = seen[:2]
    size = before.shape[::-1]
    places, tracked = rest[:, :2] + rest[:, 2:], moved[:, 2:] - rest[:, 2:]
    inside = ((places >= DISK_PX) & (places <= np.array(size) - 1 - DISK_PX)).all(axis=1)
    places, tracked = places[inside], tracked[inside]
    length = np.hypot(*tracked.T)
    wanted = of_regions(places, length, size)
    rows = []
    for preset in PRESETS:
        for scale in SCALES:
            flow = Flow(reduced(before, scale), preset)(reduced(after, scale)) / scale
            off = at_markers(flow, (places + 0.5) * scale - 0.5) - tracked
            distance = np.hypot(*off.T)
            feature = flow_features(flow, REGIONS, 0.0)[: REGIONS**2]
            classes = [distance[(length >= low) & (length < high)] for low, high in CLASSES]
            rows.append(
                [
                    preset,
                    f"{scale:g}",
                    *(f"{np.sqrt(np.mean(off[:, a] ** 2)):.2f}" for a in (0, 1)),
                    *(f"{np.sqrt(np.mean(one**2)):.2f}" for one in classes),
                    f"{np.sqrt(np.mean((feature - wanted) ** 2)):.2f}",
                ]
            )
    counts = [
        f"{low:g} to {high:g} px ({np.sum((length >= low) & (length < high))})" for low, high in CLASSES
    ]
    print(
        f"{first} to {second}: shear under load, {len(places)} markers move by {length.min():.1f} to {length.max():.1f} px"
    )
    print(
        f"error [px] rms; whole pixels alone give {WHOLE_PX:.2f} along an axis, {np.sqrt(2) * WHOLE_PX:.2f} in length\n"
    )
    show_table(rows, ["flow_preset", "image_scale", "u", "v", *counts, "mean length of 9 regions"])


if __name__ == "__main__":
    main()
