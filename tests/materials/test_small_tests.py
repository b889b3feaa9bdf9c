"""Friction, thickness, load cells, microindentation and adhesion, against closed forms."""

import numpy as np
import pytest

from gelforge.csv_table import TableError
from gelforge.materials.basis.common_form import ForcePair, IndentationTest
from gelforge.materials.small_tests.microindentation import adhesion, contact_point, fit_modulus, layer_factor
from gelforge.materials.small_tests.small_effects import SmallTests, small_effects
from gelforge.materials.small_tests.trials import (
    gain_mismatch,
    pressed_pairs,
    sheet_thickness,
    static_friction,
)


def written(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    return path


def test_friction_and_thickness_have_students_intervals(tmp_path):
    # Friction is the tangent of the tilt with students interval
    path = written(tmp_path, "trial,tilt_deg\na,45\nb,44\nc,46\nd,45\n")
    mu = static_friction(path)
    values = np.tan(np.radians([45, 44, 46, 45]))
    assert mu.value == pytest.approx(values.mean())
    # t quantile for three degrees of freedom: 3.182 (Student's table)
    assert mu.interval[1] - mu.value == pytest.approx(3.182 * values.std(ddof=1) / 2, rel=1e-3)

    # Thickness by sample
    rows = "a,1,0.50\na,2,0.52\na,3,0.51\nb,1,0.6\nb,2,0.6\nb,3,0.63\n"
    found = sheet_thickness(written(tmp_path, "sample,section,thickness_mm\n" + rows))
    assert found["a"].value == pytest.approx(0.51) and found["a"].standard_error == pytest.approx(
        0.01 / np.sqrt(3)
    )
    assert found["b"].count == 3
    with pytest.raises(TableError, match="between 0.02 and 15"):
        sheet_thickness(written(tmp_path, "sample,section,thickness_mm\na,1,510\na,2,500\na,3,505\n"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("trial,tilt_deg\na,45\nb,44\n", "2 trials; 3 at least"),
        ("trial,tilt_deg\na,0.7\nb,0.72\nc,0.69\n", "row 2: tilt_deg is 0.7; between 1.6 and 80"),  # radians
        ("trial\na\n", "tilt_deg"),
        ("", "no header"),
    ],
)
def test_friction_refuses(tmp_path, text, message):
    with pytest.raises(TableError, match=message):
        static_friction(written(tmp_path, text))


def presses(gains, places=None, offsets=0.0):
    one = np.tile(np.r_[np.zeros(10), 10 * np.sin(np.linspace(0, np.pi, 40)), np.zeros(10)], len(gains))
    two = one * np.repeat(gains, 60) + (one > 0) * np.repeat(np.broadcast_to(offsets, len(gains)), 60)
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.02, (2, len(one)))
    position = None if places is None else np.repeat(places, 60)
    return ForcePair("p", one + noise[0] + 0.3, two + noise[1] - 0.2, position=position)


def test_gain_mismatch_with_offsets_and_noise():
    gain = gain_mismatch(presses([0.97, 0.98, 0.976, 0.974, 0.98]))
    assert gain.value == pytest.approx(-0.024, abs=0.003)  # noise of 0.2 % of the force over 38 rows
    assert gain.interval[0] < -0.024 < gain.interval[1] and gain.count == 5

    # An offset that comes with the load is no gain
    pair = presses([0.976] * 5, offsets=[0.5, -0.4, 0.1, 0.6, -0.6])
    gain = gain_mismatch(pair)
    assert gain.value == pytest.approx(-0.024, abs=0.003)  # noise of 0.2 % of the force over 38 rows
    found = [press.offset_N for press in pressed_pairs(pair)]
    np.testing.assert_allclose(
        found, [0.5, -0.4, 0.1, 0.6, -0.6], atol=0.03
    )  # three errors of 0.02 / sqrt(5)
    [effect] = small_effects(SmallTests(force_pairs=(pair,)))[0]
    assert effect.effect == "load_cell_gain" and effect.verdict == "significant gain"
    assert "comes with the load and is no gain" in effect.sentence


def test_a_gain_that_depends_on_the_place_is_said_to():
    pair = presses([0.95, 0.95, 1.0, 1.0, 1.05, 1.05], list("aabbcc"))
    [effect] = small_effects(SmallTests(force_pairs=(pair,)))[0]
    assert effect.verdict == "depends on the place"
    assert effect.parameters["gain_by_place"] == pytest.approx({"a": -0.05, "b": 0.0, "c": 0.05}, abs=0.003)
    undecided = small_effects(SmallTests(force_pairs=(presses([0.99, 1.01, 0.995, 1.005]),)))[0][0]
    assert undecided.verdict == "undecided"
    few = small_effects(SmallTests(force_pairs=(presses([1.0, 1.0]),)))
    assert not few[0] and "2 places; 3 independent" in dict(few[1])["load_cell_gain"]

    # Presses at one place count once
    gains = [0.9, 0.9, 0.9, 1.0, 1.0, 1.0, 1.1, 1.1, 1.1]
    assert gain_mismatch(presses(gains)).count == 9
    apart = gain_mismatch(presses(gains, list("aaabbbccc")))
    assert apart.count == 3
    assert np.ptp(apart.interval) > 2 * np.ptp(gain_mismatch(presses(gains)).interval)
    with pytest.raises(ValueError, match="2 places; 3 independent"):
        gain_mismatch(presses([1, 1, 1, 1], list("aabb")))


# ---------------------------------------------------------------------------------------- microindentation
RADIUS, E = 2.0, 3.0


def press(thickness=None, noise=0.0, contact=0.12, seed=0, offset=0.02):
    z = np.linspace(0, 0.5, 250)
    d = np.maximum(z - contact, 0)
    chi = np.sqrt(RADIUS * d) / (thickness or np.inf)
    factor = 1 + 1.133 * chi + 1.283 * chi**2 + 0.769 * chi**3 + 0.0975 * chi**4
    F = 4 / 3 * E / 0.75 * np.sqrt(RADIUS) * d**1.5 * factor + offset  # E / (1 - nu^2), nu = 0.5
    F = F + np.random.default_rng(seed).normal(0, noise, len(z))
    return IndentationTest("s", z, F, ball_radius_mm=RADIUS, source="press.csv")


@pytest.mark.parametrize("thickness", [None, 4.0, 1.5])
def test_modulus_and_contact_are_recovered(thickness):
    fit = fit_modulus(press(thickness, noise=0.005), thickness)
    assert fit.youngs_modulus == pytest.approx(E, rel=0.01)  # noise is 0.3 % of the largest force
    assert fit.interval[0] < E < fit.interval[1]
    assert fit.contact_mm == pytest.approx(0.12, abs=0.003)
    assert fit.force_at_rest_N == pytest.approx(0.02, abs=0.003)


def test_the_layer_and_the_machines_give_are_corrected():
    # Without the thin layer correction the layer seems stiffer
    fit = fit_modulus(press(1.5), None)
    assert fit.youngs_modulus > 1.5 * E
    assert any("half space is assumed" in warning for warning in fit.warnings)

    # The machines give is taken off
    give = 0.02  # mm per N
    soft = press(4.0)
    bent = IndentationTest(
        "s", soft.position_mm + give * (soft.force_N - 0.02), soft.force_N, ball_radius_mm=RADIUS
    )
    z = np.linspace(0, 0.5, 300)
    board = IndentationTest("b", z, np.maximum(z - 0.1, 0) / give)
    assert fit_modulus(bent, 4.0).youngs_modulus < 0.9 * E
    assert fit_modulus(bent, 4.0, machine=board).youngs_modulus == pytest.approx(E, rel=0.02)


@pytest.mark.thorough
def test_the_interval_holds_the_truth():
    hits = sum(
        fit.interval[0] <= E <= fit.interval[1]
        for fit in (fit_modulus(press(noise=0.02, seed=s)) for s in range(40))
    )
    assert hits >= 34  # 95 % of 40 are 38; fewer than 34 has a probability of 1 %


def test_contact_search_layer_factor_and_adhesion_at_known_values():
    # Contact search and layer factor at their limits
    z = np.linspace(0, 1, 100)
    with pytest.raises(ValueError, match="no contact point"):
        contact_point(z, -z, RADIUS)
    with pytest.raises(ValueError, match="radius is not known"):
        fit_modulus(IndentationTest("s", z, z))

    # Layer factor tends to one for a thick layer
    assert layer_factor(0.1, RADIUS, 1e6) == pytest.approx(1, abs=1e-6)
    assert layer_factor(0.1, RADIUS, None) == 1

    # Adhesion from a known pull off
    z = np.linspace(0, 1, 500)
    rng = np.random.default_rng(1)
    push = np.maximum(z - 0.6, 0) * 10
    pull = push - np.where((z > 0.45) & (z < 0.62), 2.0, 0.0)
    into = IndentationTest("s", z, push + rng.normal(0, 0.01, 500))
    out = IndentationTest("s", z[::-1], (pull + rng.normal(0, 0.01, 500))[::-1] + 0.05)
    found = adhesion(into, out)
    assert found.pull_off_N == pytest.approx(2.0, abs=0.05) and found.largest_push_N == pytest.approx(
        4.0, abs=0.1
    )
    assert found.detached and "significant adhesion" in found.sentence
    assert found.baseline_shift_N == pytest.approx(0.05, abs=0.01)
    assert "negligible" in adhesion(into, into).sentence
    stuck = IndentationTest("s", out.position_mm, out.force_N - 1.0)
    assert not adhesion(into, stuck).detached
