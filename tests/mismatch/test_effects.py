"""Every effect of left-out physics: complete, nothing at zero, linear in a little, and its own law where it has one."""

import re
from dataclasses import replace
from pathlib import Path

import artificial
import numpy as np
import pytest
from numpy.testing import assert_allclose

import gelforge.mismatch.effects as effects
from gelforge.config import Camera, study_from
from gelforge.config.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE as KNOWN
from gelforge.indentation.effects.catalogue import Place, middle_of
from gelforge.mismatch import places
from gelforge.mismatch.context import Curves
from gelforge.mismatch.effect import FAMILIES
from gelforge.mismatch.effects.clock_offset import STAMPS
from gelforge.mismatch.places import FirstOrderAt
from gelforge.mismatch.solver_effects import FirstOrder
from gelforge.recording.camera import project

CATALOGUE = effects.CATALOGUE
# The names that a verdict may use, as the specification of the stage lists them, and friction_law of the mechanics.
NAMES = """gel_stiffness skin_stiffness law_exponent compressibility elastic_base linear_elasticity small_strain viscoelastic
mullins ageing temperature friction frictionless friction_law adhesion toe_region layer_thickness thickness_gradient
wall_stiffness wall_gap delamination void inclusion indenter_radius particle_settling contact_zero tilt misregistration yaw
grid_scale frame_compliance base_bending clock_offset force_gain force_offset force_drift cross_talk force_hysteresis
camera_scale camera_pose refraction prestretch""".split()
FORCES = [name for name, effect in CATALOGUE.items() if effect.to_forces]
STUDIES = [name for name, effect in CATALOGUE.items() if effect.to_study]
# What a base of finite strain with fitted laws has no need of, and the base that does
PUT_RIGHT = {name: {"mechanics": {"strain": "small"}} for name in ("small_strain", "linear_elasticity")}
CAMERAS = [name for name, effect in CATALOGUE.items() if effect.to_camera]
# Known of sessions that differ in age and warmth, one zero per session: every effect is seen in them.
CONTEXT = artificial.context(per_side=3, sessions=2, tared=True)
STUDY = CONTEXT.study
PINHOLE = Camera(width_px=640, height_px=480, focal_px=900.0, centre_px=[320, 240], position_mm=[10, 10, -56])
FLAT = Camera(width_px=640, height_px=480, mm_per_px=0.05, centre_px=[320, 240], position_mm=[10, 10, -6])


def amounts_of(effect, share=1.0):
    """Return amounts of a share of the widths, of the physical sign, all different."""
    if effect.switch:
        return np.array([1.0])
    signs = np.array([p.sign or 1 for p in effect.parameters])
    return share * effect.widths * signs * np.linspace(1.0, 0.5, len(signs))


def change(name, amounts, shape=0, context=CONTEXT):
    effect = CATALOGUE[name]
    return effect.to_forces(context, effect.shapes(context)[shape], context.force, amounts) - context.force


# ------------------------------------------------------------------------------------------------- completeness
def test_the_catalogue_holds_every_name_and_no_other():
    assert sorted(CATALOGUE) == sorted(NAMES)
    assert set(KNOWN) <= set(CATALOGUE)


@pytest.mark.parametrize("name", CATALOGUE)
def test_everything_is_said(name):
    effect = CATALOGUE[name]
    assert effect.name == name and effect.family in FAMILIES and effect.family != "analyst"
    for words in (effect.enters, effect.signature, effect.separated_by):
        assert len(words) > 10
    assert effect.confused_with and set(effect.confused_with) <= set(CATALOGUE) - {name}
    assert len({p.name for p in effect.parameters}) == len(effect.parameters) > 0
    assert effect.to_forces or effect.to_camera
    by_solver = isinstance(effect.to_forces, FirstOrder | FirstOrderAt)
    assert not by_solver or effect.to_study
    for p in effect.parameters:
        assert p.unit and p.width > 0 and re.search(r"bounds|on or off", p.source)
        assert p.bounds[0] < p.bounds[1] and p.bounds[0] <= 0
        assert p.sign == 0 or effect.switch or p.bounds[0] == 0  # of one sign: none is the bound


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_plausible_amount_is_in_range_and_an_unphysical_one_is_not(name):
    effect = CATALOGUE[name]
    assert effect.in_range(amounts_of(effect))
    for k, p in enumerate(effect.parameters):
        beyond = amounts_of(effect)
        beyond[k] = p.bounds[1]
        assert not effect.in_range(beyond)
        beyond[k] = -p.width * (p.sign or 1)
        assert effect.in_range(beyond) == (p.sign == 0)


def test_a_negative_compliance_is_no_physics():
    assert not CATALOGUE["frame_compliance"].in_range([-0.216])


def test_an_effect_enters_by_its_file(tmp_path, monkeypatch):
    """A file in a folder that the package looks into is enough; one without an effect, or with another's, is refused."""
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    text = (Path(effects.__file__).parent / "yaw.py").read_text()
    (tmp_path / "roll.py").write_text(text.replace('name="yaw"', 'name="roll"'))
    found = effects.found()
    assert set(found) == {*NAMES, "roll"} and found["roll"].name == "roll"
    (tmp_path / "pitch.py").write_text(text)
    with pytest.raises(ValueError, match=r"pitch\.py holds the effect 'yaw'"):
        effects.found()
    (tmp_path / "pitch.py").unlink()
    (tmp_path / "heave.py").write_text("EFFECT = 1\n")
    with pytest.raises(TypeError, match=r"heave\.py defines no EFFECT"):
        effects.found()


# --------------------------------------------------------------------------------------------------- the battery
@pytest.mark.parametrize("name", FORCES)
def test_nothing_leaves_the_forces_bit_for_bit(name):
    effect = CATALOGUE[name]
    for shape in effect.shapes(CONTEXT):
        same = effect.to_forces(CONTEXT, shape, CONTEXT.force, 0 * effect.widths)
        assert np.array_equal(same, CONTEXT.force)


@pytest.mark.parametrize("name", STUDIES)
def test_nothing_leaves_the_study_as_it_is(name):
    effect = CATALOGUE[name]
    for shape in effect.shapes(CONTEXT):
        same = effect.to_study(STUDY, shape, 0 * effect.widths)
        if (
            effect.mesh_changes
        ):  # the plain study on the effect's own mesh, as the mechanics' own battery checks
            assert same == KNOWN[name](STUDY, 0.0)
        else:
            assert same is STUDY


@pytest.mark.parametrize("name", [n for n in FORCES if not CATALOGUE[n].switch])
def test_a_little_is_linear_and_seen(name):
    effect = CATALOGUE[name]
    for k in range(len(effect.parameters)):
        one = np.eye(len(effect.parameters))[k] * amounts_of(effect, 0.01)
        first, second = change(name, one), change(name, 2 * one)
        assert np.linalg.norm(first) > 1e-9 * np.linalg.norm(CONTEXT.force)
        # First orders are linear in the amount but for rounding of the sum with the force, 1e-16 of it.
        assert_allclose(second, 2 * first, atol=1e-14)


@pytest.mark.parametrize("name", [name for name in STUDIES if name not in PUT_RIGHT])
def test_the_study_gets_what_the_catalogue_of_the_mechanics_gives(name):
    """On a plain study, one parameter, a place: the keys are those that the mechanics' battery has solved with."""
    effect, known = CATALOGUE[name], KNOWN[name]
    one = np.eye(len(effect.parameters))[0] * amounts_of(effect, 0.1 if not effect.switch else 1)
    if effect.switch:
        one = np.array([1.0])
    shape = effect.shapes(CONTEXT)[0]
    changed = effect.to_study(STUDY, shape, one)
    if name == "viscoelastic":  # the mechanics' own has 1 s
        changed = effect.to_study(STUDY, {"part": "gel", "time_s": 1.0}, one)
    assert changed == known(STUDY, float(one[0]), Place(**shape) if "z_mm" in shape else None)
    assert effect.history == known.history and effect.unloading == known.unloading
    assert [p.unit for p in effect.parameters] == [known.unit] * len(effect.parameters)


@pytest.mark.parametrize("name", [n for n in STUDIES if len(CATALOGUE[n].parameters) == 2])
def test_the_second_direction_is_the_other_one(name):
    effect = CATALOGUE[name]
    both = effect.to_study(STUDY, {}, [0.01, 0.02]).model_dump_json()
    assert "[0.01,0.02]" in both


def numbers_of(study):
    """Return all numbers of mechanics, in order."""
    return [float(n) for n in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", study.mechanics.model_dump_json())]


ADDED = """ageing temperature elastic_base friction friction_law adhesion toe_region layer_thickness thickness_gradient
wall_gap indenter_radius particle_settling contact_zero tilt misregistration yaw grid_scale frame_compliance
base_bending""".split()


@pytest.mark.parametrize("name", ADDED)
def test_more_is_added_to_what_the_base_has(name):
    """An amount of what a base has already comes on top: half and half again is the whole."""
    effect = CATALOGUE[name]
    half = amounts_of(effect, 0.5)
    twice = effect.to_study(effect.to_study(STUDY, {}, half), {}, half)
    once = effect.to_study(STUDY, {}, 2 * half)
    # 1/E and 1/factor are inverted twice, which rounds; names keep their place in the flattened text
    assert numbers_of(twice) == pytest.approx(numbers_of(once), rel=1e-12)


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_of_mirrored_cells_takes_every_effect(name):
    square = study_from(
        merged(STUDY.model_dump(mode="json"), {"plan": {"symmetry": "d4"}} | PUT_RIGHT.get(name, {}))
    )
    effect = CATALOGUE[name]
    changed = effect.to_study(square, effect.shapes(CONTEXT)[0], amounts_of(effect, 0.1))
    assert changed.mechanics != square.mechanics


@pytest.mark.parametrize("name", [n for n in STUDIES if not CATALOGUE[n].switch])
def test_bounds_are_those_of_the_configuration(name):
    """Just inside its bounds every amount is a study that can be read, so a refit may go anywhere."""
    effect = CATALOGUE[name]
    for k, p in enumerate(effect.parameters):
        for share in (0.999 * p.bounds[0], 0.999 * p.bounds[1]):
            if share:
                one = np.eye(len(effect.parameters))[k] * share
                assert effect.to_study(STUDY, effect.shapes(CONTEXT)[-1], one).mechanics != STUDY.mechanics


# ------------------------------------------------------------------------------------------- the study's own choices
def base_with(**mechanics):
    return study_from(merged(STUDY.model_dump(mode="json"), {"mechanics": mechanics}))


@pytest.mark.parametrize(
    ("name", "base", "key", "turned"),
    [
        ("small_strain", {"strain": "small"}, "strain", "finite"),
        ("frictionless", {}, "friction", 0.0),
        ("frictionless", {"friction": 0.0}, "friction", 0.45),
    ],
)
def test_a_simplification_is_turned_round(name, base, key, turned):
    assert getattr(CATALOGUE[name].to_study(base_with(**base), {}, [1]).mechanics, key) == turned


def test_a_base_without_friction_is_tried_with_several_coefficients():
    found = CATALOGUE["frictionless"]
    smooth = base_with(friction=0.0)
    shapes = found.shapes(replace(CONTEXT, study=smooth))
    tried = [found.to_study(smooth, shape, [1]).mechanics.friction for shape in shapes]
    assert tried == [0.2, 0.45, 1.0]
    (none,) = found.shapes(CONTEXT)
    assert found.to_study(STUDY, none, [1]).mechanics.friction == 0.0


def test_small_strain_is_lifted_with_neo_hookean_laws_and_then_with_the_fitted_ones():
    base = base_with(strain="small", contact_normals="initial")
    lifted = CATALOGUE["small_strain"].to_study(base, {}, [1])
    assert lifted.mechanics.strain == "finite" and lifted.mechanics.effects.material.linear_law
    fitted = CATALOGUE["linear_elasticity"].to_study(lifted, {}, [1])
    assert fitted == CATALOGUE["linear_elasticity"].to_study(base, {}, [1])
    assert not fitted.mechanics.effects.material.linear_law and fitted.mechanics.strain == "finite"


@pytest.mark.parametrize("name", PUT_RIGHT)
def test_what_the_base_does_not_assume_is_not_put_right(name):
    assert not CATALOGUE[name].applies(STUDY)
    assert CATALOGUE[name].applies(base_with(strain="small"))


def test_a_simplification_has_no_half():
    with pytest.raises(ValueError, match=r"found 0\.5"):
        CATALOGUE["frictionless"].to_study(STUDY, {}, [0.5])


@pytest.mark.parametrize(
    ("name", "sensor_or_mechanics"),
    [
        ("wall_stiffness", {"sensor": {"wall_mm": 0.0}}),
        (
            "skin_stiffness",
            {"sensor": {"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "soft"}]}},
        ),
        (
            "particle_settling",
            {"sensor": {"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "soft"}]}},
        ),
        ("prestretch", {"sensor": {"shape": {"kind": "dome"}, "wall_mm": 0.0}}),
        ("viscoelastic", {"mechanics": {"strain": "small"}}),
        ("indenter_radius", {"indenter": {"kind": "cylinder", "radius_mm": 3.0}}),
    ],
)
def test_an_effect_of_what_the_sensor_does_not_have_is_not_offered(name, sensor_or_mechanics):
    assert CATALOGUE[name].applies(STUDY)
    assert not CATALOGUE[name].applies(study_from(merged(STUDY.model_dump(mode="json"), sensor_or_mechanics)))


def test_friction_left_out_has_one_name_whatever_the_base():
    """A base without any is `frictionless`; one that has some has another coefficient, or none."""
    smooth = study_from(merged(STUDY.model_dump(mode="json"), {"mechanics": {"friction": 0.0}}))
    names = ("friction", "friction_law", "frictionless")
    assert [CATALOGUE[name].applies(smooth) for name in names] == [False, False, True]
    assert all(CATALOGUE[name].applies(STUDY) for name in names)
    assert CATALOGUE["friction"].to_study(STUDY, {}, [-1.0]).mechanics.friction == 0.0


# --------------------------------------------------------------------------------------------------------- places
@pytest.mark.parametrize("kind", [places.balls, places.patches])
def test_every_point_of_the_gel_is_near_a_place(kind):
    xy = np.array([[p["x_mm"], p["y_mm"]] for p in kind(STUDY)])
    line = np.linspace(1.0, artificial.WIDTH - 1.0, 40)  # the wall is 1 mm
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 1, 2)
    assert (
        np.linalg.norm(points - xy, axis=-1).min(axis=1).max() < 3.0
    )  # as near as a defect is to be located
    assert all(p["z_mm"] <= -1.0 and p["z_mm"] - 6.0 < 0 for p in kind(STUDY))


def test_a_dome_has_places_inside_only():
    dome = study_from(
        merged(STUDY.model_dump(mode="json"), {"sensor": {"shape": {"kind": "dome"}, "wall_mm": 0.0}})
    )
    found = places.balls(dome)
    assert len(places.balls(STUDY)) == len(found) + 4 == 25  # without wall also 5 x 5, less the corners
    for p in found:
        x, y = (2 * p["x_mm"] / 20 - 1), (2 * p["y_mm"] / 20 - 1)
        assert x**2 + y**2 + (1 + p["z_mm"] / 6) ** 2 < 1


def test_a_void_acts_where_it_is():
    k = 5
    there = np.abs(change("void", [1.0], shape=k)[:, 2]) / np.abs(CONTEXT.force[:, 2])
    place = places.balls(STUDY)[k]
    table = CONTEXT.observations.table
    deep = (table["depth_mm"] == 2.0).to_numpy()
    away = np.hypot(table["x_mm"] - place["x_mm"], table["y_mm"] - place["y_mm"]).to_numpy()
    assert np.argmin(away[deep]) in np.flatnonzero(there[deep] > 0.999 * there[deep].max())
    assert middle_of(STUDY).radius_mm < place["radius_mm"] <= 0.45 * 4.5


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


def test_overstress_of_an_even_rise_and_a_wait():
    """v tau (1 - exp(-t / tau)) while depth grows at v, then fading with tau: exact for a stiffness linear in depth."""
    tau, v = 0.7, 0.5
    rise, wait = np.array([0.5, 1.0, 2.0]), np.array([2.5, 4.0, 9.0])
    context = one_press([*rise, *wait], [*(v * rise), 1.0, 1.0, 1.0], ["load"] * 3 + ["dwell"] * 3)
    effect = CATALOGUE["viscoelastic"]
    found = effect.to_forces(context, {"part": "gel", "time_s": tau}, context.force, [0.3]) - context.force
    top = v * tau * (1 - np.exp(-rise / tau))
    expected = -0.3 * np.r_[top, top[-1] * np.exp(-(wait - 2.0) / tau)]
    # pchip reproduces a line; 1e-9 is rounding
    assert_allclose(found[:, 2], expected, rtol=1e-9)


def test_a_long_relaxation_is_a_stiffness_and_a_short_one_nothing():
    context = one_press([1.0, 2.0, 3.0], [1.0, 1.0, 0.5], ["load", "dwell", "unload"])
    effect = CATALOGUE["viscoelastic"]
    for tau, share in ((1e9, 1.0), (1e-9, 0.0)):
        found = (
            effect.to_forces(context, {"part": "gel", "time_s": tau}, context.force, [1.0]) - context.force
        )
        assert_allclose(
            found, share * context.derivative("gel_stiffness"), atol=1e-8
        )  # 3 s of 1e9 s, and tau itself


def test_relaxation_times_reach_from_a_tenth_of_a_second_to_ten_times_the_longest_press():
    shapes = CATALOGUE["viscoelastic"].shapes(CONTEXT)
    longest = CONTEXT.observations.table["press_time_s"].max()
    for part in ("gel", "skin"):
        times = [s["time_s"] for s in shapes if s["part"] == part]
        assert times[0] == 0.1 and times[-1] == pytest.approx(10 * longest, rel=1e-2)  # three digits
        assert max(b / a for a, b in zip(times, times[1:])) < 10**0.5 + 0.02


def test_softening_comes_after_deeper_presses_near_the_place():
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


def test_age_and_warmth_act_between_sessions_only():
    later = (CONTEXT.observations.table["session"] == "s2").to_numpy()
    gel = CONTEXT.derivative("gel_stiffness")
    for name, beyond in (("ageing", 30.0), ("temperature", 4.0)):
        found = change(name, [0.01])
        assert (found[~later] == 0).all()
        assert_allclose(found[later], 0.01 * beyond * gel[later], atol=1e-14)


def test_a_session_that_does_not_say_its_age_stays():
    table = CONTEXT.observations.table
    earlier = (table["session"] != "s2").to_numpy()
    for name, column in (("ageing", "age_days"), ("temperature", "temperature_C")):
        said = replace(
            CONTEXT.observations,
            table=table.assign(**{column: np.where(earlier, 40.0 + table.index % 2, np.nan)}),
        )
        found = change(name, [0.01], context=replace(CONTEXT, observations=said))
        assert not found[~earlier].any()


def test_what_is_the_same_in_all_readings_is_not_tried():
    """At one age, or where none is said, ageing is another name for a stiffer gel."""
    for name, column in (("ageing", "age_days"), ("temperature", "temperature_C")):
        for value in (np.nan, 40.0):
            same = replace(CONTEXT.observations, table=CONTEXT.observations.table.assign(**{column: value}))
            assert CATALOGUE[name].shapes(replace(CONTEXT, observations=same)) == []


# ----------------------------------------------------------------------------------------------- machine and readings
def test_a_yielding_frame_takes_depth_in_proportion_to_force():
    """Against the force law itself, at the depth that balances; c = 1e-5 mm/N leaves second order below 1e-4."""
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


def test_without_the_solver_depth_acts_by_the_slope_of_the_base():
    alone = replace(CONTEXT, derivatives={}, at_readings={})
    found = change("frame_compliance", [0.1], context=alone)
    assert_allclose(found, 0.1 * alone.force[:, 2:] * alone.slope(), atol=1e-14)


def test_a_late_clock_reads_the_force_of_before_and_an_early_one_that_of_after():
    """At the end of the way down an early clock reads the wait: nothing changes there."""
    context = one_press(
        [1.0, 2.0, 5.0, 6.0, 7.0], [0.5, 1.2, 1.2, 0.6, 0.4], ["load", "load", "dwell", "unload", "unload"]
    )
    per_mm = context.derivative("contact_zero")[:, 2]
    for stamp, speed in {"late": [0.5, 0.7, 0, -0.6, -0.2], "early": [0.7, 0.0, 0, -0.2, -0.2]}.items():
        found = change("clock_offset", [0.1], STAMPS.index(stamp), context)[:, 2]
        assert_allclose(found, -0.1 * np.array(speed) * per_mm, atol=1e-14)


def test_without_a_shape_the_sign_of_the_lag_says_which_way_it_is():
    """As where a study takes it as known."""
    context = one_press([1.0, 2.0], [0.5, 1.2], ["load", "load"])
    clock = CATALOGUE["clock_offset"]
    for lag, stamp in ((0.1, "late"), (-0.1, "early")):
        same = [clock.to_forces(context, shape, context.force, [lag]) for shape in ({}, {"stamp": stamp})]
        assert np.array_equal(*same) and not np.array_equal(same[0], context.force)


def test_gain_and_cross_talk_act_on_the_force():
    assert_allclose(change("force_gain", [0.1, 0.0, -0.2]), CONTEXT.force * [0.1, 0.0, -0.2], atol=1e-15)
    turn = np.array([0.01, -0.02, 0.03])  # rad about x, y, z
    a, b, c = turn
    # x_of_y, x_of_z, y_of_x, y_of_z, z_of_x, z_of_y of a small turn
    assert_allclose(change("cross_talk", [-c, b, c, -a, -b, a]), np.cross(turn, CONTEXT.force), atol=1e-14)


def test_offset_and_drift_are_what_the_zero_of_a_tared_session_leaves():
    table = CONTEXT.observations.table
    effect = CATALOGUE["force_offset"]
    assert effect.shapes(CONTEXT) == [{}, {"session": "s1"}, {"session": "s2"}]
    every = np.tile([0.1, 0.2, 0.3], (len(table), 1))
    assert_allclose(change("force_offset", [0.1, 0.2, 0.3], shape=0), every, atol=1e-14)
    own = (table["session"] == "s2").to_numpy()
    assert_allclose(
        change("force_offset", [0.1, 0.2, 0.3], shape=2), np.outer(own, [0.1, 0.2, 0.3]), atol=1e-14
    )
    drift = change("force_drift", [0.0, 0.0, 3600.0])[:, 2]
    assert_allclose(drift[own], (table["time_s"] - table["time_s"][own].min())[own], atol=1e-9)
    shapes = CATALOGUE["force_drift"].shapes(CONTEXT)
    assert shapes[0] == {} and all("settles_s" in one for one in shapes[1:])
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
    assert CATALOGUE["force_drift"].shapes(zeroed) == [{}]
    assert effect.shapes(zeroed) == [{}] and not change("force_offset", [1.0, 1.0, 1.0], context=zeroed).any()
    since_touch = change("force_drift", [0.0, 0.0, 3600.0], context=zeroed)[:, 2]
    assert_allclose(since_touch, zeroed.observations.table["press_time_s"], atol=1e-9)


def test_hysteresis_opens_on_the_way_up_by_its_share_at_half_of_the_peak():
    times, depths = [1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 2.0, 2.0, 1.0, 0.5]
    context = one_press(times, depths, ["load", "load", "dwell", "unload", "unload"])
    found = change("force_hysteresis", [0.05], context=context)[:, 2]
    assert_allclose(found, [0.0, 0.0, 0.0, -0.05 * 2.0, -0.05 * 2.0 * 0.75], atol=1e-14)


def test_adhesion_is_seen_on_the_way_up_only():
    up = (CONTEXT.observations.table["phase"] == "unload").to_numpy()
    expected = np.outer(up, [0, 0, 2e-4 * np.pi * artificial.RADIUS])
    assert_allclose(change("adhesion", [1e-4]), expected, atol=1e-14)


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
                effect.to_camera(STUDY, PINHOLE, share * np.eye(len(effect.parameters))[k] * effect.widths),
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


def test_pose_moves_and_turns_the_camera():
    found = CATALOGUE["camera_pose"].to_camera(STUDY, PINHOLE, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert found.position_mm == [11.0, 12.0, -53.0] and found.rotation_deg == [4.0, 5.0, 6.0]


def test_refraction_is_snells_law_near_the_axis():
    """A ray from the pinhole to the lower face and on into the gel, by Snell's law, ends at the point that is seen there."""
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
