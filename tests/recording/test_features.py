"""Features exactly as defined in docs/file-formats.md: closed forms, a NumPy twin, and the file of a session."""

import tracemalloc

import cv2
import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from session_folder import write_session

from gelforge.config import Features
from gelforge.recording.features import FlowFeatures, flow_features, session_features
from gelforge.recording.imaging.flow import ImageError
from gelforge.recording.readings import read_recording


def shares(pixels, regions):
    """Return the share (regions, pixels) of each pixel in the equal regions of an axis, by overlap."""
    edges = np.linspace(0, pixels, regions + 1)
    left = np.arange(pixels)
    overlap = np.minimum(edges[1:, None], left + 1) - np.maximum(edges[:-1, None], left)
    return np.clip(overlap, 0, None) * regions / pixels


def twin(flow, regions, moved_px):
    """Return the features by two matrix products per term, in float64."""
    u, v = flow[..., 0].astype(float), flow[..., 1].astype(float)
    rows, columns = shares(flow.shape[0], regions), shares(flow.shape[1], regions)
    magnitude, angle = np.hypot(u, v), np.arctan2(v, u)
    moved = magnitude > moved_px
    mean, cosine, sine = (
        rows @ term @ columns.T for term in (magnitude, np.cos(angle) * moved, np.sin(angle) * moved)
    )
    return np.concatenate([mean.ravel(), np.arctan2(sine, cosine).ravel()])


@given(
    height=st.integers(8, 40),
    width=st.integers(8, 40),
    regions=st.integers(1, 8),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None)
def test_kernel_equals_its_numpy_twin_for_any_size(height, width, regions, seed):
    rng = np.random.default_rng(seed)
    flow = rng.normal(0, 0.2, (height, width, 2)).astype(np.float32) + rng.normal(0, 1, 2).astype(np.float32)
    found, wanted = flow_features(flow, regions, 0.05), twin(flow, regions, 0.05)
    m = regions**2
    assert_allclose(found[:m], wanted[:m], rtol=1e-5)  # sums of up to 40 float32
    turn = np.angle(np.exp(1j * (found[m:] - wanted[m:])))  # pi and -pi are one direction
    # directions of opposed pixels may cancel to rounding; they have none to compare
    rows, columns = shares(height, regions), shares(width, regions)
    unit = flow / np.linalg.norm(flow, axis=-1, keepdims=True)
    length = np.hypot(*(rows @ unit[..., k] @ columns.T for k in (0, 1))).ravel()
    assert_allclose(turn[length > 0.05], 0, atol=1e-4)


def uniform(u, v, size=(40, 60)):
    return np.broadcast_to(np.float32([u, v]), (*size, 2)).copy()


@pytest.mark.parametrize(
    ("u", "v", "direction"),
    [
        (2, 0, 0),
        (0, 2, np.pi / 2),
        (0, -2, -np.pi / 2),
        (-2, 0, np.pi),
        (-2, -1e-20, np.pi),
        (1, 1, np.pi / 4),
    ],
)
def test_uniform_flow_has_its_length_and_direction_with_v_downwards(u, v, direction):
    features = flow_features(uniform(u, v), 4, 0.05)
    assert features.dtype == np.float32
    assert_allclose(features[:16], np.hypot(u, v), rtol=1e-6)
    assert_allclose(features[16:], direction, atol=1e-6)  # pi, never -pi


def test_regions_share_the_flow_by_area_and_direction():
    flow = uniform(0, 0, (40, 60))
    flow[0:20, 30:45] = [3, 0]  # of 2 x 4 regions of 20 x 15 px in a 4 x 4 layout: rows 0 and 1, column 2
    features = flow_features(flow, 4, 0.05)
    wanted = np.zeros((4, 4))
    wanted[:2, 2] = 3
    assert_allclose(features[:16].reshape(4, 4), wanted)

    # A pixel on a border counts by area
    flow = uniform(0, 0, (3, 3))
    flow[1, 1] = [9, 0]  # a quarter of the middle pixel lies in each of 2 x 2 regions of 1.5 x 1.5 px
    assert_allclose(flow_features(flow, 2, 0.05)[:4], 9 * 0.25 / 2.25)
    flow[1, 1] = 0
    flow[0, 1] = [0, 9]  # half of the top middle pixel in each of the upper regions
    assert_allclose(flow_features(flow, 2, 0.05), [2, 2, 0, 0, np.pi / 2, np.pi / 2, 0, 0], rtol=1e-6)

    # Pixels that hardly moved have length but no say in direction
    flow = uniform(0.04, 0, (4, 4))
    assert_allclose(flow_features(flow, 1, 0.05), [0.04, 0], rtol=1e-6)
    flow[0, 0] = [0, -1]
    assert_allclose(flow_features(flow, 1, 0.05)[1], -np.pi / 2, rtol=1e-6)

    # Direction is a mean of unit vectors
    flow = uniform(1, 0, (2, 2))
    flow[0] = [0, 100]  # long, but with one vote per pixel
    assert_allclose(flow_features(flow, 1, 0.05)[1], np.pi / 4, rtol=1e-6)


@pytest.mark.parametrize(
    ("size", "regions", "message"),
    [((96, 120), 100, "use fewer regions"), ((95, 400), 8, "smaller than 96 px")],
)
def test_images_too_small_are_refused(size, regions, message):
    with pytest.raises(ImageError, match=message):
        FlowFeatures(np.zeros(size, np.uint8), Features(regions=regions))


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "fine", "full", "medium"])
def test_flow_does_not_depend_on_the_images_before(preset):
    rng = np.random.default_rng(0)
    images = [cv2.GaussianBlur(rng.integers(0, 255, (96, 96)).astype(np.uint8), (0, 0), 2) for _ in range(3)]
    extract = FlowFeatures(images[0], Features(regions=8, flow_preset=preset))
    after_others = [extract(image) for image in images][2]
    assert_array_equal(
        after_others, FlowFeatures(images[0], Features(regions=8, flow_preset=preset))(images[2])
    )


# ------------------------------------------------------------------------------------------ files of a session
SETTINGS = Features(regions=8)


def test_features_of_a_session_and_of_its_crop(tmp_path):
    # Features of a session
    folder = write_session(tmp_path / "day", images=True)
    recording = read_recording(folder)
    assert (
        session_features(recording, SETTINGS, tmp_path / "f.h5") == 6
    )  # two presses: one zero, two dwell images
    with h5py.File(tmp_path / "f.h5") as file:
        assert file.attrs["format"] == "gelforge-features-1"
        assert not file.attrs["synthetic"]
        assert [name.decode() for name in file["press"]] == ["a"] * 3 + ["b"] * 3
        assert [name.decode() for name in file["phase"]] == ["zero", "dwell", "dwell"] * 2
        assert list(file["image_index"]) == [0, 1, 2, 0, 1, 2]
        assert_allclose(file["depth_mm"], [0, 0.5, 0.5, 0, 1, 1])
        assert file["feature"].shape == (6, 128)
        assert file["feature"].dtype == np.float32
        extract = FlowFeatures(cv2.imread(str(folder / "reference.png"), 0), SETTINGS)
        image = cv2.imread(str(folder / "images" / file["image"][4].decode()), 0)
        assert_array_equal(file["feature"][4], extract(image))
        assert all("units" in data.attrs and "description" in data.attrs for data in file.values())

    # Crop selects the part of the image
    cropped = tmp_path / "cropped"
    folder = write_session(cropped / "day", images=True, extra="crop_px: [10, 20, 110, 98]\n")
    session_features(read_recording(folder), SETTINGS, cropped / "f.h5")
    extract = FlowFeatures(cv2.imread(str(folder / "reference.png"), 0)[20:118, 10:120].copy(), SETTINGS)
    with h5py.File(cropped / "f.h5") as file:
        image = cv2.imread(str(folder / "images" / file["image"][1].decode()), 0)[20:118, 10:120].copy()
        assert_array_equal(file["feature"][1], extract(image))


def test_features_follow_the_settings_and_not_the_threads(tmp_path):
    recording = read_recording(write_session(tmp_path / "day", images=True))
    for workers in (1, 3):
        session_features(recording, SETTINGS, tmp_path / f"{workers}.h5", workers=workers)
    assert (tmp_path / "1.h5").read_bytes() == (tmp_path / "3.h5").read_bytes()

    # Other settings have another digest
    digests = set()
    for moved in (0.05, 0.1):
        session_features(recording, Features(regions=8, moved_px=moved), tmp_path / "f.h5")
        with h5py.File(tmp_path / "f.h5") as file:
            digests.add(file.attrs["digest"])
    assert len(digests) == 2


def test_a_session_that_gives_no_features_is_refused(tmp_path):
    # An image that vanishes is named and leaves no file
    folder = write_session(tmp_path / "day", images=True)
    recording = read_recording(folder)
    (folder / "images" / "b_1.png").unlink()
    with pytest.raises(ImageError, match=r"b_1\.png: the image is missing"):
        session_features(recording, SETTINGS, tmp_path / "f.h5")
    assert not list(tmp_path.glob("*f*h5*"))

    # A force only session has no features
    bare = tmp_path / "bare"
    with pytest.raises(ImageError, match="force-only"):
        session_features(read_recording(write_session(bare / "day")), SETTINGS, bare / "f.h5")


def test_memory_does_not_grow_with_the_session(tmp_path):
    peaks = []
    for presses in (20, 80):
        folder = write_session(tmp_path / f"s{presses}", images=True, presses=presses)
        recording = read_recording(folder)
        tracemalloc.start()
        session_features(recording, Features(regions=40), tmp_path / "f.h5")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # 180 more rows of 3200 features would be 2.3 MB; the rows' table alone grows by a few hundred bytes each
    assert peaks[1] - peaks[0] < 1e6
