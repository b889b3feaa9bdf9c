"""config.patch.yaml: the study with its keys, pressed as any study, reads what the judge calls "after"."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import specimens
import yaml
from numpy.testing import assert_allclose
from recorded import SITES, record

from gelforge.config import study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE as SOLVER_EFFECTS
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem.nominal import with_known
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.fem.solver import base_of, forces_with
from gelforge.mismatch.pipeline.experiments import planned_observations
from gelforge.mismatch.pipeline.stage import judge_recording, patch_of
from gelforge.mismatch.result.verdict_tables import READINGS, read_table
from gelforge.mismatch.thresholds import REACH_MM

DEPTHS = (0.6, 1.2)
PLAN = {"grid": {"spacing_mm": 6.0, "margin_mm": 5.0}, "depths_mm": [0.6, 1.2]}
SAME = 1e-6  # of the largest force: mechanics.force_tolerance, at which both presses stop
FAR = 0.006  # of the force: what a defect farther away than it is followed still changes, see solver.REACH_MM


@pytest.fixture(scope="module", autouse=True)
def one_mesh():
    """Let changes be solved on the study's own mesh, so that no mesh's error stands between the two."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Solver, "coarse", property(lambda solver: solver.seen(unmirrored(solver.study))))
        yield


def study(*tried, **keys):
    settings = {
        "leave_out": sorted(set(CATALOGUE) - set(tried)),
        "discretisation": 0.002,
    }
    small = specimens.study(plan=PLAN).model_dump(mode="json")
    return study_from(merged(small, {"mismatch": settings | keys}))


def patched(plain, patch):
    return study_from(merged(plain.model_dump(mode="json"), patch))


def pressed(study, sites, depths):
    """Return the forces (S, D, 3) [N] of a study's own presses, as its force sensor reads them."""
    cells = [simulate_cell(study, specimens.STUDY_LAWS, PlannedCell("p", *site, depths)) for site in sites]
    assert all(cell.converged for cell in cells)
    forces = np.array([cell.arrays["total_force_N"] for cell in cells])
    for known in study.mismatch.known:  # of the force sensor
        assert known.effect == "force_gain"
        forces = forces * (1 + np.array([known.parameters[axis] for axis in "xyz"]))
    return forces


# What is solved, moved or has a place goes to mechanics, the force sensor to mismatch.known.
CASES = {
    "depth zero": [("contact_zero", [0.06])],
    "gel and tilt": [("gel_stiffness", [0.3]), ("tilt", [1.5, -0.5])],
    "wall and gain": [("wall_stiffness", [0.5]), ("force_gain", [0.1, 0.0, -0.1])],
    "void": [("void", [0.6])],
}


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("case", CASES)
def test_the_patched_study_presses_what_the_judge_calls_after(case, tmp_path):
    plain = study()
    solver, planned = (
        Solver(plain, specimens.STUDY_LAWS, {}, tmp_path),
        planned_observations(plain, dwell_s=()),
    )
    base = base_of(solver, planned, [])
    effects = [(CATALOGUE[name], np.array(theta)) for name, theta in CASES[case]]
    chosen = [(effect, effect.grid(base.context)[0], theta) for effect, theta in effects]
    after = forces_with(solver, base, chosen)
    terms = [
        (SimpleNamespace(name=effect.name, hyperparameters=hyperparameters), a)
        for effect, hyperparameters, a in chosen
    ]
    there = patched(plain, yaml.safe_load(yaml.safe_dump(patch_of(plain, CATALOGUE, terms))))
    presses = pressed(there, planned.sites, DEPTHS)[
        planned.table["site"], np.searchsorted(DEPTHS, planned.table["depth_mm"])
    ]
    near = np.ones(len(after), bool)
    for _, hyperparameters, _ in chosen:
        if "x_mm" in hyperparameters:
            away = planned.table[["x_mm", "y_mm"]] - [hyperparameters["x_mm"], hyperparameters["y_mm"]]
            near = np.linalg.norm(away, axis=1) < REACH_MM
    assert 0 < near.sum() and np.abs(after - base.context.force)[near].max() > 0.03  # N: without the patch
    size = np.abs(after).max()
    assert_allclose(presses[near], after[near], rtol=0, atol=SAME * size)
    assert_allclose(presses[~near], after[~near], rtol=0, atol=FAR * size)
    judged_by = with_known(base_of(replace(solver, study=there), planned, []), replace(solver, study=there))
    assert_allclose(judged_by.context.force[near], after[near], rtol=0, atol=SAME * size)


@pytest.mark.parametrize(
    ("name", "hyperparameters", "value"),
    [("viscoelastic", {"part": "gel", "time_s": 1.0}, 0.3), ("ageing", {}, 0.01)],
)
def test_a_patched_base_is_followed_in_the_time_of_the_readings(name, hyperparameters, value, tmp_path):
    """Two sessions 30 days apart, each press read as it arrives and half a second later."""
    plain, effect = study(), CATALOGUE[name]
    planned = planned_observations(plain, dwell_s=(0.5,), ages_days=(0.0, 30.0))
    planned = planned.chosen((planned.table["site"] == 0).to_numpy())
    solver = Solver(plain, specimens.STUDY_LAWS, {}, tmp_path)
    base = base_of(solver, planned, [])
    after = forces_with(solver, base, [(effect, hyperparameters, np.array([value]))])
    assert np.abs(after - base.context.force).max() > 0.03  # N: without the patch
    term = SimpleNamespace(name=name, hyperparameters=hyperparameters), np.array([value])
    there = patched(plain, patch_of(plain, CATALOGUE, [term]))
    judged_by = base_of(replace(solver, study=there), planned, [])
    assert_allclose(judged_by.context.force, after, rtol=0, atol=SAME * np.abs(after).max())
    # What a refit next to it changes is its own, and not what the time has changed already.
    still = forces_with(
        replace(solver, study=there), judged_by, [(CATALOGUE["gel_stiffness"], {}, np.array([1e-9]))]
    )
    assert_allclose(still, judged_by.context.force, rtol=0, atol=SAME * np.abs(after).max())


@pytest.mark.thorough
def test_a_verdict_s_patch_gives_its_figure_after(tmp_path):
    """Two hidden effects, found and put into the patch; the patched study's presses leave what the verdict says."""
    plain = study("gel_stiffness", "tilt")
    hidden = SOLVER_EFFECTS["tilt"](SOLVER_EFFECTS["gel_stiffness"](plain, 0.4), 3.0)
    session = record(tmp_path / "two", hidden, specimens.STUDY_LAWS, sites=SITES[:4])
    verdict = judge_recording(
        Solver(plain, specimens.STUDY_LAWS, {}, tmp_path / "solves"), [session], tmp_path, "two"
    )
    (group, other), told = verdict.answer, read_table(tmp_path, READINGS)
    assert verdict.state == "identified" and {*group.members, *other.members} == {"gel_stiffness", "tilt"}
    there = patched(plain, yaml.safe_load((tmp_path / "config.patch.yaml").read_text()))
    presses = after_of(there, told)
    assert_allclose(presses, told["after_N"], rtol=0, atol=SAME * np.abs(presses).max())
    left = [rms((told["measured_N"] - presses)[told["axis"] == axis]) for axis in "xyz"]
    assert_allclose(left, verdict.fit.after.rmse_N, rtol=1e-4)  # of what is left, a tenth of the force
    assert left[2] < 0.3 * verdict.fit.before.rmse_N[2]


def after_of(study, told):
    """Return the force [N] of each row of readings.csv as a study's own presses give it."""
    found = np.empty(len(told))
    for site, rows in told.groupby(["x_mm", "y_mm"]).indices.items():
        depths = np.unique(told["depth_mm"].to_numpy()[rows])
        (forces,) = pressed(study, [site], tuple(depths))
        at = np.searchsorted(depths, told["depth_mm"].to_numpy()[rows])
        found[rows] = forces[at, told["axis"].map("xyz".index).to_numpy()[rows]]
    return found


def rms(values):
    return np.sqrt(np.mean(np.square(values)))
