"""Turned images and labels stay those of one press, and the way that an image lies on the sensor is found."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from gelforge.config import Camera, Sensor
from gelforge.indentation.sensor.symmetry import D4, transform_bins
from gelforge.learning.basis.turns import (
    Turner,
    flow_centre,
    image_on_sensor,
    names_of,
    order,
    seen_by_camera,
    turned_flow,
)

RNG = np.random.default_rng(5)
WIDTH = np.array([32.0, 32.0])
SENSOR = Sensor(
    width_x_mm=32.0,
    width_y_mm=32.0,
    layers=[{"name": "gel", "thickness_mm": 6.0, "material": "soft"}],
    bins={"nx": 5, "ny": 5},
)


@pytest.mark.parametrize("name", D4)
def test_labels_turn_as_the_mechanics_turns_bins(name):
    label = RNG.normal(size=(3, 25, 3)).astype(np.float32)
    flow = torch.zeros(3, 32)
    _, turned = Turner((name,), 4, 5, 5)(np.zeros(3, int), flow, torch.from_numpy(label.reshape(3, -1)))
    assert_allclose(turned.reshape(3, 25, 3), transform_bins(name, label, 5), atol=1e-6)


@pytest.mark.parametrize("name", D4)
def test_forces_among_the_inputs_turn_as_labels_do(name):
    flow, force = torch.randn(3, 32), torch.randn(3, 75)
    inputs, targets = Turner((name,), 4, 5, 5)(np.zeros(3, int), torch.cat([flow, force], dim=1), force)
    alone, _ = Turner((name,), 4, 5, 5)(np.zeros(3, int), flow, force)
    assert_array_equal(inputs, torch.cat([alone, targets], dim=1))


@pytest.mark.parametrize("name", D4)
def test_flow_and_label_of_one_bump_turn_together(name):
    """A source of flow at a place: after the turn it is still a source, at the turned place, and so is the label."""
    n = 9
    index = np.arange(n * n)
    place = np.stack([index % n, index // n], axis=-1) - (n - 1) / 2
    away = place - [2.0, -1.0]
    bump = np.exp(-(away**2).sum(axis=1) / 4)
    flow, label = (
        (away * bump[:, None]).T[None],
        np.concatenate([away, -np.ones((n * n, 1))], axis=1) * bump[:, None],
    )
    inputs = torch.from_numpy(flow.reshape(1, -1).astype(np.float32))
    targets = torch.from_numpy(label.reshape(1, -1).astype(np.float32))
    inputs, targets = Turner((name,), n, n, n)(np.zeros(1, int), inputs, targets)
    centre = D4[name] @ [2.0, -1.0]
    away = place - centre
    bump = np.exp(-(away**2).sum(axis=1) / 4)
    assert_allclose(inputs.reshape(2, -1).T, away * bump[:, None], atol=1e-6)
    assert_allclose(targets.reshape(-1, 3)[:, :2], away * bump[:, None], atol=1e-6)
    assert_allclose(turned_flow(name, flow, n)[0].T, away * bump[:, None], atol=1e-12)


def test_rows_are_turned_by_their_own_element_and_order_of_squares_and_rectangles():
    # Each row is turned by its own element
    n, names = 5, tuple(D4)
    flow = torch.from_numpy(RNG.normal(size=(len(names), 2 * n * n)).astype(np.float32))
    label = torch.from_numpy(RNG.normal(size=(len(names), 3 * n * n)).astype(np.float32))
    chosen = RNG.permutation(len(names))
    together = Turner(names, n, n, n)(chosen, flow, label)
    for row, number in enumerate(chosen):
        alone = Turner((names[number],), n, n, n)(np.zeros(1, int), flow[row : row + 1], label[row : row + 1])
        for whole, part in zip(together, alone):
            assert_allclose(whole[row], part[0], atol=1e-6)

    # Order and centre of the flow on squares and rectangles
    position, centre = RNG.uniform(4, 28, (40, 2)), RNG.normal(size=(40, 2))
    assert image_on_sensor(centre, position, WIDTH) == ("identity", False)
    assert image_on_sensor(centre[:1], position[:1], WIDTH) == ("identity", False)

    # The flow's centre is where it moves
    flow = np.zeros((1, 2, 16))
    flow[0, :, 4 * 3 + 1] = 2.0  # column 1, row 3 of 4 x 4
    assert_allclose(flow_centre(flow, 4), [[-0.125, 0.375]])

    # A rectangle is mirrored and not turned by a quarter
    assert set(names_of(square=False)) == {"identity", "rotate_180", "mirror_x", "mirror_y"}
    assert_array_equal(order("mirror_x", 3, 2), [2, 1, 0, 5, 4, 3])


@pytest.mark.parametrize("name", D4)
def test_how_the_image_lies_is_found(name):
    position = RNG.uniform(4, 28, (40, 2))
    share = (position - WIDTH / 2) / WIDTH
    centre = 0.8 * share @ D4[name] + 0.002 * RNG.normal(size=share.shape)  # D4's inverse is its transpose
    assert image_on_sensor(centre, position, WIDTH) == (name, True)
    assert image_on_sensor(centre + [0.1, 0.0], position, WIDTH) == (name, False)
    uneven = centre * [1.2, 1.0]
    assert image_on_sensor(uneven, position, WIDTH) == (name, False)


@pytest.mark.parametrize(
    ("changed", "lie"),
    [
        ({}, ("rotate_180", True)),  # looking up, x runs to the left; v runs down
        ({"mirrored": True}, ("mirror_y", True)),
        ({"rotation_deg": [0.0, 0.0, 90.0], "mirrored": True}, ("swap_xy", True)),
        ({"position_mm": [18.0, 16.0, -46.0]}, ("rotate_180", False)),
        ({"rotation_deg": [3.0, 0.0, 0.0]}, ("rotate_180", False)),
        ({"focal_y_px": 650.0}, ("rotate_180", False)),
    ],
)
def test_a_known_camera_says_how_its_image_lies(changed, lie):
    camera = {
        "width_px": 400,
        "height_px": 400,
        "focal_px": 545.0,
        "centre_px": [199.5, 199.5],
        "mirrored": False,
    }
    camera = Camera(**{**camera, "position_mm": [16.0, 16.0, -46.0], **changed})
    assert seen_by_camera(camera, SENSOR) == lie
