"""The whole stage on small SYNTHETIC recordings: states, patch, tables, bad recordings."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import specimens
import yaml
from recorded import DEPTHS, SITES, record
from test_patched_study import after_of

from gelforge.config import ConfigError, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE as SOLVER_EFFECTS
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.candidates import effects_of_forces
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.pipeline import stage
from gelforge.mismatch.pipeline.stage import check_matches, judge_recording, told_apart_by_images
from gelforge.mismatch.readings import sessions
from gelforge.mismatch.readings.sessions import observe, session_folders
from gelforge.mismatch.result.verdict import read_verdict
from gelforge.mismatch.result.verdict_tables import READINGS, check_tables, read_table

# The recordings are made on the study's own coarse mesh, so that they do not show its error: it is stated as small.
MISMATCH = {"sites": 6, "discretisation": 0.002}


def small(**keys):
    study = specimens.study()
    return study_from(merged(study.model_dump(mode="json"), {"mismatch": MISMATCH, **keys}))


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return tmp_path_factory.mktemp("solves")


def solver(kept, study=None):
    return Solver(study or small(), specimens.STUDY_LAWS, {}, kept)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Return a session whose gel is 30 % stiffer than the study says."""
    folder = tmp_path_factory.mktemp("stiffer") / "stiffer"
    return record(folder, SOLVER_EFFECTS["gel_stiffness"](small(), 0.3), specimens.STUDY_LAWS)


@pytest.fixture(scope="module")
def stiffer(kept, session, tmp_path_factory):
    """Return the verdict on it and its folder of results."""
    folder = tmp_path_factory.mktemp("out")
    return judge_recording(solver(kept), [session], folder, "stiffer"), folder


@pytest.mark.thorough
def test_a_stiffer_gel_is_in_the_answer_with_its_amount(stiffer):
    verdict, _ = stiffer
    # Four that scale the forces share it with something unknown that grows with depth.
    assert verdict.state in ("identified", "ambiguous") and verdict.answer[0].probability > 0.8
    assert "gel_stiffness" in verdict.answer[0].names
    effect = next(e for e in verdict.effects if e.name == "gel_stiffness")
    low, high = effect.parameters[0].interval_90
    assert (
        low - 0.03 < 0.3 < high + 0.03
    )  # 0.03: a tenth, what Gauss and Newton may leave of a refit that is not the winner's
    assert verdict.fit.held_out.shown
    assert verdict.fit.held_out.after.rmse_N[2] < 0.5 * verdict.fit.held_out.before.rmse_N[2]


@pytest.mark.thorough
def test_the_patched_study_s_presses_are_near_the_figure_after(kept, session, tmp_path, monkeypatch):
    """Of what scales all layers alike, whose change no mesh errs by: within a tenth; others err by the coarser mesh.

    Whether six sites are enough to take it over is not asked here.
    """
    monkeypatch.setattr(stage, "taken_over", lambda judgement: True)
    study = only("body_stiffness", "tilt", "contact_zero")
    verdict = judge_recording(solver(kept, study), [session], tmp_path, "stiffer")
    assert verdict.answer[0].members == ["body_stiffness"]
    told, patch = read_table(tmp_path, READINGS), yaml.safe_load((tmp_path / "config.patch.yaml").read_text())
    presses = after_of(study_from(merged(small().model_dump(mode="json"), patch)), told)
    largest = np.abs(told["after_N"] - told["base_N"]).max()
    assert np.abs(presses - told["after_N"]).max() < 0.1 * largest


def only(*names):
    """Return a study for which the catalogue has these effects alone."""
    return small(mismatch=MISMATCH | {"leave_out": sorted(set(CATALOGUE) - set(names))})


def test_tables_and_verdict_read_back(kept, session, tmp_path):
    """Whatever the catalogue: with few effects the verdict takes seconds."""
    study, out = only("gel_stiffness", "tilt", "contact_zero"), tmp_path / "out"
    verdict = judge_recording(solver(kept, study), [session], out, "stiffer")
    assert verdict.answer[0].members == ["gel_stiffness"]
    assert read_verdict(out) == verdict
    assert set(verdict.tables) == {path.name for path in out.glob("*.csv")}
    check_tables(out, verdict)
    told = read_table(out, READINGS)
    assert len(told) == 3 * len(SITES) * len(DEPTHS) * 5  # axes, sites, depths, a load and four dwell rows
    assert set(told["held_out"]) == {"no", "positions", "deepest"}
    assert verdict.effects[0].snr > 4
    assert np.isfinite(told["after_N"]).all() and (told["sigma_N"] > 0).all()
    assert json.loads((out / "verdict.json").read_text())["synthetic"] is True


@pytest.mark.thorough
def test_the_same_recording_gives_the_same_bytes(stiffer, session, kept, tmp_path):
    _, out = stiffer
    judge_recording(solver(kept), [session], tmp_path, "stiffer")
    for name in ("verdict.json", "readings.csv"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()


@pytest.mark.thorough
def test_a_force_gain_is_found_and_goes_to_the_patch_as_known(kept, tmp_path):
    """Of one lateral axis only, which no gel does."""
    session = record(
        tmp_path / "gain",
        small(),
        specimens.STUDY_LAWS,
        lambda rows, f: f * [1.0, 1.25, 1.0],
        seed=2,
        noise_N=0.001,
    )
    verdict = judge_recording(solver(kept), [session], tmp_path / "out", "gain")
    assert verdict.state == "identified"
    assert verdict.answer[0].members[0] == "force_gain"
    patch = yaml.safe_load((tmp_path / "out" / "config.patch.yaml").read_text())
    (known,) = patch["mismatch"]["known"]
    assert known["effect"] == "force_gain"
    # Less than the 0.25 that is there: the prior's width is 0.05, and this coarse mesh's error takes part of it
    assert known["parameters"]["y"] > 2 * max(abs(known["parameters"]["x"]), abs(known["parameters"]["z"]))
    patched = study_from(merged(small().model_dump(mode="json"), patch))
    again = judge_recording(solver(kept, patched), [session], tmp_path / "again", "gain")
    assert again.mismatch.chi2 < 0.6 * verdict.mismatch.chi2


@pytest.mark.thorough
def test_what_the_catalogue_lacks_is_not_named_and_a_base_is_consistent(session, kept, tmp_path):
    # What the catalogue lacks is not named without it. Without everything that scales the forces the stiffer gel is
    # no longer explained
    lacking = tmp_path / "lacking"
    lacking.mkdir()
    study = only("cross_talk", "clock_offset", "tilt", "yaw", "friction")
    found = judge_recording(solver(kept, study), [session], lacking, "strange")
    assert found.state in ("unexplained",)

    # A recording of the base itself is consistent
    base = tmp_path / "base"
    base.mkdir()
    session = record(base / "plain", small(), specimens.STUDY_LAWS, seed=1)
    verdict = judge_recording(solver(kept), [session], base / "out", "plain")
    assert verdict.state == "consistent"
    assert verdict.mismatch.p > 0.01 and verdict.answer == []
    assert not (base / "out" / "config.patch.yaml").exists()


# --- recordings that say less, or nothing


def changed(session, tmp_path, change, yaml_lines=""):
    """Return a copy of a session with another table."""
    folder = tmp_path / session.name
    folder.mkdir()
    table = change(pd.read_csv(session / "indentations.csv"))
    table.to_csv(folder / "indentations.csv", index=False)
    (folder / "session.yaml").write_text((session / "session.yaml").read_text() + yaml_lines)
    return folder


def observed(folder):
    return observe([folder], small().sensor)


def test_a_dead_axis_a_far_reading_and_missing_repeats_are_told(session, tmp_path):
    # A dead axis is left out and reported
    dead = tmp_path / "dead"
    dead.mkdir()
    found = observed(changed(session, dead, lambda t: t.assign(fx_N=0.0)))
    assert not found.read[:, 0].any() and found.read[:, 1:].all()
    assert any("Fx never changes" in said for said in found.cannot_know)

    # Missing repeats and unloading are reported
    missing = tmp_path / "missing"
    missing.mkdir()
    said = observed(session).cannot_know
    assert any("two indentations to one depth" in s for s in said) and any(
        "during unloading" in s for s in said
    )
    once = changed(session, missing, lambda t: t[t["phase"] != "dwell"].drop_duplicates(["press", "phase"]))
    assert any("repeated readings" in s for s in observed(once).cannot_know)

    # A reading far off is left out. By the tests of a session, before anything is judged; what they cannot see is
    # held out by its residual
    far = tmp_path / "far"
    far.mkdir()

    def spoil(table):
        row = table.index[table["phase"] == "dwell"][7]
        table.loc[row, "fz_N"] -= 1.0
        return table

    found = observed(changed(session, far, spoil))
    assert not found.set_aside
    assert len(found.table) == len(observed(session).table) - 1


def test_the_stage_s_moves_and_its_raster_order_are_told(tmp_path, session):
    # Raster order is reported
    folder = record(tmp_path / "raster", small(), specimens.STUDY_LAWS, sites=sorted(SITES), order=range(18))
    assert any("raster order" in said for said in observed(folder).cannot_know)

    # The stage's moves are known from the presses before. Of all presses, whether they are judged or not; an axis
    # that did not move keeps its last move
    found = observed(session)
    at = pd.read_csv(session / "indentations.csv").groupby("press", sort=False)[["x_mm", "y_mm"]].first()
    signs = np.sign(np.diff(at.to_numpy(), axis=0, prepend=at.to_numpy()[:1]))
    for earlier, now in zip(signs, signs[1:]):
        now[now == 0] = earlier[now == 0]
    number = [list(at.index).index(press.split("/")[1]) for press in found.table["press"]]
    assert np.array_equal(found.came_along, [np.diag(both) for both in signs[number]])
    assert set(np.unique(signs)) == {-1.0, 0.0, 1.0}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t[t["phase"] != "zero"], "zero row"),
        (lambda t: t.assign(time_s=-t["time_s"]), "time_s"),
        (lambda t: t.assign(x_mm=t["x_mm"] + 30), "the sensor is 16.0 x 16.0 mm"),
        (lambda t: t.assign(fz_N=-t["fz_N"]), "acts_on|sign|push|pull"),
        (lambda t: t.assign(fz_N=t["fz_N"].clip(lower=0.3 * t["fz_N"].min())), "saturated"),
    ],
)
def test_recordings_that_cannot_be_judged_are_refused_with_a_remedy(session, tmp_path, change, words):
    with pytest.raises(ValueError, match=words):
        observed(changed(session, tmp_path, change))


def test_sessions_in_a_folder_are_found_and_another_indenter_is_refused(session, tmp_path):
    # Another indenter than the study describes is refused
    indenter = tmp_path / "indenter"
    indenter.mkdir()
    folder = changed(session, indenter, lambda t: t, "indenter: ball of radius 2 mm\n")
    with pytest.raises(ConfigError, match="give the study"):
        check_matches([folder], small())

    # Sessions are found in a folder of recordings
    sessions = tmp_path / "sessions"
    sessions.mkdir()
    (sessions / "recordings").mkdir()
    folder = changed(session, sessions / "recordings", lambda t: t)
    assert (
        session_folders(sessions)
        == session_folders(sessions / "recordings")
        == session_folders(folder)
        == [folder]
    )
    assert session_folders(sessions, [folder.name, "absent"]) == [folder]
    with pytest.raises(ConfigError, match="no session"):
        session_folders(sessions, ["absent"])
    (sessions / "empty").mkdir()
    with pytest.raises(ConfigError, match="no session"):
        session_folders(sessions / "empty")


def fits_but_not_at(times, remedy, session, tmp_path, words):
    """Assert that an indenter in words is the study's, and that of a radius so many times as large is refused."""
    radius = small().indenter.radius_mm
    same = changed(session, tmp_path, lambda t: t, f"indenter: {words.format(r=radius, d=2 * radius)}\n")
    check_matches([same], small())
    other = study_from(merged(small().model_dump(mode="json"), {"indenter": {"radius_mm": times * radius}}))
    with pytest.raises(ConfigError, match=remedy):
        check_matches([same], other)


@pytest.mark.parametrize(
    "words",
    [
        *("ball of radius {r} mm", "steel ball, diameter {d} mm", "{d} mm diameter ball"),
        *("\u00d8{d} mm steel", "ball, d = {d} mm", "{d}mm dia ball"),
    ],
)
def test_a_diameter_is_no_radius(session, tmp_path, words):
    fits_but_not_at(2, "give the study", session, tmp_path, words)


@pytest.mark.parametrize("words", ["ball {r} mm", "ball {d} mm"])
def test_a_number_that_is_said_to_be_neither_may_be_both(session, tmp_path, words):
    fits_but_not_at(3, "correct `indenter`", session, tmp_path, words)


@pytest.mark.parametrize("key", ["rivals", "noise_scales"])
def test_a_key_of_before_is_refused_as_any_unknown_one(key):
    with pytest.raises(ConfigError, match=key):
        small(mismatch={key: 1})


def test_an_effect_left_out_that_there_is_not_is_refused():
    with pytest.raises(
        ConfigError, match=r"no effect \['gel_stifness'\]; the catalogue has .*'gel_stiffness'"
    ):
        effects_of_forces(small(mismatch={"leave_out": ["gel_stifness", "yaw"]}))
    assert "yaw" not in effects_of_forces(small(mismatch={"leave_out": ["yaw"]}))


def test_a_recording_is_read_once(session, kept, tmp_path, monkeypatch):
    read, whole = [], sessions.read_recording

    def counted(folder, *others):
        read.append(folder)
        return whole(folder, *others)

    monkeypatch.setattr(sessions, "read_recording", counted)
    judge_recording(
        solver(kept, only("gel_stiffness", "tilt", "contact_zero")), [session], tmp_path, "stiffer"
    )
    assert read == [session]


def group(*names):
    return SimpleNamespace(names=names)


@pytest.mark.parametrize(
    ("groups", "left"),
    [
        ([("gel_stiffness",)], set()),  # nothing to distinguish
        ([("force_gain", "body_stiffness")], set()),  # the gel moves alike
        ([("force_gain", "gel_stiffness")], {"force_gain", "gel_stiffness", "tilt"}),
        ([("tilt",), ("force_gain", "force_offset")], set()),
    ],
)
def test_images_are_read_where_they_distinguish_what_forces_leave(groups, left):
    parts = [SimpleNamespace(name=names[0]) for names in groups] + [SimpleNamespace(name="tilt")]
    answer = SimpleNamespace(groups=[group(*names) for names in groups], fit=SimpleNamespace(parts=parts))
    assert told_apart_by_images(SimpleNamespace(answer=answer)) == left
    assert told_apart_by_images(SimpleNamespace(answer=None)) == set()
