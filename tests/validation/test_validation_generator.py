"""What the generator writes: nulls are the base with noise, effects are what they are called, and the law is Ogden's."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from gelforge.config import load_session, load_study
from gelforge.indentation.planning.plan import plan_cells
from gelforge.materials.fitting.law_file import moved_laws, read_law
from gelforge.recording.readings import read_recording
from validation import baselines, body_forms, draw, kinds, presses, recording, separation, sets
from validation.ogden import Ogden
from validation.pressed import GEL, SKIN
from validation.sensors import FRICTION, SENSORS, SMALL, THIN
from validation.world import World, held, zeroed

PLAN = SMALL.plan
LAW = Ogden((7.9652e-3, -0.3093e-3), (1.2769, -3.5676), 1.3, 2e-3)


def gradients(seed: int = 0) -> np.ndarray:
    return np.eye(3)[:, :, None, None] + 0.2 * np.random.default_rng(seed).normal(size=(3, 3, 2, 3))


@pytest.mark.parametrize("law", [LAW, Ogden((7.9652e-3,), (1.2769,), 1.0, 5e-3, 3)], ids=["second", "third"])
def test_stress_is_the_slope_of_the_energy_and_the_tangent_that_of_the_stress(law):
    """With a stiffening term of the second and of the third power, whose tangents have other shapes."""
    F, e = gradients(), 1e-6
    P, A = law.gradient([F, None])[0], law.hessian([F, None])[0]
    for k in range(3):
        for l in range(3):
            step = np.zeros_like(F)
            step[k, l] = e
            slope = (law.energy(F + step) - law.energy(F - step)) / (2 * e)
            turn = (law.gradient([F + step, None])[0] - law.gradient([F - step, None])[0]) / (2 * e)
            # differences of second order over 1e-6: rounding 1e-16 / 1e-6 of the value, times some ten operations
            assert_allclose(slope, P[k, l], atol=1e-8 * np.abs(P).max())
            assert_allclose(turn, A[:, :, k, l], atol=1e-7 * np.abs(A).max())


def test_a_bar_has_ogdens_closed_form_and_the_thin_sensor_its_moduli():
    # A bar has the closed form of ogden
    lam = 1.7
    F = np.diag([lam, lam**-0.5, lam**-0.5])[:, :, None, None]
    law = Ogden((0.08, -0.002), (2.9, -8.3))
    P = law.gradient([F, None])[0][..., 0, 0]
    nominal = P[0, 0] - P[1, 1] * F[1, 1, 0, 0] / lam  # the pressure that keeps the sides free
    closed = sum(m * (lam ** (a - 1) - lam ** (-a / 2 - 1)) for m, a in zip(law.mu, law.alpha))
    assert nominal == pytest.approx(closed, rel=1e-12)

    # The thin sensor states the moduli that felupe has. The sums over Ogden's terms of mu alpha / 2, and standard
    # deviations of their doubts
    for layer, (mu, alpha), factor in (("gel", GEL, THIN.plain.gel), ("skin", SKIN, THIN.plain.skin)):
        stated = read_law(sets.CONFIG / f"thin_{layer}.json")
        shear = factor * np.dot(mu, alpha) / 2
        assert stated.law.shear_modulus == pytest.approx(shear, rel=1e-6)
        (moved,) = moved_laws(stated, 1.0)
        assert abs(moved.shear_modulus / shear - 1) == pytest.approx(
            draw.BASES["thin"].doubts[layer],
            rel=1e-5,  # moduli are rounded to 1e-6 kPa
        )


def plain(sessions: int = 1):
    rng = np.random.default_rng(1)
    instrument = recording.drawn_instrument(rng, sessions, zero_by="press", tared=False)
    return recording.with_circumstances(presses.timeline(rng, PLAN, sessions), instrument), instrument


def test_a_null_is_the_base_with_its_noise_and_contact_point(library):
    """Standardised by noise, zero and contact point to first order, 60 nulls have the variance 1 that the session states."""
    rng, seen = np.random.default_rng(2), []
    for _ in range(60):
        instrument = recording.drawn_instrument(rng, zero_by="press", tared=False)
        rows = recording.with_circumstances(presses.timeline(rng, PLAN), instrument)
        world = World(library)
        read = zeroed(rows, recording.recorded(world, rows, instrument, rng), False)
        slope = (world.forces(rows, 1e-3) - world.forces(rows, -1e-3)) / 2e-3
        sigma = np.sqrt(instrument.sigma_N**2 * 4 / 3 + (slope * instrument.touchdown_mm) ** 2)
        seen.append((((read - world.forces(rows)) / sigma)[held(rows)] ** 2).mean())
    # a recording has about 60 free contact points and 1000 free readings: 0.1 per recording, 0.013 of the mean
    assert np.mean(seen) == pytest.approx(1.0, abs=0.04)


def test_a_stage_scatters_beside_the_contact_point_and_changes_no_other_draw(library):
    """400 sessions know a standard deviation to 4 %, 22000 presses to 0.5 %."""
    rows, plainly = plain()
    instrument = replace(plainly, zero_by="session", touchdown_mm=0.01)
    scattering = replace(instrument, stage_mm=0.006)
    first = (rows["press"] != rows["press"].shift()).to_numpy()
    off = np.array(
        [recording.contact_point_error(rows, scattering, np.random.default_rng(k))[first] for k in range(400)]
    )
    assert off.std(axis=1, ddof=1).mean() == pytest.approx(0.006, rel=0.02)
    alone = [
        recording.contact_point_error(rows, instrument, np.random.default_rng(k))[first] for k in range(400)
    ]
    assert np.std(alone) == pytest.approx(0.01, rel=0.15) and np.ptp(alone, axis=1).max() == 0
    assert np.std(off - alone) == pytest.approx(0.006, rel=0.02)
    drawn = [recording.drawn_instrument(np.random.default_rng(k), zero_by="session") for k in range(200)]
    assert 70 < sum(one.stage_mm > 0 for one in drawn) < 130
    assert all(
        recording.drawn_instrument(np.random.default_rng(k), zero_by="press").stage_mm == 0 for k in range(20)
    )


def test_a_session_states_both_errors_and_is_read_by_the_package(library, tmp_path):
    # A session states both errors
    rows, instrument = plain()
    for by, stage, said in (("session", 0.006, (0.006, 0.01)), ("press", 0.0, (0.01, 0.0))):
        known = replace(instrument, zero_by=by, touchdown_mm=0.01, stage_mm=stage)
        readings = recording.recorded(World(library), rows, known, np.random.default_rng(0))
        (folder,) = recording.write_recording(tmp_path / by, "c000", rows, readings, known)
        session = load_session(folder / "session.yaml")
        assert (session.depth_zero.press_scatter_mm, session.depth_zero.session_scatter_mm) == said
        assert session.force.repeatability_N == pytest.approx(known.sigma_N, abs=1e-6)

    # Recordings are read by the package
    case = draw.make_case({"small": library}, "c000", "null", np.random.default_rng(0))
    for folder in recording.write_recording(tmp_path, case.name, case.rows, case.readings, case.instrument):
        read = read_recording(folder)
        assert read.session.synthetic and read.session.base_parameters == "exact"
        assert set(read.readings["phase"]) == {"zero", "load", "dwell", "unload"}
    json.dumps(case.truth)  # what is sealed is JSON


def test_every_ninth_press_is_the_sentinel():
    rows = presses.timeline(np.random.default_rng(0), PLAN)
    first = rows.drop_duplicates("press")
    sentinel = first[first["order"] % PLAN.sentinel_every == 0]
    assert set(sentinel["cell"]) == {"c00"} and set(sentinel["deepest_mm"]) == {1.6}
    assert len(first) == 13 * 4 + 7
    assert rows["time_s"].is_monotonic_increasing


@pytest.mark.parametrize("form", [*kinds.KINDS, *kinds.OUTSIDE])
def test_an_effect_vanishes_with_its_amount_and_is_felt_at_a_plausible_one(library, form):
    kind = {**kinds.KINDS, **kinds.OUTSIDE}[form]
    rows, _instrument = plain(kind.sessions)
    drawn = kind.draw(np.random.default_rng(5))
    base = World(library)
    change = {}
    for size in (0.0, 1e-3, 1.0):
        world = World(library)
        kind.put(world, size, drawn)
        change[size] = recording.change_of(base, world, rows, bool(kind.tared))
    # a thousandth of the value gives at most some ten thousandths of the change's force, and none gives none
    assert np.abs(change[0.0]).max() < 1e-9
    assert np.abs(change[1e-3]).max() < 0.05 * np.abs(change[1.0]).max()
    assert np.isfinite(change[1.0]).all() and np.abs(change[1.0]).max() > 2e-4


def test_tilt_leads_deeper_and_a_spring_takes_its_force_times_its_compliance(library):
    # Tilt leads deeper where the sensor rises. A turn about x raises large y: by y sin(1 deg) there, and the ball
    # goes down aside by depth sin(1 deg)
    rows, _ = plain()
    world = World(library)
    kinds.KINDS["turned body"].put(world, 1.0, {"x": 1.0, "y": 0.0})
    xy, depth = world.reached(rows, np.zeros(len(rows)))
    on, s = held(rows), np.sin(np.deg2rad(1.0))
    lead = (depth - rows["depth_mm"].to_numpy())[on]
    # cos(1 deg) differs from 1 by 1.5e-4, of 6 mm and of the depth
    assert_allclose(lead, rows["y_mm"].to_numpy()[on] * s, atol=2e-3)
    assert_allclose(xy[on, 0], rows["x_mm"].to_numpy()[on], atol=1e-9)

    # A series spring takes its force times its compliance
    world = World(library)
    kinds.KINDS["series spring"].put(world, 1.0, {"sign": 1.0})
    xy, depth = world.reached(rows, np.zeros(len(rows)))
    on = held(rows)
    lost = rows["depth_mm"].to_numpy()[on] - depth[on]
    assert_allclose(lost, -0.05 * world.elastic(xy, depth)[on, 2], atol=1e-9)


def test_the_drawn_signal_is_the_wanted_one_and_simplifications_can_be_taken_back(library):
    # The drawn signal is the wanted one. Signals grow about in proportion, so three corrections bring them within a
    # few per cent
    rows, instrument = plain()
    base = World(library)
    kind, drawn = kinds.KINDS["stretched grid"], {"sign": 1.0}
    size = draw._size(base, library, "concealed", kind, drawn, rows, instrument, 1.0)
    found = draw._signal(base, library, "concealed", [draw.Concealed(kind, size, drawn)], rows, instrument)
    assert found == pytest.approx(1.0, rel=0.02)

    # A base with its simplification taken back is the plain one
    rows, _ = plain()
    for form in ("fitted laws", "smooth ball"):
        kind = kinds.KINDS[form]
        world = draw.base_world(library, kind.base)
        kind.put(world, 1.0, {"sign": 1.0})
        assert_allclose(world.forces(rows), World(library).forces(rows), atol=1e-12)


def test_contents_are_as_many_as_asked_without_slopes_under_balls_that_stick(library):
    # Contents are as many as asked of their own seeds
    made = list(draw.cases({"small": library}, 5, {"null": 3, "single": 2, "pair": 2, "outside": 1}))
    assert sorted(case.content for case in made) == ["null"] * 3 + ["outside"] + ["pair"] * 2 + ["single"] * 2
    for case in made:
        assert all(effect["snr"] >= draw.SNR[0] for effect in case.truth["effects"])
        assert (case.content == "null") == (case.truth["snr"] == 0)

    # Reporting seeds are not development seeds
    assert draw.seed_of_commit("0123abc") >= draw.DEVELOPMENT
    assert draw.seed_of_commit("0123abc") != draw.seed_of_commit("0123abd")

    # A slope under a ball that sticks is not made as without friction. Of a frictionless ball the force stands on
    # the slope; of one that sticks it hardly turns
    libraries = {"small": library}
    assert {"wedge", "turned body"} <= set(draw.known_on(libraries, "concealed"))
    assert not {"wedge", "turned body"} & set(draw.known_on(libraries, "rough"))


@pytest.mark.parametrize("base", draw.BASES)
def test_every_base_is_a_study(base):
    study = load_study(sets.CONFIG / f"{base}.yaml")
    cells = plan_cells(study)
    sensor = SENSORS[draw.BASES[base].sensor]
    x, y = sensor.middle
    assert {(c.x_mm - x, c.y_mm - y) for c in cells.values()} == set(sensor.plan.places)
    assert {c.depths_mm for c in cells.values()} == {sensor.plan.depths}
    body, layers = sensor.plain, {layer.name: layer.thickness_mm for layer in study.sensor.layers}
    assert layers == {"gel": body.gel_mm, "skin": body.skin_mm}
    assert (study.sensor.width_x_mm, study.indenter.radius_mm) == (body.width_mm, body.radius_mm)
    rough = dict(draw.BASES[base].changes).get("friction", 0.0) * FRICTION
    assert study.mechanics.friction == body.friction + rough
    assert np.isclose(study.mechanics.effects.history.timing.step_mm, np.diff(sensor.plan.depths)).all()


def test_the_signal_is_that_of_the_whole_covariance(library):
    """By the matrix inverse, on a change of no shape; without the floor the signal is larger."""
    rows, instrument = plain()
    world, on = World(library), held(rows)
    change = np.random.default_rng(3).normal(0, 0.01, (len(rows), 3))
    part, sigma = rows[on], np.tile(instrument.sigma_N, on.sum())
    slope = (world.forces(rows, 0.005) - world.forces(rows, -0.005))[on].ravel() / 0.01
    fz = np.repeat(np.abs(world.forces(rows)[on, 2]), 3) * np.tile(recording.FLOOR, on.sum())
    press, axis = np.repeat(part["order"].to_numpy(), 3), np.tile([0, 1, 2], on.sum())
    place = np.repeat(part.groupby(["x_mm", "y_mm"]).ngroup().to_numpy(), 3)
    same_press, same_place = press[:, None] == press, place[:, None] == place
    C = np.diag(sigma**2) + same_press * (axis[:, None] == axis) * np.outer(sigma, sigma) / 3
    C += same_press * np.outer(slope, slope) * instrument.touchdown_mm**2
    without = recording.signal_to_noise(world, rows, instrument, change, floor=False)
    d = change[on].ravel()
    assert without == pytest.approx(np.sqrt(d @ np.linalg.solve(C, d)), rel=1e-9)
    C += (1 + same_place) / 2 * np.outer(fz, fz)
    found = recording.signal_to_noise(world, rows, instrument, change)
    assert found == pytest.approx(np.sqrt(d @ np.linalg.solve(C, d)), rel=1e-9)
    assert found < without


@pytest.mark.parametrize("form", kinds.KINDS)
def test_baselines_can_put_every_kind(form, library):
    """Along each of its shapes, with the constants that they assume: a new kind needs its line there."""
    kind, rows = kinds.KINDS[form], presses.timeline(np.random.default_rng(0), PLAN, sessions=2)
    rows = recording.with_circumstances(rows, recording.drawn_instrument(np.random.default_rng(0), 2))
    for hyperparameters in baselines.SHAPES[baselines.SHAPE_OF.get(form, "sign")]:
        world = World(library)
        kind.put(world, 0.2, baselines.CONSTANTS | hyperparameters)
        assert np.isfinite(world.forces(rows)).all()


def test_friction_lags_by_its_bands_and_backlash_behind_the_last_move(library):
    # Friction in the force sensor lags by the mean of its bands. Behind the force during loading, ahead during
    # unloading, by 2 % of the recording's largest force; the rest clean
    rows = presses.timeline(np.random.default_rng(1), PLAN, sessions=1)
    plain, rubbing = World(library), World(library)
    kinds.KINDS["play"].put(rubbing, 1.0, {"sign": 1.0})
    before, after = plain.forces(rows), rubbing.forces(rows)
    half = 0.02 * np.abs(before[:, 2]).max()
    deep = np.abs(before[:, 2]) > 4 * half  # the wider band has been gone through
    down, up = (rows["phase"] == "load").to_numpy() & deep, (rows["phase"] == "unload").to_numpy() & deep
    assert down.any() and up.any()
    assert_allclose((after - before)[down, 2], -np.sign(before[down, 2]) * half, rtol=1e-9)
    assert_allclose((after - before)[up, 2], np.sign(before[up, 2]) * half, rtol=1e-9)
    assert np.array_equal(after[:, :2], before[:, :2])

    # Backlash leaves the stage behind its last move. Moves of the plan are longer than the play, so each takes it
    # up; a session begins in its middle
    world, rows = World(library), presses.timeline(np.random.default_rng(1), PLAN, sessions=2)
    kinds.KINDS["backlash"].put(world, 1.0, {"x": 1.0, "y": 0.5})
    xy = world.reached(rows, np.zeros(len(rows)))[0]
    sent = rows[["x_mm", "y_mm"]].to_numpy()
    for of_session in rows.groupby("session").groups.values():
        behind, before = np.zeros(2), None
        for _, press in rows.loc[of_session].groupby("order", sort=True):
            here, landed = sent[press.index[0]], xy[press.index]
            if before is not None:
                move = np.sign(here - before)
                behind = np.where(move == 0, behind, -move * [0.2, 0.1])
            assert_allclose(landed, np.tile(here + behind, (len(press), 1)), atol=1e-12)
            before = here


# ------------------------------------------------------------------------------------------------------------ adhesion
RADIUS, MODULUS = 5.0, 0.08  # mm, MPa: a half space


class HalfSpace:
    """Hertz's ball in place of FElupe's solutions: F = 4/3 E* sqrt(R) d^1.5, A = pi R d."""

    library = SimpleNamespace(area=np.array([np.pi * RADIUS]))

    def __init__(self):
        self.history = []

    def elastic(self, xy, depth):
        pressing = 4 / 3 * MODULUS * np.sqrt(RADIUS) * np.maximum(depth, 0.0) ** 1.5
        return -pressing[:, None] * np.array([0.0, 0.0, 1.0])


def test_adhesion_on_a_half_space_is_johnson_kendall_and_roberts():
    """At a held depth, where the pull is far smaller than at a held contact: 2.1 mN against 34 to 83 here."""
    world, size = HalfSpace(), 1.3
    body_forms.adhesion(world, size, {})
    depth = np.array([0.4, 0.8, 1.6, 0.8])
    rows = pd.DataFrame({"phase": ["unload", "unload", "unload", "load"]})
    pull = world.history[0](world, rows, np.zeros((4, 2)), depth, np.zeros((4, 3)))
    w = 1e-4 * size

    def without(d):
        return 4 / 3 * MODULUS * np.sqrt(RADIUS) * d**1.5

    def held(d):  # the radius of the contact from the depth, then the force
        a = brentq(lambda a: a**2 / RADIUS - np.sqrt(2 * np.pi * a * w / MODULUS) - d, 1e-2, 2 * RADIUS)
        return 4 / 3 * MODULUS * a**3 / RADIUS - np.sqrt(8 * np.pi * w * MODULUS * a**3)

    expected = [without(d) - held(d) for d in depth[:3]]
    assert_allclose(pull[:3, 2], expected, rtol=0.02)  # differences over 0.02 mm
    assert_allclose(expected[2], np.pi * RADIUS * w, rtol=0.1)  # to first order
    assert not pull[3].any() and not pull[:, :2].any()


def test_separation_is_what_the_best_other_effect_leaves(library):
    """A change that another effect makes too is not separate from it, one at a right angle is as separate as it is large."""
    rows, instrument = plain()
    base = World(library)
    gel = change(base, "gel moduli", rows, instrument)
    alone = separation.separation(
        base, ["gel moduli"], kinds.KINDS["amplifier gains"], gel, rows, instrument, ()
    )
    assert alone["nearest"] == "gel_stiffness" and alone["snr"] < 1e-3 * size(base, gel, rows, instrument)
    other = separation.separation(base, ["turned grid"], kinds.KINDS["gel moduli"], gel, rows, instrument, ())
    assert other["nearest"] == "yaw"
    assert 0.9 * size(base, gel, rows, instrument) < other["snr"] <= size(base, gel, rows, instrument)


def change(base, form, rows, instrument):
    world = World(base.library)
    kind = kinds.KINDS[form]
    kind.put(world, 0.5, kind.draw(np.random.default_rng(3)))
    return recording.change_of(base, world, rows, instrument.tared)


def size(base, of, rows, instrument):
    return recording.signal_to_noise(base, rows, instrument, of)
