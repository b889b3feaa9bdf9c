"""Images of one camera as another would have taken them, and what a model's frames are made of."""

import json

import cv2
import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from session_folder import write_session

from gelforge.config import Camera, ConfigError, Features, Session, VirtualImaging, load_camera, write_yaml
from gelforge.recording.features import FlowFeatures, features_digest, session_features
from gelforge.recording.imaging.flow import ImageError
from gelforge.recording.optics.camera import project
from gelforge.recording.optics.remap import Remapper, differences, picture_of, places_in, remap_to, view_of
from gelforge.recording.readings import read_recording
from gelforge.virtual_lab.imaging import draw

KEYS = {"width_px": 400, "height_px": 400, "focal_px": 545.0, "centre_px": [199.5, 199.5]}
VIEW = Camera(**KEYS, position_mm=[16, 16, -46])
OTHER = Camera(
    **(KEYS | {"focal_px": 545 * 1.01, "centre_px": [201.5, 198.0]}),
    position_mm=[16, 16, -46],
    rotation_deg=[0.5, -0.3, 0.5],
    distortion={"coefficients": [-0.2, 0.05, 1e-3, 5e-4]},
)
ASIDE = Camera(**(OTHER.model_dump() | {"position_mm": [16.5, 16, -46]}))
Z = -3.75


def test_a_remapped_image_is_what_the_view_draws():
    # Points of the plane land where the view has them
    points = np.random.default_rng(0).uniform([6, 6, Z], [26, 26, Z], (200, 3))
    wanted, _ = project(VIEW, points)
    # the map at the view's pixel of a point is the other camera's pixel of it, linear between whole pixels
    places = places_in(ASIDE, VIEW, Z).astype(np.float32)
    found = cv2.remap(places, *wanted.astype(np.float32).T[:, :, None], cv2.INTER_LINEAR)[:, 0]
    assert_allclose(found, project(ASIDE, points)[0], atol=0.02)  # remap reads at 1/32 px

    # A remapped image is what the view draws
    grid = np.stack(np.meshgrid(np.arange(3, 30, 2.0), np.arange(3, 30, 2.0)), -1).reshape(-1, 2)
    aside = np.random.default_rng(1).uniform(-0.5, 0.5, grid.shape)  # no ball before another
    particles = np.column_stack([grid + aside, np.full(len(grid), Z)])
    unseen = [
        [-90.0, 16.0, -30.0],
        [-200.0, 16.0, 40.0],
    ]  # balls are shaded by where they lie in the range of distances
    particles = np.concatenate([particles, unseen])
    imaging = VirtualImaging(noise_grey=0.0, blur_px=1.5)
    wanted = draw(VIEW, imaging, particles, 0.6)
    found = Remapper(OTHER, VIEW, Z)(draw(OTHER, imaging, particles, 0.6))
    inner = (slice(20, -20), slice(20, -20))
    as_taken = draw(OTHER, imaging, particles, 0.6)
    off = np.abs(found - wanted)[inner].mean()
    assert off < 0.1 * np.abs(as_taken - wanted)[inner].mean()  # measured: a fortieth, of interpolation

    # A view that the camera does not see is refused
    wide = Camera(**(KEYS | {"focal_px": 400.0}), position_mm=[16, 16, -46])
    with pytest.raises(ImageError, match=r"sees 5\d% of the reference view at z = -3.75 mm, limit 90%"):
        Remapper(OTHER, wide, Z)
    with pytest.raises(ImageError, match="image of 300 x 400 px, but its camera is described with 400 x 400"):
        Remapper(OTHER, VIEW, Z)(np.zeros((400, 300), np.uint8))


@pytest.mark.parametrize("z", [-6.0, -1.5])
def test_only_pinholes_that_stand_apart_have_parallax(z):
    """Off the plane: nothing for a camera in the same place, f s h / (Z Z') px for one that stands s aside."""
    away = places_in(OTHER, VIEW, z) - places_in(OTHER, VIEW, Z)
    assert np.abs(away).max() < 1e-9
    straight = Camera(**KEYS, position_mm=[16.5, 16, -46])
    away = places_in(straight, VIEW, z) - places_in(straight, VIEW, Z)
    assert_allclose(away[..., 0], -545 * 0.5 * (1 / (z + 46) - 1 / (Z + 46)), rtol=1e-9)


def session_with(**more):
    return Session(session="day", camera=OTHER, **more)


def test_a_session_is_cropped_or_remapped_and_its_features_are_of_the_view(tmp_path):
    # A session is cropped or remapped never both
    remap = {"plane_z_mm": Z, "view": VIEW.model_dump()}
    with pytest.raises(ValueError, match="crop_px .* and remap are both given"):
        session_with(crop_px=[0, 0, 200, 200], remap=remap)
    with pytest.raises(ValueError, match="remap needs the camera"):
        Session(session="day", remap=remap)
    image = np.random.default_rng(0).integers(0, 255, (400, 400)).astype(np.uint8)
    assert_array_equal(picture_of(session_with(crop_px=[3, 4, 200, 100]))(image), image[4:104, 3:203])
    assert_array_equal(
        picture_of(session_with(remap=remap))(image),
        Remapper(OTHER, VIEW, Z)(image),
    )
    assert view_of(session_with(remap=remap))["camera"] == VIEW.model_dump(mode="json")
    assert view_of(session_with())["camera"] == OTHER.model_dump(mode="json")
    assert "plane_z_mm" not in view_of(session_with()) and "remap" not in session_with().model_dump()

    # Features of a remapped session are those of its view
    camera = {"width_px": 140, "height_px": 120, "focal_px": 200.0, "centre_px": [69.5, 59.5]}
    camera |= {"position_mm": [16, 16, -46], "distortion": {"coefficients": [-0.3, 0.1, 0, 0]}}
    view = camera | {"width_px": 110, "height_px": 100, "centre_px": [55.0, 50.0], "distortion": None}
    extra = f"camera: {json.dumps(camera)}\nremap: {{plane_z_mm: -3.0, view: {json.dumps(view)}}}\n"
    folder = write_session(tmp_path / "day", images=True, extra=extra)
    recording, settings = read_recording(folder), Features(regions=8)
    session_features(recording, settings, tmp_path / "f.h5")
    picture = Remapper(Camera(**camera), Camera(**view), -3.0)
    extract = FlowFeatures(picture(cv2.imread(str(folder / "reference.png"), 0)), settings)
    with h5py.File(tmp_path / "f.h5") as file:
        image = cv2.imread(str(folder / "images" / file["image"][1].decode()), 0)
        assert_array_equal(file["feature"][1], extract(picture(image)))
        stored = json.loads(file.attrs["view"])
    assert stored["image_px"] == [110, 100] and stored["plane_z_mm"] == -3.0
    moved = recording.session.model_copy(
        update={"remap": recording.session.remap.model_copy(update={"plane_z_mm": -2.0})}
    )
    assert features_digest(folder, moved, settings) != features_digest(folder, recording.session, settings)


def views(**more):
    return {"day": {"image_px": [400, 400], "crop_px": None, "camera": VIEW.model_dump(mode="json")} | more}


def test_frames_and_cameras_of_another_view_become_the_models(tmp_path):
    # Frames of another camera become the models
    remapper = remap_to(views(plane_z_mm=Z), OTHER, None, None)
    image = np.random.default_rng(0).integers(0, 255, (400, 400)).astype(np.uint8)
    assert_array_equal(remapper(image), Remapper(OTHER, VIEW, Z)(image))
    cropped = remap_to(views(crop_px=[30, 40, 200, 100]), OTHER, Z, None)  # first remapped, then cropped
    assert_array_equal(cropped(image), remapper(image)[40:140, 30:230])
    assert remap_to(views(plane_z_mm=Z), VIEW, None, None) is None  # in the view already
    assert remap_to(views(), None, None, None) is None

    # A camera comes from its own file or from a sessions
    write_yaml(tmp_path / "camera.yaml", OTHER)
    write_yaml(tmp_path / "session.yaml", session_with())
    assert load_camera(tmp_path / "camera.yaml") == load_camera(tmp_path / "session.yaml") == OTHER
    write_yaml(tmp_path / "lens.yaml", {"camera": KEYS})
    with pytest.raises(ConfigError, match=r"lens.yaml: camera: no position_mm: a calibration finds no pose"):
        load_camera(tmp_path / "lens.yaml")
    assert load_camera(tmp_path / "lens.yaml", position_mm=[16, 16, -46]) == VIEW
    assert differences(OTHER, OTHER) == ""


@pytest.mark.parametrize(
    ("known", "camera", "z", "crop", "words"),
    [
        (views(plane_z_mm=Z), None, None, None, r"remapped to a reference view \(session day\); give --camera"),
        (views(), OTHER, None, None, r"\(session day\): focal_px 550.45 instead of 545.0, .*--plane-z-mm"),
        (views(camera=None), OTHER, Z, None, "knows no camera"),
        (views() | {"b": views(camera=ASIDE.model_dump())["day"]}, OTHER, Z, None, "2 sessions with several"),
        (views(plane_z_mm=Z), OTHER, None, [0, 0, 9, 9], r"leave out --crop"),
        (views(), Camera(**(KEYS | {"focal_px": 900.0}), position_mm=[16, 16, -46]), Z, None,
         r"focal_px 900.0 instead of 545.0; the camera sees \d+%"),
    ],
)  # fmt: skip
def test_frames_that_cannot_be_made_the_models_are_refused(known, camera, z, crop, words):
    with pytest.raises(ImageError, match=words):
        remap_to(known, camera, z, crop)
