"""Every effect of left-out physics: complete, nothing at zero, linear in a little, and its own law where it has one."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import artificial
import numpy as np
import pytest
from numpy.testing import assert_allclose

import gelforge.mismatch.effects as effects
from gelforge.config import study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE as KNOWN
from gelforge.indentation.effects.catalogue import Place, middle_of
from gelforge.mismatch.model import places
from gelforge.mismatch.model.effect import FAMILIES
from gelforge.mismatch.model.places import FirstOrder
from gelforge.mismatch.pipeline.stage import patch_of

CATALOGUE = effects.CATALOGUE
# The names that the specification of the stage lists; an effect more enters by its file.
NAMES = """gel_stiffness skin_stiffness law_exponent compressibility elastic_base linear_elasticity small_strain viscoelastic
mullins ageing temperature friction frictionless adhesion toe_region layer_thickness thickness_gradient
wall_stiffness wall_gap delamination void inclusion indenter_radius particle_settling contact_zero tilt misregistration yaw
grid_scale frame_compliance base_bending clock_offset force_gain force_offset force_drift cross_talk force_hysteresis
camera_scale camera_pose refraction prestretch""".split()
FORCES = [name for name, effect in CATALOGUE.items() if effect.to_forces]
STUDIES = [name for name, effect in CATALOGUE.items() if effect.to_study]
# What a base of finite strain with fitted laws has no need of, and the base that does
PUT_RIGHT = {name: {"mechanics": {"strain": "small"}} for name in ("small_strain", "linear_elasticity")}
# Known of sessions that differ in age and warmth, one zero per session: every effect is seen in them.
CONTEXT = artificial.context(per_side=3, sessions=2, tared=True)
STUDY = CONTEXT.study


def plausible_theta(effect, share=1.0):
    """Return values of a share of the widths, of the physical sign, all different."""
    if effect.binary:
        return np.array([1.0])
    signs = np.array([p.sign or 1 for p in effect.parameters])
    return share * effect.prior_sd * signs * np.linspace(1.0, 0.5, len(signs))


def change(name, theta, number=0, context=CONTEXT):
    effect = CATALOGUE[name]
    return effect.to_forces(context, effect.grid(context)[number], context.force, theta) - context.force


# ------------------------------------------------------------------------------------------------- completeness
def test_the_catalogue_holds_every_name():
    assert set(NAMES) | set(KNOWN) <= set(CATALOGUE)

    # A negative compliance is no physics
    assert not CATALOGUE["frame_compliance"].in_range([-0.216])


@pytest.mark.parametrize("name", CATALOGUE)
def test_everything_is_said(name):
    effect = CATALOGUE[name]
    assert effect.name == name and effect.family in FAMILIES
    for words in (effect.signature, effect.separated_by):
        assert len(words) > 10
    assert len(effect.means) in (1, 3)
    assert len({p.name for p in effect.parameters}) == len(effect.parameters) > 0
    assert effect.to_forces or effect.to_camera
    by_solver = isinstance(effect.to_forces, FirstOrder)
    assert not by_solver or effect.to_study
    for p in effect.parameters:
        assert p.unit and p.width > 0 and re.search(r"bounds|on or off", p.source)
        assert p.bounds[0] < p.bounds[1] and p.bounds[0] <= 0
        assert p.sign == 0 or effect.binary or p.bounds[0] == 0  # of one sign: none is the bound


class Watched(dict):
    """Derivatives by key that remember which were looked up."""

    def __init__(self, known):
        super().__init__(known)
        self.read = set()

    def __getitem__(self, key):
        self.read.add(key)
        return super().__getitem__(key)


@pytest.mark.parametrize("name", FORCES)
def test_what_an_effect_takes_is_told(name):
    """Of other effects; the judge asks the solver for their derivatives even where they are left out."""
    effect, watched = CATALOGUE[name], Watched(CONTEXT.derivatives)
    context = replace(CONTEXT, derivatives=watched, at_readings={})
    for hyperparameters in effect.grid(context):
        effect.to_forces(context, hyperparameters, context.force, plausible_theta(effect))
    others = {key.split(".")[0].split("@")[0] for key in watched.read} - {name}
    assert others <= set(effect.depends_on)


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_plausible_value_is_in_range_and_an_unphysical_one_is_not(name):
    effect = CATALOGUE[name]
    assert effect.in_range(plausible_theta(effect))
    for k, p in enumerate(effect.parameters):
        beyond = plausible_theta(effect)
        beyond[k] = p.bounds[1]
        assert effect.in_range(beyond) == p.closed
        beyond[k] = 1.01 * p.bounds[1]
        assert not effect.in_range(beyond)
        beyond[k] = -p.width * (p.sign or 1)
        assert effect.in_range(beyond) == (p.sign == 0)


def test_an_effect_enters_by_its_file(tmp_path, monkeypatch):
    """A file in a folder that the package looks into is enough; one without an effect, or with another's, is refused."""
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    text = (Path(effects.__file__).parent / "lateral_play.py").read_text()
    (tmp_path / "roll.py").write_text(text.replace('name="lateral_play"', 'name="roll"'))
    found = effects.catalogue_of_modules()
    assert set(found) == {*CATALOGUE, "roll"} and found["roll"].name == "roll"
    (tmp_path / "pitch.py").write_text(text)
    with pytest.raises(ValueError, match=r"pitch\.py holds the effect 'lateral_play'"):
        effects.catalogue_of_modules()
    (tmp_path / "pitch.py").unlink()
    (tmp_path / "heave.py").write_text("EFFECT = 1\n")
    with pytest.raises(TypeError, match=r"heave\.py defines no EFFECT"):
        effects.catalogue_of_modules()


# --------------------------------------------------------------------------------------------------- the battery
@pytest.mark.parametrize("name", FORCES)
def test_nothing_leaves_the_forces_bit_for_bit(name):
    effect = CATALOGUE[name]
    for hyperparameters in effect.grid(CONTEXT):
        same = effect.to_forces(CONTEXT, hyperparameters, CONTEXT.force, 0 * effect.prior_sd)
        assert np.array_equal(same, CONTEXT.force)


@pytest.mark.parametrize("name", STUDIES)
def test_nothing_leaves_the_study_as_it_is(name):
    effect = CATALOGUE[name]
    for hyperparameters in effect.grid(CONTEXT):
        same = effect.to_study(STUDY, hyperparameters, 0 * effect.prior_sd)
        if (
            effect.mesh_changes
        ):  # the plain study on the effect's own mesh, as the mechanics' own battery checks
            assert same == KNOWN[name](STUDY, 0.0)
        else:
            assert same is STUDY


@pytest.mark.parametrize("name", [n for n in FORCES if not CATALOGUE[n].binary])
def test_a_little_is_linear_and_seen(name):
    effect = CATALOGUE[name]
    for k in range(len(effect.parameters)):
        one = np.eye(len(effect.parameters))[k] * plausible_theta(effect, 0.01)
        first, second = change(name, one), change(name, 2 * one)
        assert np.linalg.norm(first) > 1e-9 * np.linalg.norm(CONTEXT.force)
        # First orders are linear in the value but for rounding of the sum with the force, 1e-16 of it.
        assert_allclose(second, 2 * first, atol=1e-14)


@pytest.mark.parametrize("name", sorted(set(STUDIES) & set(KNOWN) - set(PUT_RIGHT)))
def test_the_study_gets_what_the_catalogue_of_the_mechanics_gives(name):
    """On a plain study, one parameter, a place: the keys are those that the mechanics' battery has solved with."""
    effect, known = CATALOGUE[name], KNOWN[name]
    one = np.eye(len(effect.parameters))[0] * plausible_theta(effect, 0.1 if not effect.binary else 1)
    if effect.binary:
        one = np.array([1.0])
    hyperparameters = effect.grid(CONTEXT)[0]
    changed = effect.to_study(STUDY, hyperparameters, one)
    if name == "viscoelastic":  # the mechanics' own has 1 s
        changed = effect.to_study(STUDY, {"part": "gel", "time_s": 1.0}, one)
    if name == "mullins":  # and 0.5 kPa
        changed = effect.to_study(STUDY, {"m_kPa": 0.5}, one)
    assert changed == known(
        STUDY, float(one[0]), Place(**hyperparameters) if "z_mm" in hyperparameters else None
    )
    assert effect.history == known.history
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
    """A value of what a base has already comes on top: half and half again is the whole."""
    effect = CATALOGUE[name]
    half = plausible_theta(effect, 0.5)
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
    changed = effect.to_study(square, effect.grid(CONTEXT)[0], plausible_theta(effect, 0.1))
    assert changed.mechanics != square.mechanics


@pytest.mark.parametrize(("symmetry", "keys"), [("auto", None), ("d4", {"symmetry": "none"}), ("none", None)])
def test_the_patch_of_a_tilt_touches_the_plan_only_where_symmetry_was_asked_for(symmetry, keys):
    study = study_from(merged(STUDY.model_dump(mode="json"), {"plan": {"symmetry": symmetry}}))
    part = SimpleNamespace(name="tilt", hyperparameters={})
    patch = patch_of(study, CATALOGUE, [(part, np.array([1.0, 0.0]))])
    assert patch["mechanics"]["effects"]["kinematics"]["tilt_deg"] == [1.0, 0.0]
    assert patch.get("plan") == keys
    study_from(merged(study.model_dump(mode="json"), patch))  # and can be read


@pytest.mark.parametrize("name", [n for n in STUDIES if not CATALOGUE[n].binary])
def test_bounds_are_those_of_the_configuration(name):
    """Just inside its bounds every value is a study that can be read, so a refit may go anywhere; and on what is whole."""
    effect = CATALOGUE[name]
    for k, p in enumerate(effect.parameters):
        inside = 1.0 if p.closed else 0.999
        for share in (inside * p.bounds[0], inside * p.bounds[1]):
            if share:
                one = np.eye(len(effect.parameters))[k] * share
                assert effect.to_study(STUDY, effect.grid(CONTEXT)[-1], one).mechanics != STUDY.mechanics


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


def test_simplifications_are_lifted_with_several_coefficients_and_friction_has_no_half():
    # Simplifications are lifted with several coefficients or laws
    found = CATALOGUE["frictionless"]
    smooth = base_with(friction=0.0)
    grid = found.grid(replace(CONTEXT, study=smooth))
    tried = [found.to_study(smooth, hyperparameters, [1]).mechanics.friction for hyperparameters in grid]
    assert tried == [0.2, 0.45, 1.0]
    (none,) = found.grid(CONTEXT)
    assert found.to_study(STUDY, none, [1]).mechanics.friction == 0.0

    # Small strain is lifted with neo hookean laws and then with the fitted ones
    base = base_with(strain="small", contact_normals="initial")
    lifted = CATALOGUE["small_strain"].to_study(base, {}, [1])
    assert lifted.mechanics.strain == "finite" and lifted.mechanics.effects.material.linear_law
    fitted = CATALOGUE["linear_elasticity"].to_study(lifted, {}, [1])
    assert fitted == CATALOGUE["linear_elasticity"].to_study(base, {}, [1])
    assert not fitted.mechanics.effects.material.linear_law and fitted.mechanics.strain == "finite"

    # Friction left out has one name and no half. A base without any is `frictionless`; one that has some has
    # another coefficient, or none
    smooth = study_from(merged(STUDY.model_dump(mode="json"), {"mechanics": {"friction": 0.0}}))
    names = ("friction", "friction_law", "frictionless")
    assert [CATALOGUE[name].applies(smooth) for name in names] == [False, False, True]
    assert all(CATALOGUE[name].applies(STUDY) for name in names)
    assert CATALOGUE["friction"].to_study(STUDY, {}, [-1.0]).mechanics.friction == 0.0

    # A simplification has no half
    with pytest.raises(ValueError, match=r"found 0\.5"):
        CATALOGUE["frictionless"].to_study(STUDY, {}, [0.5])


@pytest.mark.parametrize("name", PUT_RIGHT)
def test_what_the_base_does_not_assume_is_not_put_right(name):
    assert not CATALOGUE[name].applies(STUDY)
    assert CATALOGUE[name].applies(base_with(strain="small"))


@pytest.mark.parametrize(
    ("name", "sensor_or_mechanics"),
    [
        ("wall_stiffness", {"sensor": {"wall_mm": 0.0}}),
        (  # the wall is gel then
            "wall_stiffness",
            {"sensor": {"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "soft"}]}},
        ),
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


def test_a_void_has_places_inside_and_acts_where_it_is():
    dome = study_from(
        merged(STUDY.model_dump(mode="json"), {"sensor": {"shape": {"kind": "dome"}, "wall_mm": 0.0}})
    )
    found = places.balls(dome)
    planes = len(places.SIZES)
    assert (
        len(places.balls(STUDY)) == len(found) + 4 * planes == 25 * planes
    )  # without wall also 5 x 5, less the corners
    for p in found:
        x, y = (2 * p["x_mm"] / 20 - 1), (2 * p["y_mm"] / 20 - 1)
        assert x**2 + y**2 + (1 + p["z_mm"] / 6) ** 2 < 1

    # A void acts where it is
    k = 5
    there = np.abs(change("void", [1.0], number=k)[:, 2]) / np.abs(CONTEXT.force[:, 2])
    place = places.balls(STUDY)[k]
    table = CONTEXT.observations.table
    deep = (table["depth_mm"] == 2.0).to_numpy()
    away = np.hypot(table["x_mm"] - place["x_mm"], table["y_mm"] - place["y_mm"]).to_numpy()
    assert np.argmin(away[deep]) in np.flatnonzero(there[deep] > 0.999 * there[deep].max())
    assert middle_of(STUDY).radius_mm < place["radius_mm"] <= 0.45 * 4.5
