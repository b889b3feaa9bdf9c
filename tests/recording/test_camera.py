"""The camera against closed forms: similar triangles, mirror, turns, and the way back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gelforge.config import Camera
from gelforge.recording.camera import CameraError, project, unproject

PINHOLE = {
    "width_px": 640,
    "height_px": 480,
    "focal_px": 400.0,
    "centre_px": [319.5, 239.5],
    "position_mm": [16.0, 16.0, -40.0],
}
coordinate = st.floats(-20, 20)


def test_similar_triangles():
    # 2 mm to the right and 1 mm up at a distance of 40 mm: 400 * 2 / 40 = 20 px and 10 px
    pixels, distance = project(Camera(**PINHOLE, mirrored=True), [[16, 16, 0], [18, 17, 0], [18, 17, -20]])
    assert_allclose(pixels, [[319.5, 239.5], [339.5, 229.5], [359.5, 219.5]], rtol=1e-14)
    assert_allclose(distance, [40, 40, 20])


def test_unmirrored_image_is_what_an_eye_below_sees():
    # Looking up with y upwards in the image, x runs to the left: the image's right, down and the view are right-handed.
    camera = Camera(**PINHOLE, mirrored=False)
    pixels, _ = project(camera, [[18, 17, 0]])
    assert_allclose(pixels, [[299.5, 229.5]])


def test_a_turn_about_z_turns_the_image():
    camera = Camera(**PINHOLE, rotation_deg=[0, 0, 90])
    # the camera's right now points along y: a point at +y appears to the right
    pixels, _ = project(camera, [[16, 18, 0]])
    assert_allclose(pixels, [[339.5, 239.5]], atol=1e-9)


def test_a_tilted_camera_sees_the_point_on_its_axis_in_the_middle():
    tilt = np.deg2rad(10)
    camera = Camera(**PINHOLE, rotation_deg=[0, 10, 0])  # about y: the view turns towards +x
    on_axis = np.array([16, 16, -40]) + 40 * np.array([np.sin(tilt), 0, np.cos(tilt)])
    pixels, distance = project(camera, on_axis)
    assert_allclose(pixels, [319.5, 239.5], atol=1e-9)
    assert_allclose(distance, 40)


def test_a_flat_scale_ignores_depth():
    camera = Camera(
        width_px=100, height_px=100, mm_per_px=0.1, centre_px=[50, 50], position_mm=[16, 16, 0], mirrored=True
    )
    pixels, _ = project(camera, [[17, 16, 0], [17, 16, -6]])
    assert_allclose(pixels, [[60, 50], [60, 50]])


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


def test_a_point_behind_the_camera_is_named():
    with pytest.raises(CameraError, match=r"5 mm behind the camera"):
        project(Camera(**PINHOLE), [[16, 16, -45]])


@pytest.mark.parametrize("scale", [{"focal_px": None}, {"mm_per_px": 0.1}])
def test_a_camera_has_one_scale(scale):
    with pytest.raises(ValueError, match="not both or neither"):
        Camera(**(PINHOLE | scale))
