"""What docs/cameras.md says in numbers: lenses there and back, drawn boards calibrated, images remapped, poses from presses.

python benchmarks/cameras.py            # a minute
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from synthetic_pictures.boards import BoardCamera, poses

from gelforge.config import Camera, VirtualImaging
from gelforge.recording.camera_pose import fit_pose
from gelforge.recording.imaging.flow import Flow
from gelforge.recording.optics.boards import Board, find_boards
from gelforge.recording.optics.calibration import calibrate
from gelforge.recording.optics.camera import image_axes, project, unproject
from gelforge.recording.optics.expansion import centre_of_expansion
from gelforge.recording.optics.remap import Remapper, places_in
from gelforge.virtual_lab.imaging import draw, expose

SIZE = {"width_px": 640, "height_px": 480, "centre_px": [325.0, 236.0], "position_mm": [0, 0, 0]}
LENSES = {
    "pinhole": {"focal_px": 500.0, "focal_y_px": 503.0, "distortion": {"coefficients": [-0.25, 0.08, 1e-3, -8e-4, -0.01]}},
    "fisheye": {
        "focal_px": 330.0,
        "focal_y_px": 332.0,
        "distortion": {"model": "fisheye", "coefficients": [-0.02, 0.004, -0.003, 0.001]},
    },
}  # fmt: skip
DISTANCE_MM = {"pinhole": 75, "fisheye": 42}
VIEW = {
    "width_px": 400,
    "height_px": 400,
    "focal_px": 545.0,
    "centre_px": [199.5, 199.5],
    "position_mm": [16, 16, -46],
}
PORT = {"z_mm": -10.0, "index": 1.41, "pane_mm": 4.0}
Z = -3.75


def rms(off: np.ndarray) -> float:
    return float(np.sqrt((off**2).sum(axis=-1).mean()))


def there_and_back() -> None:
    u, v = np.meshgrid(np.arange(0, 640, 4.0), np.arange(0, 480, 4.0))
    pixels = np.stack([u, v], -1)
    for name, lens in LENSES.items():
        for port in (None, PORT):
            camera = Camera(**(SIZE | lens | {"position_mm": [16, 16, -46]}), port=port)
            back = project(camera, unproject(camera, pixels, Z))[0]
            print(
                f"{name}, {'port' if port else 'no port'}: there and back {np.abs(back - pixels).max():.1e} px"
            )


def apart(found: Camera, true: Camera) -> np.ndarray:
    """Return how far (N,) [px] two cameras see points apart, but for a turn, which the pose takes up."""
    pixels = np.stack(np.meshgrid(np.arange(0, 640, 8.0), np.arange(0, 480, 8.0)), -1).reshape(-1, 2)
    rays = [unproject(camera, pixels, 50.0) for camera in (found, true)]
    rays = [ray / np.linalg.norm(ray, axis=-1, keepdims=True) for ray in rays]
    turn, _ = Rotation.align_vectors(*rays)
    return np.linalg.norm(project(found, turn.apply(rays[1]))[0] - pixels, axis=-1)


def calibrated(images: int = 16) -> None:
    for name, lens in LENSES.items():
        camera = Camera(**SIZE, **lens)
        across = np.array([640, 480]) / camera.focal_px * DISTANCE_MM[name] - [25, 20]
        for board in (Board(9, 6, 5.0), Board(11, 8, 5.0, 3.7)):
            take = BoardCamera(camera, board)
            with tempfile.TemporaryDirectory() as folder:
                for number, (tilt, middle) in enumerate(poses(images, DISTANCE_MM[name], *across, seed=1)):
                    picture = take(tilt, middle, np.random.default_rng(number))
                    cv2.imwrite(str(Path(folder) / f"{number:02d}.png"), picture)
                found = calibrate(find_boards(folder, board), board, name)
            off = apart(found.camera, camera)
            focal = max(abs(np.diag(found.K)[:2] / camera.focals_px - 1))
            print(
                f"{name}, {board.words}: {len(found.views.seen)} of {images} images, {found.rms_px:.3f} px rms; focal "
                f"length {100 * focal:.3f} % off, principal point {np.abs(found.K[:2, 2] - camera.centre_px).max():.2f} px, "
                f"map {np.sqrt((off**2).mean()):.3f} px rms, 99 %: {np.percentile(off, 99):.2f}, largest {off.max():.2f}"
            )


def particles(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([1.5, 1.5, -6], [30.5, 30.5, -1.5], (5200, 3))


def moved(X: np.ndarray, place, depth: float) -> np.ndarray:
    """Return X as a press moves it: outwards and down, nothing at the base; a closed form, not a solution."""
    r = X[:, :2] - place
    bell = np.exp(-(r**2).sum(axis=1) / 32) * (X[:, 2] + 6) / 4.5
    return X + depth * np.concatenate([0.12 * r * bell[:, None], -0.7 * bell[:, None]], axis=1)


def remapped() -> None:
    """A camera with 1 % more focal length, 2 px and 0.5 deg off; the same 0.5 mm aside; with a lens."""
    view = Camera(**VIEW)
    off = VIEW | {"focal_px": 1.01 * 545, "centre_px": [201.5, 197.5], "rotation_deg": [0.5, -0.5, 0.5]}
    cameras = {
        "1 %, 2 px, 0.5 deg": off,
        "and a lens (k1 -0.2)": off | {"distortion": {"coefficients": [-0.2, 0.05, 1e-3, 5e-4]}},
        "and 0.5 mm aside": off | {"position_mm": [16.5, 16, -46]},
        "and 1 mm nearer": off | {"position_mm": [16, 16, -45]},
    }
    X, imaging = particles(), VirtualImaging()
    seen = [project(view, points)[0] for points in (X, moved(X, [16, 16], 1.0))]
    inner = np.all((seen[0] > 25) & (seen[0] < 375), axis=1)
    rng = np.random.default_rng(0)
    wanted = flow_of([draw(view, imaging, points, 0.3) for points in (X, moved(X, [16, 16], 1.0))], rng)
    again = flow_of([draw(view, imaging, points, 0.3) for points in (X, moved(X, [16, 16], 1.0))], rng)
    print(f"flow of the view itself, drawn twice: {rms(again - wanted):.3f} px rms apart")
    for name, keys in cameras.items():
        camera = Camera(**keys)
        before = rms((project(camera, X)[0] - seen[0])[inner])
        # through the plane back into the view's pixels
        landed = project(view, unproject(camera, project(camera, X)[0], Z))[0]
        plane = X[inner] * [1, 1, 0] + [0, 0, Z]
        exact = project(view, unproject(camera, project(camera, plane)[0], Z))[0] - project(view, plane)[0]
        pictures = [draw(camera, imaging, points, 0.3) for points in (X, moved(X, [16, 16], 1.0))]
        raw = flow_of(pictures, rng)
        to_view = Remapper(camera, view, Z)
        found = flow_of([to_view(picture) for picture in pictures], rng)
        print(
            f"{name}: particles {before:.2f} px rms off, remapped {rms((landed - seen[0])[inner]):.3f} (on the plane "
            f"{np.abs(exact).max():.0e}); flow of blocks {rms(raw - wanted):.3f} px off, then {rms(found - wanted):.3f}; "
            f"the camera sees {to_view.seen:.1%}"
        )
    step = np.abs(places_in(view, view, Z) - np.stack(np.meshgrid(np.arange(400), np.arange(400)), -1)).max()
    print(f"the view remapped to itself: {step:.0e} px")


def flow_of(pictures: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Return the mean flow (16, 16, 2) [px] of blocks between two noise-free images, 20 px within their border."""
    first, second = (expose(picture, VirtualImaging(), rng) for picture in pictures)
    flow = Flow(first, "fine")(second)[24:376, 24:376]
    return flow.reshape(16, 22, 16, 22, 2).mean(axis=(1, 3))


def centroid(flow: np.ndarray) -> np.ndarray:
    """Return the centroid (2,) [px] of a flow's squared length, what the fit starts near."""
    weight = (flow.astype(float) ** 2).sum(axis=-1)
    v, u = np.mgrid[: flow.shape[0], : flow.shape[1]]
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()


def from_presses() -> None:
    X, imaging, rng = particles(), VirtualImaging(), np.random.default_rng(0)
    nine = np.array([[x, y] for x in (8, 16, 24) for y in (9, 16, 23.0)])
    plain = VIEW | {"centre_px": [201.0, 197.0], "position_mm": [16.4, 15.7, -46], "rotation_deg": [0, 0, 2]}
    cameras = {
        "plain": plain,
        "lens": plain | {"distortion": {"coefficients": [-0.2, 0.05, 1e-3, 5e-4]}},
        "port, unmirrored": plain
        | {"focal_px": 430.0, "mirrored": False, "port": {"z_mm": -6.0, "index": 1.41}},
        "tilts 2, -1 deg known": plain | {"rotation_deg": [2, -1, 2]},
    }
    for name, keys in cameras.items():
        camera = Camera(**keys)
        search = Flow(expose(draw(camera, imaging, X, 0.3), imaging, rng), "fine")
        up = image_axes(camera)[:, 2]
        e = np.array(camera.centre_px) + camera.focal_px * up[:2] / up[2]
        pictures = (expose(draw(camera, imaging, moved(X, p, 1.0), 0.3), imaging, rng) for p in nine)
        flows = [search(picture) for picture in pictures]
        centres = np.array([centre_of_expansion(flow, e) for flow in flows])
        true = project(camera, np.column_stack([nine, np.full(len(nine), Z)]))[0]
        centroids = np.array([centroid(flow) for flow in flows])
        print(f"{name}: centres {rms(centres - true):.1f} px rms off, centroids {rms(centroids - true):.1f}")
        unposed = {"position_mm": [0, 0, -1000], "rotation_deg": [*camera.rotation_deg[:2], 0.0]}
        for places in (list(range(9)), [0, 2, 6, 8]):
            pose = fit_pose(
                camera.model_copy(update=unposed), list("abcdefghi"), nine[places], centres[places], Z
            )
            off = np.subtract(pose.camera.position_mm, camera.position_mm)
            print(
                f"pose, {name}, {len(places)} presses: {np.hypot(*off[:2]):.3f} mm aside, {off[2]:+.2f} mm high, "
                f"{pose.camera.rotation_deg[2] - camera.rotation_deg[2]:+.2f} deg; told {pose.sd[0]:.3f}, {pose.sd[2]:.2f} "
                f"mm, {pose.sd[3]:.2f} deg; {pose.rms_px:.2f} px rms; a tilt of 1 deg: "
                f"{pose.per_tilt_mm:.2f} mm, {pose.per_tilt_px:.2f} px"
            )


if __name__ == "__main__":
    there_and_back()
    remapped()
    from_presses()
    calibrated()
