"""Images reduced before their flow is searched: where pixels lie, and flow that stays in pixels of the image before."""

import json

import cv2
import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from session_folder import write_session

from gelforge.config import Camera, Features, Session
from gelforge.recording.features import FlowFeatures, features_digest, flow_features, session_features
from gelforge.recording.imaging.flow import ImageError, reduced
from gelforge.recording.optics.remap import Remapper, picture_of, remap_to, view_of
from gelforge.recording.readings import read_recording

SCALES = [1.0, 0.9, 0.8, 0.6, 0.5]
SIZE = (391, 403)  # no scale but 1 divides it


def speckle(shift=(0.0, 0.0), size=SIZE):
    """Return speckle (H, W) uint8 moved by a shift (right, down) [px]."""
    noise = np.random.default_rng(0).normal(0, 1, (size[0] + 20, size[1] + 20)).astype(np.float32)
    spots = 128 + 250 * cv2.GaussianBlur(noise, (0, 0), 2.5)
    place = np.float32([[1, 0, shift[0] - 10], [0, 1, shift[1] - 10]])
    moved = cv2.warpAffine(spots, place, size[::-1], flags=cv2.INTER_CUBIC)
    return moved.clip(0, 255).round().astype(np.uint8)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shift", [(3.0, -1.5), (-6.0, 0.0), (2.5, 4.0)])
def test_a_uniform_shift_is_found_at_each_scale_in_pixels_of_the_image_before(scale, shift):
    settings = Features(regions=10, image_scale=scale)
    found = FlowFeatures(reduced(speckle(), scale), settings)(reduced(speckle(shift), scale))
    inner = (slice(None), slice(1, -1), slice(1, -1))  # what comes in at the border has no origin
    magnitude, direction = found.reshape(2, 10, 10)[inner]
    # the search errs by 1 % here; the nearest other scale would be 11 % off
    assert magnitude.mean() == pytest.approx(np.hypot(*shift), rel=0.03)
    turn = np.exp(1j * (direction - np.arctan2(shift[1], shift[0])))
    assert abs(np.angle(turn.mean())) < 0.03


@pytest.mark.parametrize("scale", SCALES)
def test_pixels_that_hardly_moved_are_told_in_pixels_of_the_image_before(scale):
    for length, votes in ((0.048, False), (0.052, True)):
        flow = np.broadcast_to(np.float32([0, length * scale]), (20, 20, 2)).copy()
        magnitude, direction = flow_features(flow, 1, 0.05, scale)
        assert magnitude == pytest.approx(length, rel=1e-5)
        assert direction == pytest.approx(np.pi / 2 if votes else 0)


@pytest.mark.parametrize("scale", SCALES)
def test_a_reduced_pixel_shows_the_middle_of_the_area_that_it_covers(scale):
    """It lies at (i + 0.5) / scale - 0.5, whatever the rounding; a ramp has the value of the place."""
    u, v = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    found = reduced((u + 2 * v).astype(np.float32), scale)
    assert found.shape == (round(scale * SIZE[0]), round(scale * SIZE[1]))
    u, v = ((np.arange(n) + 0.5) / scale - 0.5 for n in found.shape[::-1])
    wanted = u + 2 * v[:, None]
    assert_allclose(found[:-1, :-1], wanted[:-1, :-1], atol=1e-3)  # the last may reach over the border


@pytest.mark.parametrize("parts", [2, 4])
def test_half_and_less_of_the_size_leave_no_pixel_out(parts):
    image = np.random.default_rng(0).integers(0, 255, (20, 40)).astype(np.uint8)
    means = image.reshape(20 // parts, parts, 40 // parts, parts).mean(axis=(1, 3))
    assert_allclose(reduced(image, 1 / parts), means, atol=0.5)
    assert reduced(image, 1.0) is image


CAMERA = Camera(
    width_px=400, height_px=400, focal_px=545.0, centre_px=[199.5, 199.5], position_mm=[16, 16, -46]
)
OTHER = Camera(**CAMERA.model_dump() | {"rotation_deg": [0.0, 0.0, 90.0]})  # whole pixels, turned
CROPPED = [31, 40, 301, 203]


@pytest.mark.parametrize("crop_px", [None, CROPPED])
@pytest.mark.parametrize("scale", SCALES)
def test_remapping_and_reducing_in_one_step_shows_what_both_show_one_by_one(scale, crop_px):
    u, v = np.meshgrid(*[np.arange(400, dtype=np.float32)] * 2)
    ramp = u + 2 * v
    one = Remapper(OTHER, CAMERA, -3.75, crop_px, scale)(ramp)
    two = reduced(Remapper(OTHER, CAMERA, -3.75, crop_px)(ramp), scale)
    assert one.shape == two.shape
    # images are read at 1 / 32 px, off by 1 / 64 px at most along each axis
    assert_allclose(one[1:-1, 1:-1], two[1:-1, 1:-1], atol=0.05)


def test_what_a_model_remaps_is_reduced_but_not_below_its_limit():
    # What a model remaps is reduced too
    views = {"day": view_of(Session(session="day", camera=CAMERA), 0.8)}
    assert views["day"]["image_px"] == [400, 400] and views["day"]["image_scale"] == 0.8
    image = speckle(size=(400, 400))
    assert_array_equal(
        remap_to(views, OTHER, -3.75, None, 0.8)(image), Remapper(OTHER, CAMERA, -3.75, scale=0.8)(image)
    )

    # An image too small when reduced is refused
    with pytest.raises(
        ImageError, match="image of 120 x 90 px is smaller than 96 px; .* features.image_scale"
    ):
        FlowFeatures(reduced(np.zeros((180, 240), np.uint8), 0.5), Features(image_scale=0.5))


def test_features_at_a_scale_are_other_features_and_at_full_size_the_same(tmp_path):
    # Features of a session at a scale
    folder = write_session(tmp_path / "day", images=True, extra="crop_px: [2, 0, 135, 120]\n")
    recording = read_recording(folder)
    whole, small = (Features(regions=8, image_scale=scale) for scale in (1.0, 0.85))
    for settings in (whole, small):
        session_features(recording, settings, tmp_path / f"{settings.image_scale}.h5")
    with h5py.File(tmp_path / "1.0.h5") as full, h5py.File(tmp_path / "0.85.h5") as file:
        name = file["image"][5].decode()
        picture = picture_of(recording.session, 0.85)
        reference, image = (
            picture(cv2.imread(str(folder / path), 0)) for path in ("reference.png", f"images/{name}")
        )
        assert image.shape == (102, 115)
        assert_array_equal(file["feature"][5], FlowFeatures(reference, small)(image))
        # the images' own motion, the same in both but for the search's error on so few pixels
        assert_allclose(file["flow_px"][1:], full["flow_px"][1:], rtol=0.1, atol=0.02)
        assert json.loads(file.attrs["view"])["image_scale"] == 0.85
        assert "image_scale" not in json.loads(full.attrs["view"])
    digests = [features_digest(folder, recording.session, settings) for settings in (whole, small)]
    assert digests[0] != digests[1]

    # Images as large as recorded keep the digests of before
    assert Features(image_scale=1.0).model_dump() == {
        "regions": 40,
        "flow_preset": "fine",
        "moved_px": 0.05,
    }


def test_full_on_half_the_image_finds_what_fine_finds_on_the_whole():
    """`fine` searches an image of half the size too, and spreads its flow over the whole one afterwards."""
    v, u = np.indices((400, 480)).astype(np.float32)
    bump = 6 * np.exp(-((u - 240) ** 2 + (v - 200) ** 2) / 80**2)
    image = speckle(size=(400, 480))
    moved = cv2.remap(image, u - bump, v + 0.5 * bump, cv2.INTER_CUBIC)
    found = []
    for scale, preset in ((1.0, "fine"), (0.5, "full"), (0.5, "fine")):
        extract = FlowFeatures(reduced(image, scale), Features(flow_preset=preset, image_scale=scale))
        found.append(extract(reduced(moved, scale))[:1600].reshape(40, 40)[1:-1, 1:-1])
    # apart by how flow is spread and averaged; `fine` on half of the image is another search, on a quarter
    off = [np.abs(one - found[0]).mean() for one in found[1:]]
    assert off[0] < 0.01 * found[0].max()
    assert off[1] > 3 * off[0]
