"""Boards drawn through a known lens: what the calibration finds of it, and what it refuses."""

import cv2
import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from synthetic_pictures.boards import BoardCamera, poses

from gelforge.cli import main
from gelforge.config import Camera, load_camera
from gelforge.recording.optics.boards import Board, CalibrationError, View, Views, find_boards
from gelforge.recording.optics.calibration import calibrate, coverage, intrinsics_sd
from gelforge.recording.optics.camera import project, unproject

SIZE = {"width_px": 320, "height_px": 240, "centre_px": [164.0, 117.0], "position_mm": [0, 0, 0]}
LENS = {"coefficients": [-0.25, 0.08, 1e-3, -8e-4, 0.0]}
PINHOLE = Camera(**SIZE, focal_px=260.0, focal_y_px=262.0, distortion=LENS)
FISHEYE = Camera(
    **SIZE, focal_px=170.0, focal_y_px=171.0, distortion={"model": "fisheye", "coefficients": [-0.02, 4e-3, -3e-3, 1e-3]}
)  # fmt: skip
BOARD = Board(7, 5, 5.0)


def poses_of(camera, count, tilt_deg=35.0):
    distance = 55 if camera is PINHOLE else 36
    across = np.array([320, 240]) / camera.focal_px * distance
    return list(poses(count, distance, *(across * [0.75, 0.7]), seed=1, tilt_deg=tilt_deg))


def views_of(camera, board, count=12, noise_px=0.05, tilt_deg=35.0):
    """Return corners as the camera projects them, with noise; outside the image none."""
    rng, points = np.random.default_rng(2), board.points()
    points = points - points.mean(axis=0)
    seen = []
    for number, (tilt, middle) in enumerate(poses_of(camera, count, tilt_deg)):
        local = points @ Rotation.from_euler("xyz", tilt, degrees=True).as_matrix().T + middle
        pixels = project(camera, local * [1, -1, 1])[0] + rng.normal(0, noise_px, (len(points), 2))
        seen.append(View(f"{number:02d}.png", board.points(), pixels))
    return Views((camera.width_px, camera.height_px), seen)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """A folder of drawn boards, one image without a board and one that cannot be read."""
    folder = tmp_path_factory.mktemp("boards")
    take = BoardCamera(PINHOLE, BOARD)
    for number, (tilt, middle) in enumerate(poses_of(PINHOLE, 8, 25.0)):
        picture = take(tilt, middle * [0.85, 0.75, 0.95], np.random.default_rng(number))
        cv2.imwrite(str(folder / f"{number:02d}.png"), picture)
    cv2.imwrite(str(folder / "grey.png"), np.full((240, 320), 128, np.uint8))
    (folder / "broken.png").write_bytes(b"no image")
    return folder


def straightened_apart(found, true, depth_mm=50.0):
    """Return how far (...) [px] two cameras see a point apart, but for a turn of the camera, which its pose takes up."""
    pixels = np.stack(np.meshgrid(np.arange(0, 320, 8.0), np.arange(0, 240, 8.0)), -1).reshape(-1, 2)
    rays = [unproject(camera, pixels, depth_mm) for camera in (found, true)]
    rays = [ray / np.linalg.norm(ray, axis=-1, keepdims=True) for ray in rays]
    turn, _ = Rotation.align_vectors(*rays)
    return np.linalg.norm(project(found, turn.apply(rays[1]))[0] - pixels, axis=-1)


def test_a_drawn_lens_is_found_and_the_command_writes_what_a_session_takes(photographs, tmp_path, capsys):
    # A drawn lens is found
    views = find_boards(photographs, BOARD)
    assert views.left_out["broken.png"].startswith("cannot be decoded")
    assert views.left_out["grey.png"] == "no board of 7 x 5 inner corners is seen whole"
    found = calibrate(views, BOARD)
    assert len(views.seen) >= 6 and found.rms_px < 0.1
    assert_allclose(found.K[[0, 1], [0, 1]], PINHOLE.focals_px, rtol=0.005)
    assert_allclose(found.K[:2, 2], PINHOLE.centre_px, atol=1.0)
    apart = straightened_apart(found.camera, PINHOLE)
    assert np.sqrt((apart**2).mean()) < 0.1 and np.percentile(apart, 95) < 0.3

    # The command writes what a session takes
    out, picture = tmp_path / "camera.yaml", tmp_path / "calibration.png"
    command = ["calibrate-camera", str(photographs), "--board", "7x5", "--square-mm", "5", "--out", str(out)]
    assert main([*command, "--report", str(picture)]) == 0
    printed = capsys.readouterr().out
    for words in ("px rms; worst image", "left out   grey.png: no board", "focal u", "+-", "um/px at 10 mm"):
        assert words in printed
    assert picture.stat().st_size > 20_000
    assert load_camera(out, position_mm=[0, 0, 0]).distortion.model == "pinhole"
    text = out.read_text().replace("  # position_mm", "  position_mm").replace("  # mirrored", "  mirrored")
    camera = load_camera_text(text)
    assert camera.position_mm == [16, 16, -46] and camera.mirrored  # pasted, with what is commented taken in
    assert main([command[0], str(tmp_path / "none"), *command[2:]]) == 1
    assert "no such folder; name the folder with the images of the board" in capsys.readouterr().err


def load_camera_text(text):
    return Camera.model_validate(yaml.safe_load(text)["camera"])


@pytest.mark.parametrize(("model", "true"), [("pinhole", PINHOLE), ("fisheye", FISHEYE)])
def test_both_models_are_found_of_noisy_corners(model, true):
    found = calibrate(views_of(true, BOARD), BOARD, model)
    off = np.array([*(found.K[[0, 1], [0, 1]] - true.focals_px), *(found.K[:2, 2] - true.centre_px)])
    assert np.all(np.abs(off) < 4 * found.intrinsics_sd[:4])  # four of four within 4 sd: all but 1 in 4000
    assert np.all(found.intrinsics_sd[:4] < 1.0)
    assert_allclose(found.rms_px, 0.05 * np.sqrt(2), rtol=0.1)


def test_calibration_agrees_with_opencvs_deviations_and_of_mirrored_images():
    # Standard deviations are opencvs
    views = views_of(PINHOLE, BOARD)
    objects = [v.board for v in views.seen]
    images = [v.pixels.astype(np.float32) for v in views.seen]
    _, K, k, _, _, sd, *_ = cv2.calibrateCameraExtended(objects, images, views.size, None, None)
    found = calibrate(views, BOARD)
    own = intrinsics_sd("pinhole", views.seen, found.poses, K, k.ravel(), found.residuals())
    assert_allclose(own, sd.ravel()[:9], rtol=1e-3)

    # A mirrored camera calibrates to the mirrored description. Images as recorded, whoever flipped them: the result
    # is in their pixels, with p2 of the other sign
    seen = views_of(PINHOLE, BOARD)
    flipped = [View(v.name, v.board, v.pixels * [-1, 1] + [319, 0]) for v in seen.seen]
    one, other = (calibrate(Views(seen.size, v), BOARD) for v in (seen.seen, flipped))
    assert_allclose(other.K[0, 2], 319 - one.K[0, 2], atol=1e-3)
    assert_allclose(other.coefficients, one.coefficients * [1, 1, 1, -1, 1], atol=2e-5)
    assert_allclose(other.rms_px, one.rms_px, rtol=1e-5)


@pytest.mark.parametrize("flip", [False, True])
def test_charuco_boards_tell_whether_images_are_mirrored(tmp_path, flip):
    board = Board(8, 6, 5.0, 3.7)
    take = BoardCamera(PINHOLE, board)
    for number, (tilt, middle) in enumerate(poses_of(PINHOLE, 3)):
        picture = take(tilt, middle * [0.5, 0.5, 0.8], np.random.default_rng(number))
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture[:, ::-1] if flip else picture)
    views = find_boards(tmp_path, board)
    assert views.mirrored is flip and len(views.seen) == 3
    # the corners are where they are in the image as recorded
    for view, (tilt, middle) in zip(views.seen, poses_of(PINHOLE, 3)):
        middle = middle * [0.5, 0.5, 0.8]
        turn = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
        local = (view.board - [20, 15, 0]) @ turn.T + middle
        wanted = project(PINHOLE, local * [1, -1, 1])[0]
        wanted = wanted * [-1, 1] + [319, 0] if flip else wanted
        assert np.median(np.linalg.norm(view.pixels - wanted, axis=1)) < 0.2


def parallel(views):
    return views_of(PINHOLE, BOARD, tilt_deg=0.0, count=12)


def spoiled(views):
    """One image with its corners counted from another one."""
    worse = View("bad.png", views.seen[0].board, np.roll(views.seen[0].pixels, 1, axis=0))
    return Views(views.size, [*views.seen[1:], worse])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: Views(v.size, v.seen[:2], {"x.png": "blurred"}), r"2 image\(s\) show the board, limit 5.*x.png: blurred"),
        (parallel, r"standard deviation of .*%, limit 2%: the boards are too nearly parallel \(within \d"),
        (lambda v: Views((1000, 1000), v.seen), r"corners cover \d+% of the image \(5 x 5 parts\), limit 60%"),
        (lambda v: Views(v.size, [View(s.name, s.board, s.pixels + np.random.default_rng(i).normal(0, 2, s.pixels.shape))
                                  for i, s in enumerate(v.seen)]), r"reprojection error \d\.\d+ px rms, limit 1 px"),
    ],
    ids=["few", "parallel", "uncovered", "noisy"],
)  # fmt: skip
def test_images_that_determine_no_camera_are_refused(change, words):
    with pytest.raises(CalibrationError, match=words):
        calibrate(change(views_of(PINHOLE, BOARD)), BOARD)


def test_an_image_that_does_not_fit_the_others_is_named(tmp_path):
    found = calibrate(spoiled(views_of(PINHOLE, BOARD)), BOARD)
    assert found.views.left_out["bad.png"].startswith("error ") and found.rms_px < 0.1

    # Images of several sizes are refused
    for name, shape in (("a.png", (240, 320)), ("b.png", (240, 300))):
        cv2.imwrite(str(tmp_path / name), np.full(shape, 128, np.uint8))
    with pytest.raises(CalibrationError, match="b.png: 300 x 240 px, but a.png has 320 x 240 px"):
        find_boards(tmp_path, BOARD)
    assert coverage(views_of(PINHOLE, BOARD)) > 0.6
