"""Error and speed of the stretches tracked in pictures, on synthetic films and, where at hand, on real speckle.

usage: python benchmarks/stretch_tracking.py [--seeds 3] [--frames 101] [--pictures DIR]
Prints Markdown tables; --pictures writes frames of one film with the tracked points drawn in. One thread.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from synthetic_pictures.membrane_views import MembraneFilm
from synthetic_pictures.speckle import Camera, Speckle, TensileFilm

from gelforge.materials.imaging.apex_shape import apex_shape
from gelforge.materials.imaging.stretch_tracking import (
    StretchTrack,
    TrackingSettings,
    flow_at_points,
    read_grey,
    track_stretches,
)

ROOT = Path(__file__).parents[1]
DRIFTING = Camera(gain_drift=-0.3, gradient_drift=0.3, offset_drift_grey=15)
NOISY = Camera(blur_px=1.5, noise_grey=8.0, gain_drift=-0.3)
CASES = {
    "uniaxial": {},
    "uniaxial, 5 % slip, brightness drift, 3 deg turn": {"slip": 0.05, "camera": DRIFTING, "turn_rad": 0.05},
    "pure shear, 5 % slip, brightness drift": {"test": "pure_shear", "slip": 0.05, "camera": DRIFTING},
    "uniaxial, 5 % slip, drift, 90 % of the ink replaced": {"slip": 0.05, "camera": DRIFTING, "wear": 0.9},
    "uniaxial, noise of 8 grey levels, blur 1.5 px": {"slip": 0.05, "camera": NOISY},
}


def per_cent(values: np.ndarray) -> str:
    return " / ".join(f"{100 * v:.3f}" for v in values)


def drawn_points(frame: np.ndarray, track: StretchTrack, number: int) -> np.ndarray:
    """Return a frame in colour with the points of the track on it, to be looked at; a lost frame has none."""
    picture = cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)
    for x, y in track.grid_of_frame_px[number]:
        if np.isfinite(x):
            cv2.circle(picture, (round(16 * x), round(16 * y)), 24, (0, 200, 255), -1, cv2.LINE_AA, 4)
    lam1, lam2 = track.stretch[number]
    text = (
        f"frame {number}: lam1 {lam1:.3f}, lam2 {lam2:.3f}" if np.isfinite(lam1) else f"frame {number}: lost"
    )
    cv2.putText(picture, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (80, 255, 80), 1, cv2.LINE_AA)
    return picture


def tensile(seeds: int, frames: int, pictures: Path | None) -> pd.DataFrame:
    """Return, per case, the worst and rms error of lam1 / lam2 over all seeds and frames to stretch 3."""
    rows = []
    for name, settings in CASES.items():
        found, lost, seconds = [], 0, 0.0
        for seed in range(seeds):
            film = TensileFilm(np.linspace(1, 3, frames), seed=seed, speckle=Speckle(seed + 1), **settings)
            shown = list(film.frames())
            start = time.perf_counter()
            track = track_stretches(shown, film.window)
            seconds += time.perf_counter() - start
            found.append(track.stretch / film.principal_stretches - 1)
            lost += len(track.lost)
            if pictures is not None and seed == 0:
                some = [drawn_points(shown[k], track, k) for k in np.linspace(0, frames - 1, 4).astype(int)]
                cv2.imwrite(str(pictures / f"{len(rows)}.png"), np.vstack(some))
        error = np.concatenate(found)
        rows.append(
            {
                "film": name,
                "worst lam1 / lam2 [%]": per_cent(np.nanmax(np.abs(error), axis=0)),
                "rms [%]": per_cent(np.sqrt(np.nanmean(error**2, axis=0))),
                "lost frames": lost,
                "frames/s": f"{seeds * frames / seconds:.0f}",
            }
        )
    return pd.DataFrame(rows)


def membrane(frames: int) -> pd.DataFrame:
    """Return the errors of apex stretch (top view) and apex radius (side view) of an inflation to stretch 2."""
    rows = []
    for distance in (None, 150.0):
        film = MembraneFilm(np.linspace(1, 2, frames), camera_distance_mm=distance)
        track = track_stretches(
            (film.top_view(k) for k in range(frames)), (150, 130, 100, 100), TrackingSettings(degree=3)
        )
        stretch = np.abs(track.stretch / film.apparent_stretch[:, None] - 1).max()
        bulged = np.flatnonzero(film.stretch >= 1.03)
        radius = [
            apex_shape(film.side_view(k), film.mm_per_px).radius_mm / film.radius_mm[k] - 1 for k in bulged
        ]
        rows.append(
            {
                "top camera": "telecentric" if distance is None else f"{distance:g} mm away",
                "worst stretch [%]": f"{100 * stretch:.3f}",
                "worst radius from stretch 1.03 [%]": f"{100 * np.abs(radius).max():.3f}",
            }
        )
    return pd.DataFrame(rows)


def real_speckle(folder: Path) -> pd.DataFrame:
    """Return the distance [px] from an independent solution (DICe) on real speckle frames."""
    frames = {k: read_grey(folder / f"oht_cfrp_{k}.tiff") for k in ("00", "02", "04")}
    rows = []
    for number in ("02", "04"):
        table = pd.read_csv(folder / f"DICe_solution_{number}.txt", comment="*")
        points = table[["COORDINATE_X", "COORDINATE_Y"]].to_numpy()
        moved = table[["DISPLACEMENT_X", "DISPLACEMENT_Y"]].to_numpy()
        flow, _, _ = flow_at_points(frames["00"], frames[number], points, 27)
        distance = np.linalg.norm(flow - moved, axis=1)
        row = {"frame": number, "points": len(points), "rms [px]": np.sqrt(np.mean(distance**2))}
        rows.append(row | {"95 % [px]": np.quantile(distance, 0.95), "worst [px]": distance.max()})
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=101)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    if arguments.pictures is not None:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    print(tensile(arguments.seeds, arguments.frames, arguments.pictures).to_markdown(index=False), "\n")
    print(membrane(41).to_markdown(index=False), "\n")
    folder = Path(os.environ.get("GELFORGE_SHARED", ROOT.parent / "shared")) / "data" / "dic_speckle"
    print(
        real_speckle(folder).to_markdown(index=False, floatfmt=".4f")
        if folder.is_dir()
        else f"{folder} is absent"
    )


if __name__ == "__main__":
    main()
