"""Adhesion by Johnson, Kendall and Roberts: its closed forms on a half space, and what it is on a layer."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_effect_forms import one_press

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.adhesion import Contact, push_of
from gelforge.mismatch.model.effect import Curves

R, K, W = 5.0, 0.05, 1e-4  # mm, MPa (4/3 E*), N/mm
DEPTHS = np.linspace(0.1, 2.0, 8)
HERTZ = push_of(DEPTHS, K * np.sqrt(R) * DEPTHS**1.5)
HALF_SPACE = Contact(R, np.inf, HERTZ)
HELD = np.geomspace(1e-3, 3.0, 200_001)  # depths whose contact is held


def branch():
    """Return depth [mm] and force [N] of all contacts at which the rim lets go."""
    force, stiffness, _ = HALF_SPACE.push(HELD)
    retreat = HALF_SPACE.retreat(W, HELD)
    return HELD - retreat, force - stiffness * retreat


def test_the_contact_is_that_of_the_formula_up_to_its_pull_off_with_a_deficit_of_its_own():
    # The contact is that of the formula up to its pull off. a^3 = R / K (F + 3 pi w R + sqrt(6 pi w R F + (3 pi w
    # R)^2)), a^2 = R d of the held depth, where it is stable
    _, F = branch()
    stable = HELD > HELD[np.argmin(F)]
    F, p = F[stable], 3 * np.pi * W * R
    cubed = R / K * (F + p + np.sqrt(np.maximum(2 * p * F + p**2, 0.0)))
    assert_allclose(cubed, (R * HELD[stable]) ** 1.5, rtol=1e-6)

    # Pull off at a held load and at a held depth
    depth, F = branch()
    assert F.min() == pytest.approx(-1.5 * np.pi * W * R, rel=1e-6)
    assert F[np.argmin(depth)] == pytest.approx(-5 / 6 * np.pi * W * R, rel=1e-3)  # at a minimum of the depth

    # Deficit at no depth at a large one and after the turn. 4/3 pi w R at depth 0, pi w R where the contact is
    # large next to that at which it parts
    depths = np.array([1e-6, 1.9])
    found = HALF_SPACE.pull(W, depths, np.full(2, 100.0))
    assert found[0] == pytest.approx(4 / 3 * np.pi * W * R, rel=1e-3)
    assert HALF_SPACE.pull(1e-9 * W, depths[1:], np.array([9.0]))[0] == pytest.approx(
        1e-9 * np.pi * W * R, rel=1e-3
    )

    # There the force falls along the flat punch that the contact is, 3/2 K a per mm.
    back = np.array([1e-3, 1e-2, 2e-2])
    found = HALF_SPACE.pull(W, 1.0 - back, np.ones(3))
    without = K * np.sqrt(R) * (1.0 - back) ** 1.5
    assert_allclose(without - found, K * np.sqrt(R) - 1.5 * K * np.sqrt(R) * back, rtol=1e-9)
    assert HALF_SPACE.pull(W, np.ones(1), np.ones(1))[0] == 0.0


def test_the_pull_grows_on_a_layer_a_push_keeps_its_power_and_readings_have_the_law_of_their_shape():
    # On a layer the pull grows with the contact. As the area does, to twice that of a half space where the contact
    # is as large as the layer is thick
    contact = Contact(R, 5.0, HERTZ)
    little = contact.pull(1e-9 * W, np.array([0.2, 1.0]), np.full(2, 9.0)) / (1e-9 * W * np.pi * R)
    assert_allclose(little, 1 + np.sqrt([0.2, 1.0]) / np.sqrt(5.0), rtol=1e-2)

    # DA/dd between depths [mm]: 4 mm of gel under 1 mm of skin, whose nodes of 0.5 mm know an area
    # to some per cent.
    depths, areas = np.array([0.4, 0.8, 1.2, 1.6]), np.array([4.660, 12.648, 21.658, 31.266])
    middle = (depths[1:] + depths[:-1]) / 2
    expected = np.pi * R * (1 + np.sqrt(R * middle) / 5.0)
    assert_allclose(np.diff(areas) / np.diff(depths), expected, rtol=0.08)

    # A push is followed by its power. Of a force that stiffens as a layer's: slope and curvature as differences
    # have them, Hertz's power at no depth
    d, h = np.array([0.3, 1.0, 1.7]), 1e-4
    layered = Contact(R, 5.0, push_of(DEPTHS, DEPTHS**1.5 * np.exp(0.4 * np.sqrt(DEPTHS) + 0.1 * DEPTHS)))
    force, slope, curvature = layered.push(d)
    above, below = layered.push(d + h)[0], layered.push(d - h)[0]
    assert_allclose(force, d**1.5 * np.exp(0.4 * np.sqrt(d) + 0.1 * d), rtol=1e-9)
    assert_allclose(slope, (above - below) / (2 * h), rtol=1e-6)
    assert_allclose(curvature, (above - 2 * force + below) / h**2, rtol=1e-4)
    one = Contact(R, 5.0, push_of(DEPTHS[:1], DEPTHS[:1] ** 1.5))
    assert one.push(d)[0] == pytest.approx(d**1.5)

    # Readings take the law of their shape. Half space or layer: with readings down, up from the turn and out of
    # contact
    at, phases = [1.0, 1.0, 0.6, 0.2, -0.1], ["load", "unload", "unload", "unload", "unload"]
    context = one_press([1.0, 2.0, 3.0, 4.0, 5.0], at, phases)
    effect, knots = CATALOGUE["adhesion"], np.linspace(0.1, 2.0, 12)
    curve = Curves((knots,), (np.outer(K * np.sqrt(R) * knots**1.5, [0.0, 0.0, -1.0]),))
    context = replace(context, curves=curve)
    found = effect.to_forces(context, {"law": "JKR"}, context.force, [W]) - context.force
    layer = Contact(artificial.RADIUS, context.study.sensor.height_mm, HERTZ)
    expected = layer.pull(W, np.array([0.6, 0.2]), np.ones(2))
    assert_allclose(found[:, 2], [0.0, 0.0, *expected, 0.0], rtol=1e-6, atol=1e-12)
    assert not found[:, :2].any()
