"""What single effects do, against formulas of their own: history, machine, force sensor and camera."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_effects import CATALOGUE, CONTEXT, STUDY, change

from gelforge.config import Camera
from gelforge.mismatch.effects.clock_offset import STAMPS
from gelforge.mismatch.effects.mullins import POINTS, Energies, lost_share
from gelforge.mismatch.model.effect import Curves
from gelforge.recording.optics.camera import project

PINHOLE = Camera(width_px=640, height_px=480, focal_px=900.0, centre_px=[320, 240], position_mm=[10, 10, -56])
FLAT = Camera(width_px=640, height_px=480, mm_per_px=0.05, centre_px=[320, 240], position_mm=[10, 10, -6])
CAMERAS = [name for name, effect in CATALOGUE.items() if effect.to_camera]


# -------------------------------------------------------------------------------------------------------- history
def one_press(times, depths, phases, linear=1.0):
    """Return a context of one press whose gel stiffness has the derivative linear x depth along z."""
    base = artificial.context(per_side=1, depths=(1.0,))
    rows = base.observations.table.iloc[np.zeros(len(times), int)].reset_index(drop=True)
    rows = rows.assign(
        press_time_s=times, time_s=times, depth_mm=depths, phase=phases, deepest_mm=max(depths)
    )
    first = np.arange(len(base.force)) < len(times)
    seen = replace(base.observations.chosen(first), table=rows)
    knots = np.linspace(0.05, 2.0, 40)
    line = Curves((knots,), (np.outer(linear * knots, [0.0, 0.0, -1.0]),))
    force = line.at(0, np.array(depths))
    return replace(
        base,
        observations=seen,
        force=force,
        curves=line,
        derivatives={"gel_stiffness": line, "contact_zero": line},
    )


def test_overstress_of_a_rise_and_a_wait_and_of_times_up_to_ten_times_the_longest_press():
    # Overstress of a rise and a wait and of extreme times. v tau (1 - exp(-t / tau)) while depth grows at v, then
    # fading with tau: exact for a stiffness linear in depth
    tau, v = 0.7, 0.5
    rise, wait = np.array([0.5, 1.0, 2.0]), np.array([2.5, 4.0, 9.0])
    context = one_press([*rise, *wait], [*(v * rise), 1.0, 1.0, 1.0], ["load"] * 3 + ["dwell"] * 3)
    effect = CATALOGUE["viscoelastic"]
    found = effect.to_forces(context, {"part": "gel", "time_s": tau}, context.force, [0.3]) - context.force
    top = v * tau * (1 - np.exp(-rise / tau))
    expected = -0.3 * np.r_[top, top[-1] * np.exp(-(wait - 2.0) / tau)]
    # pchip reproduces a line; 1e-9 is rounding
    assert_allclose(found[:, 2], expected, rtol=1e-9)

    # A long relaxation is a stiffness and a short one nothing
    context = one_press([1.0, 2.0, 3.0], [1.0, 1.0, 0.5], ["load", "dwell", "unload"])
    for tau, share in ((1e9, 1.0), (1e-9, 0.0)):
        found = (
            effect.to_forces(context, {"part": "gel", "time_s": tau}, context.force, [1.0]) - context.force
        )
        assert_allclose(
            found, share * context.derivative("gel_stiffness"), atol=1e-8
        )  # 3 s of 1e9 s, and tau itself

    # Relaxation times reach from a tenth of a second to ten times the longest press
    grid = CATALOGUE["viscoelastic"].grid(CONTEXT)
    longest = CONTEXT.observations.table["press_time_s"].max()
    for part in ("gel", "skin"):
        times = [s["time_s"] for s in grid if s["part"] == part]
        assert times[0] == 0.1 and times[-1] == pytest.approx(10 * longest, rel=1e-2)  # three digits
        assert max(b / a for a, b in zip(times, times[1:])) < 10**0.5 + 0.02


def test_softening_comes_after_deeper_presses_on_two_scales():
    table = CONTEXT.observations.table
    softer = change("mullins", [0.3])[:, 2] / -CONTEXT.derivative("gel_stiffness")[:, 2]
    first = table["press"] == table["press"].iloc[0]
    load = table["phase"] != "unload"
    assert (softer[first & load] == 0).all()  # a fresh sensor
    assert (softer[first & ~load] > 0).all()  # on the way up below the peak
    deeper = table.groupby("site")["deepest_mm"].transform(lambda d: d.cummax()) > table["depth_mm"]
    assert (softer[deeper & load] > 0).all()
    assert (softer >= 0).all() and softer.max() <= 0.3
    # Neighbours: where the first press at a site is shallow, what was pressed around it softens it a little.
    second = table["site"] != table["site"].iloc[0]
    fresh = (
        second
        & load
        & (table.groupby("site")["order"].transform("min") == table["order"])
        & (table["session"] == "s1")
    )
    assert (softer[fresh] > 0).any()

    # A loss at the slightest return keeps more of its size on a shallow return than one in
    # proportion.
    small, large = (hyperparameters["m_kPa"] for hyperparameters in CATALOGUE["mullins"].grid(CONTEXT))
    assert large == pytest.approx(10 * small, rel=0.1)  # two digits
    context = one_press([1.0, 2.0, 3.0], [1.0, 0.8, 0.3], ["load", "unload", "unload"])
    at_once, in_proportion = (lost_share(context, m) for m in (1e-6, 1e6))
    assert at_once == pytest.approx(
        [0.0, 1.0, 1.0], abs=1e-3
    )  # erf of 1 / BETA times 36 % of the energy and more
    assert in_proportion[2] > 3 * in_proportion[1] > 0


def test_energies_add_up_to_the_work():
    """Of a force in proportion to depth, d^2 / 2; points share the energy within the outermost ring evenly."""
    context = one_press([1.0], [1.0], ["load"])
    energies, r = Energies(context), np.linspace(0, 2000, 400_001)
    height = context.study.sensor.height_mm
    density = energies.density(0, np.float64(1.0), r) * 1e-3  # MPa
    assert height * np.trapezoid(2 * np.pi * r * density, r) == pytest.approx(
        0.5, rel=2e-3
    )  # knots, cut at 2 m
    x = (np.linalg.norm(POINTS, axis=1) ** 2).reshape(6, -1)
    assert_allclose(x, x[:, :1] * np.ones_like(x), rtol=1e-12)
    assert_allclose(x[:, 0] / (1 + x[:, 0]), (np.arange(6) + 0.5) / 6, rtol=1e-12)


def test_age_and_warmth_act_between_sessions_that_state_them():
    later = (CONTEXT.observations.table["session"] == "s2").to_numpy()
    gel = CONTEXT.derivative("gel_stiffness")
    for name, beyond in (("ageing", 30.0), ("temperature", 4.0)):
        found = change(name, [0.01])
        assert (found[~later] == 0).all()
        assert_allclose(found[later], 0.01 * beyond * gel[later], atol=1e-14)

    # A session that does not say its age stays
    table = CONTEXT.observations.table
    earlier = (table["session"] != "s2").to_numpy()
    for name, column in (("ageing", "age_days"), ("temperature", "temperature_C")):
        said = replace(
            CONTEXT.observations,
            table=table.assign(**{column: np.where(earlier, 40.0 + table.index % 2, np.nan)}),
        )
        found = change(name, [0.01], context=replace(CONTEXT, observations=said))
        assert not found[~earlier].any()

    # At one age, or where none is said, ageing is another name for a stiffer gel.
    for name, column in (("ageing", "age_days"), ("temperature", "temperature_C")):
        for value in (np.nan, 40.0):
            same = replace(CONTEXT.observations, table=CONTEXT.observations.table.assign(**{column: value}))
            assert CATALOGUE[name].grid(replace(CONTEXT, observations=same)) == []


# ----------------------------------------------------------------------------------------------- machine and readings
def test_a_yielding_frame_is_in_proportion_to_force_and_a_clock_reads_by_its_sign():
    # A yielding frame takes depth in proportion to force. Against the force law itself, at the depth that balances;
    # c = 1e-5 mm/N leaves second order below 1e-4
    c = 1e-5
    table = CONTEXT.observations.table
    x, y, d = (table[name].to_numpy() for name in ("x_mm", "y_mm", "depth_mm"))
    real = d.copy()
    for _ in range(5):
        real = d + c * artificial.force(x, y, real)[:, 2]
    exact = artificial.force(x, y, real) - artificial.force(x, y, d)
    known = np.isin(d, artificial.DEPTHS)  # between knots the curve itself is interpolated
    found = change("frame_compliance", [c])
    assert_allclose(found[known], exact[known], rtol=1e-3, atol=1e-12)
    middle = np.hypot(x - 10, y - 10) < 1e-9
    assert_allclose(change("base_bending", [c])[middle], found[middle], atol=1e-15)  # its mode is 1 there
    corner = (x == x.min()) & (y == y.min())
    mode = np.sin(np.pi * 4 / 20) ** 2
    assert_allclose(change("base_bending", [c])[corner], mode**2 * found[corner], atol=1e-15)

    # Without the solver depth acts by the slope of the base
    alone = replace(CONTEXT, derivatives={}, at_readings={})
    found = change("frame_compliance", [0.1], context=alone)
    assert_allclose(found, 0.1 * alone.force[:, 2:] * alone.slope(), atol=1e-14)

    # A clock reads the force of before or after by its sign. At the end of loading an early clock reads the
    # wait: nothing changes there
    context = one_press(
        [1.0, 2.0, 5.0, 6.0, 7.0], [0.5, 1.2, 1.2, 0.6, 0.4], ["load", "load", "dwell", "unload", "unload"]
    )
    per_mm = context.derivative("contact_zero")[:, 2]
    for stamp, speed in {"late": [0.5, 0.7, 0, -0.6, -0.2], "early": [0.7, 0.0, 0, -0.2, -0.2]}.items():
        found = change("clock_offset", [0.1], STAMPS.index(stamp), context)[:, 2]
        assert_allclose(found, -0.1 * np.array(speed) * per_mm, atol=1e-14)

    # As where a study takes it as known.
    context = one_press([1.0, 2.0], [0.5, 1.2], ["load", "load"])
    clock = CATALOGUE["clock_offset"]
    for lag, stamp in ((0.1, "late"), (-0.1, "early")):
        same = [
            clock.to_forces(context, hyperparameters, context.force, [lag])
            for hyperparameters in ({}, {"stamp": stamp})
        ]
        assert np.array_equal(*same) and not np.array_equal(same[0], context.force)


def test_gain_cross_talk_offset_and_drift_act_on_the_force_as_the_zero_leaves_them():
    # Gain and cross talk act on the force
    assert_allclose(change("force_gain", [0.1, 0.0, -0.2]), CONTEXT.force * [0.1, 0.0, -0.2], atol=1e-15)
    turn = np.array([0.01, -0.02, 0.03])  # rad about x, y, z
    a, b, c = turn
    # x_of_y, x_of_z, y_of_x, y_of_z, z_of_x, z_of_y of a small turn
    assert_allclose(change("cross_talk", [-c, b, c, -a, -b, a]), np.cross(turn, CONTEXT.force), atol=1e-14)

    # Offset and drift are what the zero of a tared session leaves
    table = CONTEXT.observations.table
    effect = CATALOGUE["force_offset"]
    assert effect.grid(CONTEXT) == [{}, {"session": "s1"}, {"session": "s2"}]
    every = np.tile([0.1, 0.2, 0.3], (len(table), 1))
    assert_allclose(change("force_offset", [0.1, 0.2, 0.3], number=0), every, atol=1e-14)
    own = (table["session"] == "s2").to_numpy()
    assert_allclose(
        change("force_offset", [0.1, 0.2, 0.3], number=2), np.outer(own, [0.1, 0.2, 0.3]), atol=1e-14
    )
    drift = change("force_drift", [0.0, 0.0, 3600.0])[:, 2]
    assert_allclose(drift[own], (table["time_s"] - table["time_s"][own].min())[own], atol=1e-9)
    grid = CATALOGUE["force_drift"].grid(CONTEXT)
    assert grid[0] == {} and all("settles_s" in one for one in grid[1:])
    settling = CATALOGUE["force_drift"].to_forces(
        CONTEXT, {"settles_s": 100.0}, CONTEXT.force, [0.0, 0.0, 0.2]
    )
    t = (table["time_s"] - table.groupby("session")["time_s"].transform("min")).to_numpy()
    assert_allclose(
        (settling - CONTEXT.force)[:, 2], 0.2 * (1 - np.exp(-t / 100.0)), atol=1e-12
    )  # all within the hour
    slow = CATALOGUE["force_drift"].to_forces(CONTEXT, {"settles_s": 1e9}, CONTEXT.force, [0.0, 0.0, 3600.0])
    assert_allclose((slow - CONTEXT.force)[:, 2], drift, rtol=1e-5, atol=1e-9)
    zeroed = artificial.context(per_side=2)
    assert CATALOGUE["force_drift"].grid(zeroed) == [{}]
    assert effect.grid(zeroed) == [{}] and not change("force_offset", [1.0, 1.0, 1.0], context=zeroed).any()
    since_touch = change("force_drift", [0.0, 0.0, 3600.0], context=zeroed)[:, 2]
    assert_allclose(since_touch, zeroed.observations.table["press_time_s"], atol=1e-9)


def test_hysteresis_and_play_open_when_the_force_turns_and_adhesion_on_the_way_up_only():
    # Hysteresis and play open when the force turns
    times, depths = [1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 2.0, 2.0, 1.0, 0.5]
    context = one_press(times, depths, ["load", "load", "dwell", "unload", "unload"])
    found = change("force_hysteresis", [0.0, 0.0, 0.05], context=context)[:, 2]
    assert_allclose(found, [0.0, 0.0, 0.0, -0.05 * 2.0, -0.05 * 2.0 * 0.75], atol=1e-14)

    # By a share of the largest force that the base has anywhere; just past the peak the reading
    # still waits.
    times, depths = [1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 2.0, 2.0, 1.99, 0.5]
    context = one_press(times, depths, ["load", "load", "dwell", "unload", "unload"])
    half = 0.05 * max(np.abs(values[:, 2]).max() for values in context.curves.values)
    down, back = np.sign(context.force[1, 2]), context.force[1, 2] - context.force[3, 2]
    assert 0 < abs(back) < half
    effect = CATALOGUE["force_hysteresis"]
    found = effect.to_forces(context, {"loop": "play"}, context.force, [0.0, 0.0, 0.05]) - context.force
    lag = down * half
    assert_allclose(found[:, 2], [-lag, -lag, -lag, back - lag, lag], atol=1e-14)

    # Hysteresis is not offered without an unloading
    down = artificial.chosen(CONTEXT, (CONTEXT.observations.table["phase"] != "unload").to_numpy())
    assert CATALOGUE["force_hysteresis"].grid(CONTEXT) == [{"loop": "lens"}, {"loop": "play"}]
    assert CATALOGUE["force_hysteresis"].grid(down) == []

    # Adhesion is seen in unloading only
    up = (CONTEXT.observations.table["phase"] == "unload").to_numpy()
    expected = np.outer(up, [0, 0, 1.5e-4 * np.pi * artificial.RADIUS])
    assert_allclose(change("adhesion", [1e-4]), expected, atol=1e-14)
    # Between the first order of Johnson, Kendall and Roberts on a half space, pi R w, and Derjaguin's on a thin layer.
    assert not CATALOGUE["adhesion"].solved and CATALOGUE["adhesion"].to_study is not None


@pytest.mark.parametrize("loop", ["lens", "play"])
@pytest.mark.parametrize("axis", range(3))
def test_each_axis_has_a_hysteresis_of_its_own(loop, axis):
    effect = CATALOGUE["force_hysteresis"]
    found = effect.to_forces(CONTEXT, {"loop": loop}, CONTEXT.force, 0.05 * np.eye(3)[axis]) - CONTEXT.force
    assert found[:, axis].any() and not np.delete(found, axis, axis=1).any()


# --------------------------------------------------------------------------------------------------------- camera
@pytest.mark.parametrize("camera", [PINHOLE, FLAT], ids=["pinhole", "flat"])
@pytest.mark.parametrize("name", CAMERAS)
def test_nothing_leaves_the_camera_as_it_is(name, camera):
    effect = CATALOGUE[name]
    assert effect.to_camera(STUDY, camera, [0.0] * len(effect.parameters)) == camera
    assert effect.family == "camera" and not (effect.to_study or effect.to_forces)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_little_of_the_camera_is_linear(name):
    effect = CATALOGUE[name]
    points = np.random.default_rng(0).uniform([2, 2, -6], [18, 18, -1], (50, 3))
    for k in range(len(effect.parameters)):
        seen = [
            project(
                effect.to_camera(STUDY, PINHOLE, share * np.eye(len(effect.parameters))[k] * effect.prior_sd),
                points,
            )[0]
            for share in (0.0, 0.01, 0.02)
        ]
        assert np.abs(seen[1] - seen[0]).max() > 1e-4  # px
        # of 1 % of a width: second order is of its size again
        assert np.abs(seen[2] - 2 * seen[1] + seen[0]).max() < 0.05 * np.abs(seen[2] - seen[0]).max()


@pytest.mark.parametrize("camera", [PINHOLE, FLAT], ids=["pinhole", "flat"])
def test_scale_is_about_the_principal_point(camera):
    points = np.array([[10.0, 10.0, -3.0], [14.0, 8.0, -2.0]])
    larger = CATALOGUE["camera_scale"].to_camera(STUDY, camera, [0.1])
    away = project(camera, points)[0] - camera.centre_px
    assert_allclose(project(larger, points)[0] - camera.centre_px, 1.1 * away, rtol=1e-12)


def test_pose_and_refraction_move_rays_as_they_say():
    found = CATALOGUE["camera_pose"].to_camera(STUDY, PINHOLE, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert found.position_mm == [11.0, 12.0, -53.0] and found.rotation_deg == [4.0, 5.0, 6.0]

    # A ray from the pinhole to the lower face and on into the gel, by Snell's law, ends at the
    # point that is seen there.
    n, below, f = 1.41, 50.0, PINHOLE.focal_px
    camera = CATALOGUE["refraction"].to_camera(STUDY, PINHOLE, [n - 1])
    for u, height in ((9.0, 1.0), (18.0, 4.0)):  # px off the axis: 0.6 and 1.1 deg
        sine = np.sin(np.arctan(u / f))
        X = below * u / f + height * np.tan(np.arcsin(sine / n))
        pixel, _ = project(camera, [[10.0 + X, 10.0, -6.0 + height]])
        # beyond the axis the error is of the angle squared, 4e-4
        assert pixel[0, 0] - 320 == pytest.approx(u, rel=4e-4)
    with pytest.raises(ValueError, match="lies in the gel"):
        CATALOGUE["refraction"].to_camera(
            STUDY, PINHOLE.model_copy(update={"position_mm": [10, 10, -3]}), [0.4]
        )
