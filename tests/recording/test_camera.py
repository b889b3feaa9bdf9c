"""The camera against closed forms: similar triangles, mirror, turns, and the way back."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gelforge.config import Camera
from gelforge.recording.optics.camera import CameraError, mm_per_px_at, project, px_per_mm, unproject

PINHOLE = {
    "width_px": 640,
    "height_px": 480,
    "focal_px": 400.0,
    "centre_px": [319.5, 239.5],
    "position_mm": [16.0, 16.0, -40.0],
}
coordinate = st.floats(-20, 20)


def test_a_pinhole_projects_by_similar_triangles():
    # 2 mm to the right and 1 mm up at a distance of 40 mm: 400 * 2 / 40 = 20 px and 10 px
    pixels, distance = project(Camera(**PINHOLE, mirrored=True), [[16, 16, 0], [18, 17, 0], [18, 17, -20]])
    assert_allclose(pixels, [[319.5, 239.5], [339.5, 229.5], [359.5, 219.5]], rtol=1e-14)
    assert_allclose(distance, [40, 40, 20])

    # Unmirrored image is what an eye below sees
    # Looking up with y upwards in the image, x runs to the left: the image's right, down and the view are right-handed.
    camera = Camera(**PINHOLE, mirrored=False)
    pixels, _ = project(camera, [[18, 17, 0]])
    assert_allclose(pixels, [[299.5, 229.5]])

    # A turn about z turns the image
    camera = Camera(**PINHOLE, rotation_deg=[0, 0, 90])
    # the camera's right now points along y: a point at +y appears to the right
    pixels, _ = project(camera, [[16, 18, 0]])
    assert_allclose(pixels, [[339.5, 239.5]], atol=1e-9)

    # A tilted camera sees the point on its axis in the middle
    tilt = np.deg2rad(10)
    camera = Camera(**PINHOLE, rotation_deg=[0, 10, 0])  # about y: the view turns towards +x
    on_axis = np.array([16, 16, -40]) + 40 * np.array([np.sin(tilt), 0, np.cos(tilt)])
    pixels, distance = project(camera, on_axis)
    assert_allclose(pixels, [319.5, 239.5], atol=1e-9)
    assert_allclose(distance, 40)

    # A flat scale ignores depth
    camera = Camera(
        width_px=100, height_px=100, mm_per_px=0.1, centre_px=[50, 50], position_mm=[16, 16, 0], mirrored=True
    )
    pixels, _ = project(camera, [[17, 16, 0], [17, 16, -6]])
    assert_allclose(pixels, [[60, 50], [60, 50]])

    # Scale at a plane
    assert_allclose(mm_per_px_at(Camera(**PINHOLE), -4.0), 36 / 400)
    assert_allclose(px_per_mm(Camera(**PINHOLE), [[20.0, 11.0, -4.0]]), 400 / 36, rtol=1e-9)


@given(
    xy=st.tuples(coordinate, coordinate),
    z=st.floats(-10, 0),
    turns=st.tuples(*[st.floats(-20, 20)] * 3),
    mirrored=st.booleans(),
    flat=st.booleans(),
)
def test_there_and_back(xy, z, turns, mirrored, flat):
    scale = {"mm_per_px": 0.1, "focal_px": None} if flat else {}
    camera = Camera(**(PINHOLE | scale), rotation_deg=list(turns), mirrored=mirrored)
    point = np.array([*xy, z])
    pixels, _ = project(camera, point)
    assert_allclose(unproject(camera, pixels, z), point, atol=1e-9)  # rounding of 40 mm over cos 30 deg


# Lenses with what a wide-angle board camera has; fisheye as its calibration would give it.
LENSES = {
    "pinhole": {"model": "pinhole", "coefficients": [-0.28, 0.09, 1e-3, -8e-4, -0.01]},
    "fisheye": {"model": "fisheye", "coefficients": [-0.02, 0.004, -0.003, 0.001]},
}
PORT = {"z_mm": -10.0, "index": 1.41, "pane_mm": 4.0, "pane_index": 1.49}
K = np.array([[400.0, 0, 321.0], [0, 404.0, 236.0], [0, 0, 1]])
LENSED = PINHOLE | {"centre_px": [321.0, 236.0], "focal_y_px": 404.0}


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_lenses_are_opencvs(name, mirrored):
    """OpenCV is asked for what lies along the image's own axes: the lens knows nothing of who flipped the image."""
    camera = Camera(**LENSED, distortion=LENSES[name], mirrored=mirrored)
    points = np.random.default_rng(0).uniform([4, 4, -6], [28, 28, 0], (50, 3))
    local = (points - camera.position_mm) * [1 if mirrored else -1, -1, 1]
    k = np.array(LENSES[name]["coefficients"])
    if name == "pinhole":
        seen, _ = cv2.projectPoints(local, np.zeros(3), np.zeros(3), K, k)
    else:
        seen, _ = cv2.fisheye.projectPoints(local[:, None], np.zeros(3), np.zeros(3), K, k)
    assert_allclose(project(camera, points)[0], seen.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("lens", [None, *LENSES])
@pytest.mark.parametrize("port", [None, PORT], ids=["no port", "port"])
def test_every_pixel_there_and_back(lens, port):
    camera = Camera(**LENSED, rotation_deg=[2, -3, 5], distortion=LENSES.get(lens), port=port)
    pixels = np.stack(np.meshgrid(np.arange(0, 640, 21.3), np.arange(0, 480, 19.9)), -1)
    there = unproject(camera, pixels, -2.0)
    assert_allclose(there[..., 2], -2.0)
    assert_allclose(project(camera, there)[0], pixels, atol=1e-9)  # Newton ends at rounding


def test_a_mirrored_and_an_old_description_are_what_they_were():
    # A mirrored image of a lens has the mirrored description. Flipping an image flips its principal point and the
    # sign of p2; nothing else of the lens
    k = LENSES["pinhole"]["coefficients"]
    seen = Camera(**LENSED, mirrored=False, distortion=LENSES["pinhole"])
    flipped_lens = {"model": "pinhole", "coefficients": [k[0], k[1], k[2], -k[3], k[4]]}
    flipped = Camera(**(LENSED | {"centre_px": [639 - 321.0, 236.0]}), mirrored=True, distortion=flipped_lens)
    points = [[10, 12, 0], [20, 9, -3], [16, 25, -1]]
    assert_allclose(project(flipped, points)[0], project(seen, points)[0] * [-1, 1] + [639, 0], atol=1e-9)

    # An old description is written as it was. Digests of sessions and views are of what is written
    assert set(Camera(**PINHOLE).model_dump()) == {
        *PINHOLE, "mm_per_px", "rotation_deg", "mirrored"
    }  # fmt: skip


def test_rays_through_a_port_obey_snells_law():
    """Angles are measured on the ray's three straight parts, by unprojecting to two heights in each."""
    camera = Camera(**PINHOLE, port=PORT)
    pixel = [[600.0, 20.0]]
    heights = {1.0: (-20.0, -10.0), 1.49: (-9.0, -6.0), 1.41: (-5.0, 0.0)}
    kept = []
    for index, (low, high) in heights.items():
        way = unproject(camera, pixel, high)[0] - unproject(camera, pixel, low)[0]
        kept.append(index * np.hypot(way[0], way[1]) / np.linalg.norm(way))
    assert kept[0] > 0.4  # 27 degrees: not a ray along the axis
    assert_allclose(kept, kept[0], rtol=1e-12)

    # A port of index 1 is none and gel seems nearer by its index
    points = np.random.default_rng(1).uniform([4, 4, -6], [28, 28, 0], (50, 3))
    air = Camera(**PINHOLE, port=PORT | {"index": 1.0, "pane_index": 1.0})
    assert_allclose(project(air, points)[0], project(Camera(**PINHOLE), points)[0], atol=1e-10)
    gel = Camera(**PINHOLE, port={"z_mm": -10.0, "index": 1.41})
    # near the axis: 30 mm of air and 10 mm of gel seem to be 30 + 10 / 1.41 mm
    near = project(gel, [[16.001, 16, 0]])[0] - gel.centre_px
    assert_allclose(near[0, 0], 400 * 0.001 / (30 + 10 / 1.41), rtol=1e-6)


def test_points_that_no_pixel_shows_stay_outside_or_are_named():
    # Far points stay outside where the polynomial turns back
    folding = Camera(**PINHOLE, distortion={"coefficients": [-0.3, 0.0, 0.0, 0.0]})
    turn = np.sqrt(1 / 0.9)  # 1 - 3 0.3 r^2 = 0
    radius = turn * np.array([0.9, 0.99, 1.01, 1.5, 4.0])
    seen = project(folding, np.stack([16 + 40 * radius, 0 * radius + 16, 0 * radius], -1))[0][:, 0]
    assert np.all(np.diff(seen) > 0)
    with pytest.raises(CameraError, match=r"shows no ray at 0.949 focal.*turns back at 1.05"):
        unproject(folding, [[319.5 + 400 * 0.949, 239.5]], 0.0)

    # A point behind the camera is named
    with pytest.raises(CameraError, match=r"5 mm behind the camera"):
        project(Camera(**PINHOLE), [[16, 16, -45]])


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"distortion": {"coefficients": [0.1, 0.2]}}, "2 coefficients; model pinhole has k1, k2, p1, p2"),
        ({"port": {"z_mm": -45.0, "index": 1.4}}, "is not below port.z_mm -45"),
        ({"focal_px": None, "mm_per_px": 0.1, "port": {"z_mm": -6.0, "index": 1.4}}, "port belongs to a pinhole"),
({"focal_px": None}, "not both or neither"),
({"mm_per_px": 0.1}, "not both or neither"),
    ],
)  # fmt: skip
def test_lenses_and_ports_that_cannot_be_are_refused(keys, words):
    with pytest.raises(ValueError, match=words):
        Camera(**(PINHOLE | keys))


@pytest.mark.parametrize("wrong", [{"position_mm": [16.0, 16.0, 46.0]}, {"rotation_deg": [180.0, 0.0, 0.0]}])
def test_a_plane_behind_the_camera_is_refused(wrong):
    """Through the pinhole the picture would be turned about, and nothing would tell."""
    seen = {"width_px": 200, "height_px": 200, "focal_px": 400.0, "centre_px": [99.5, 99.5]}
    camera = Camera.model_validate(seen | {"position_mm": [16.0, 16.0, -46.0]} | wrong)
    with pytest.raises(CameraError, match="behind the camera"):
        unproject(camera, [[0.0, 0.0], [199.0, 199.0]], -2.0)
