"""A camera's pose from drawn presses at known places."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from session_folder import HEADER

from gelforge.cli import main
from gelforge.cli.study.check import print_scale
from gelforge.config import Camera, Session, VirtualImaging, load_camera, study_from, write_yaml
from gelforge.recording.camera_pose import fit_pose, particle_plane_mm
from gelforge.recording.optics.camera import CameraError, project
from gelforge.recording.optics.expansion import centre_of_expansion
from gelforge.virtual_lab.imaging import draw, expose

KEYS = {"width_px": 300, "height_px": 280, "focal_px": 400.0, "centre_px": [152.0, 138.0]}
LENS = {"coefficients": [-0.2, 0.05, 1e-3, 5e-4]}
TRUE = Camera(**KEYS, position_mm=[16.4, 15.7, -46], rotation_deg=[0, 0, 2.0], distortion=LENS)
PLACES = np.array([[10.0, 11.0], [22.0, 10.0], [21.0, 22.0], [11.0, 21.0], [16.0, 16.0]])
Z = -3.75
NAMES = list("abcde")


def centres_of(camera, places=PLACES, noise_px=0.0):
    seen = project(camera, np.column_stack([places, np.full(len(places), Z)]))[0]
    return seen + np.random.default_rng(0).normal(0, noise_px, seen.shape)


def unposed(**more):
    return Camera(**(TRUE.model_dump() | {"position_mm": [0, 0, -1000], "rotation_deg": [0, 0, 0]} | more))


@pytest.mark.parametrize(
    "more",
    [{}, {"mirrored": False}, {"port": {"z_mm": -6.0, "index": 1.41}}, {"rotation_deg": [3.0, -2.0, -40.0]}],
    ids=["plain", "unmirrored", "port", "tilted"],
)
def test_exact_centres_give_the_pose_back(more):
    true = Camera(**(TRUE.model_dump() | more))
    tilt = true.rotation_deg[:2]
    pose = fit_pose(unposed(**(more | {"rotation_deg": [*tilt, 0.0]})), NAMES, PLACES, centres_of(true), Z)
    assert_allclose(pose.camera.position_mm, true.position_mm, atol=1e-4)
    assert_allclose(pose.camera.rotation_deg, true.rotation_deg, atol=1e-4)
    assert pose.rms_px < 1e-5


def test_repeated_fits_scatter_as_told_and_a_misplaced_press_is_left_out():
    # Standard deviations are those of repeated fits
    found, told = [], []
    for seed in range(60):
        seen = centres_of(TRUE) + np.random.default_rng(seed).normal(0, 0.3, (5, 2))
        pose = fit_pose(unposed(), NAMES, PLACES, seen, Z)
        found.append([*pose.camera.position_mm, pose.camera.rotation_deg[2]])
        told.append(pose.sd)
    # 60 repeats know a spread to 9 %, each reported one has 6 degrees of freedom
    assert_allclose(np.std(found, axis=0), np.sqrt(np.mean(np.square(told), axis=0)), rtol=0.25)

    # A press that is not where it should be is left out
    places = np.concatenate([PLACES, PLACES + [2.0, -1.0]])
    seen = centres_of(TRUE, places, 0.1)
    seen[3] += 12.0
    pose = fit_pose(unposed(), list("abcdefghij"), places, seen, Z)
    assert list(pose.left_out) == ["d"]
    assert_allclose(pose.camera.position_mm, TRUE.position_mm, atol=0.3)


def test_the_centre_is_that_of_the_press_and_not_of_all_that_moves():
    """Flow outwards and down, as of a pinhole: the part that goes down draws the centroid aside, away from the middle."""
    v, u = np.mgrid[:280, :300].astype(float)
    p, c, e = np.stack([u, v], -1), np.array([200.0, 120.0]), np.array([152.0, 138.0])
    bell = np.exp(-((p - c) ** 2).sum(-1, keepdims=True) / (2 * 35.0**2))
    flow = bell * (0.1 * (p - c) + 0.03 * (p - e))
    flow += np.random.default_rng(0).normal(0, 0.1, flow.shape)
    assert_allclose(centre_of_expansion(flow, e), c, atol=0.5)
    weight = (flow**2).sum(-1)
    assert np.hypot((weight * u).sum() / weight.sum() - 200, (weight * v).sum() / weight.sum() - 120) > 5
    assert centre_of_expansion(np.zeros((280, 300, 2)), e) is None


@pytest.mark.parametrize(
    ("places", "more", "words"),
    [
        (PLACES[[0, 1, 2, 2, 1]], {}, r"3 position\(s\), 4 are needed"),
        (np.column_stack([np.arange(5.0), 2 * np.arange(5.0)]) + 10, {}, r"nearly on a line \(0.000 as wide"),
        (PLACES, {"mirrored": False}, "move as mirrored ones do, but the camera has mirrored: false"),
    ],
    ids=["few", "line", "mirrored"],
)
def test_places_that_tell_no_pose_are_refused(places, more, words):
    with pytest.raises(CameraError, match=words):
        fit_pose(unposed(**more), NAMES, places, centres_of(TRUE, places), Z)


def test_the_plane_of_the_particles_is_the_middle_of_their_layers_and_has_the_scale(capsys):
    layers = [
        {"name": "gel", "thickness_mm": 4.5, "material": "soft", "particle_volume_fraction": 0.02},
        {"name": "skin", "thickness_mm": 1.5, "material": "soft"},
    ]
    soft = {"soft": {"parameters": {"mu_kPa": [10.0], "alpha": [2.0]}}}
    plan = {"grid": {"spacing_mm": 8, "margin_mm": 8}, "depths_mm": [0.5]}
    study = {"study": "small", "materials": soft, "sensor": {"layers": layers}, "plan": plan}
    assert particle_plane_mm(study_from(study).sensor) == pytest.approx(-3.75)
    camera = TRUE.model_copy(update={"distortion": None})
    print_scale(study_from(study), "day", Session(session="day", camera=camera))
    # 42.25 mm over 400 px
    assert "0.1056 mm/px in the image's middle, on the plane z = -3.75 mm" in capsys.readouterr().out
    bare = study_from(study | {"sensor": {"layers": [layers[1]]}})
    with pytest.raises(CameraError, match="give --plane-z-mm"):
        particle_plane_mm(bare.sensor)


def moved(X, place, depth):
    r = X[:, :2] - place
    bell = np.exp(-(r**2).sum(axis=1) / 32) * (X[:, 2] + 6) / 4.5
    return depth * np.concatenate([0.12 * r * bell[:, None], -0.7 * bell[:, None]], axis=1)


def test_a_session_tells_its_cameras_pose(tmp_path, capsys):
    folder, rng, imaging = tmp_path / "day", np.random.default_rng(0), VirtualImaging()
    (folder / "images").mkdir(parents=True)
    X = rng.uniform([1.5, 1.5, -6], [30.5, 30.5, -1.5], (4000, 3))
    (folder / "session.yaml").write_text("session: day\nforce: {acts_on: sensor, tared: true}\n")
    cv2.imwrite(str(folder / "reference.png"), expose(draw(TRUE, imaging, X, 0.35), imaging, rng))
    lines = [HEADER]
    for order, place in enumerate(PLACES):
        for phase, depth in (("zero", -1.0), ("dwell", 1.0)):
            name = f"p{order}_{phase}.png"
            shown = draw(TRUE, imaging, X + moved(X, place, max(depth, 0.0)), 0.35)
            cv2.imwrite(str(folder / "images" / name), expose(shown, imaging, rng))
            force = -0.3 * max(depth, 0.0) - 0.001 * order
            seconds = 10 * order + (5 if depth > 0 else 0)
            lines.append(
                f"p{order},,{order},{seconds},{phase},{place[0]},{place[1]},{depth},1,,0,0,{force},{name}"
            )
    (folder / "indentations.csv").write_text("\n".join(lines) + "\n")
    lens = {key: value for key, value in TRUE.model_dump(mode="json").items() if key != "position_mm"}
    write_yaml(tmp_path / "lens.yaml", {"camera": lens | {"rotation_deg": [0.0, 0.0, 0.0]}})
    out = tmp_path / "camera.yaml"
    command = ["camera-pose", str(folder), "--camera", str(tmp_path / "lens.yaml"), "--out", str(out)]
    assert main(command) == 1
    assert "give --study with their layer, or --plane-z-mm" in capsys.readouterr().err
    assert main([*command, "--plane-z-mm", str(Z)]) == 0
    printed = capsys.readouterr().out
    for words in (
        "presses    5, ",
        "turn about z",
        "held       turns about x and y",
        "mm/px in the image's middle",
    ):
        assert words in printed
    found = load_camera(out)
    # what docs/cameras.md says of five presses: a tenth of a mm aside, 5 % of the distance, half a degree
    assert_allclose(found.position_mm[:2], TRUE.position_mm[:2], atol=0.15)
    assert_allclose(found.position_mm[2], -46, atol=0.05 * 42)
    assert_allclose(found.rotation_deg[2], 2.0, atol=0.7)
