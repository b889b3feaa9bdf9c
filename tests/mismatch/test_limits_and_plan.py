"""`gelforge mismatch limits` and `gelforge mismatch plan` on a coarse small sensor, against what is then recorded."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import specimens
from artificial_readings import draws_of
from recorded import record
from test_verdict import content, effect

from gelforge.cli import main
from gelforge.config import study_from, write_yaml
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE as SOLVER_EFFECTS
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.screen import screened
from gelforge.mismatch.fem import solutions
from gelforge.mismatch.fem.nominal import problem_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.pipeline.experiments import limits_table, planned_observations, planned_problem
from gelforge.mismatch.pipeline.stage import solver_of
from gelforge.mismatch.result.verdict import Verdict, write_verdict
from gelforge.mismatch.thresholds import DECISIVE, DETECTED_SNR

TRIED = ("contact_zero", "force_gain", "gel_stiffness")
NARROW = {
    "grid": {"spacing_mm": 6.0, "margin_mm": 5.0},
    "depths_mm": [0.6, 1.2],
}  # four corners: one press and its images
WIDER = {
    "grid": {"spacing_mm": 3.0, "margin_mm": 5.0},
    "depths_mm": [0.3, 0.6, 0.9, 1.2],
}  # all of these, and more


def study(**plan):
    """Return a study whose judge tries three effects; its mesh's own error is stated as small."""
    settings = {
        "leave_out": sorted(set(CATALOGUE) - set(TRIED)),
        "discretisation": 0.002,
        "coarser": 1.5,
    }
    keys = {"mismatch": settings}
    return study_from(merged(specimens.study(plan=plan or NARROW).model_dump(mode="json"), keys))


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Return a folder with the study's file."""
    folder = tmp_path_factory.mktemp("ahead")
    write_yaml(folder / "small.yaml", study().model_dump(mode="json"))
    return folder


def command(home, *arguments):
    """Return the exit status of gelforge mismatch with the study and solutions of a folder."""
    where = ("--config", str(home / "small.yaml"), "--kept", str(home / "solves"))
    return main(["mismatch", *map(str, arguments), *where])


@pytest.fixture(scope="module")
def solver(home):
    return solver_of(study(), home, [], home / "solves", 1, [])


@pytest.fixture(scope="module")
def limits(solver):
    return limits_table(planned_problem(solver))


# --- limits


def test_limits_prints_and_writes_every_value_next_to_a_plausible_one(
    home, limits, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert command(home, "limits") == 0
    written = pd.read_csv(tmp_path / "results/small/mismatch/limits.csv")
    # the file has five or six figures, and its checksum as the name of a last, empty column
    pd.testing.assert_frame_equal(written[limits.columns], limits, rtol=1e-4)
    assert list(written["effect"]) == ["contact_zero", *3 * ["force_gain"], "gel_stiffness"]
    for row in written.itertuples():
        parameter = next(p for p in CATALOGUE[row.effect].parameters if p.name == row.parameter)
        assert (row.unit, row.plausible) == (parameter.unit, parameter.width)
        assert row.plausible_value_seen == (row.detectable <= row.plausible)
    printed = capsys.readouterr().out
    assert all(name in printed for name in TRIED) and f"{limits['detectable'].iloc[0]:.3g}" in printed


def test_limits_names_what_could_not_be_tried_and_why(home, monkeypatch, capsys):
    """A derivative that the solver cannot give has no limit: its effect is not among those that nothing would show."""
    solve = solutions.each_derivative

    def without_gel(*arguments):
        base, along = solve(*arguments)
        return base, {key: "it folds" if key == "gel_stiffness" else one for key, one in along.items()}

    monkeypatch.setattr(solutions, "each_derivative", without_gel)
    where = (
        "--config",
        str(home / "small.yaml"),
        "--kept",
        str(home / "other"),
        "--out",
        str(home / "named"),
    )
    assert main(["mismatch", "limits", *where]) == 0
    assert "gel_stiffness" not in set(pd.read_csv(home / "named/limits.csv")["effect"])
    assert "gel_stiffness could not be tried: it folds" in capsys.readouterr().out


def pressed(study, value, table):
    """Return the forces (R, 3) [N] at planned readings of a gel that is so much stiffer, on the study's own mesh.

    All positions of NARROW are images of one.
    """
    stiffer = SOLVER_EFFECTS["gel_stiffness"](study, value)
    cell = replace(next(iter(plan_cells(study).values())), source=None)
    total = simulate_cell(stiffer, specimens.STUDY_LAWS, cell).arrays["total_force_N"]
    force = total[np.searchsorted(cell.depths_mm, table["depth_mm"])]
    force[:, 0] *= np.where(table["x_mm"] == cell.x_mm, 1, -1)
    force[:, 1] *= np.where(table["y_mm"] == cell.y_mm, 1, -1)
    return force


@pytest.mark.thorough
def test_a_recording_shows_the_limit_s_value_as_promised(home):
    """Pressed on the study's own mesh it is DETECTED_SNR away from the base, and five times as much is read as that.

    Within 10 %, by which the judge allows a change on its coarser mesh to err; the mesh is finer than elsewhere for that,
    and depth zero well known, so that five times the limit is still a change in proportion.
    """
    mesh = {"near_mm": 0.6}
    keys = {"mechanics": {"mesh": mesh}, "mismatch": {"contact_point_scatter_mm": 0.002}}
    own = study_from(merged(study().model_dump(mode="json"), keys))
    solver, planned = Solver(own, specimens.STUDY_LAWS, {}, home / "solves"), planned_observations(own)
    problem, _ = problem_of(solver, planned, recorded=False)
    limit = limits_table(problem).set_index("effect").loc["gel_stiffness", "detectable"]
    base, there, far = (pressed(own, k * limit, planned.table) for k in (0, 1, 5))
    snr = np.linalg.norm(problem.covariance.whiten(planned.flat(there - base)))
    assert snr == pytest.approx(DETECTED_SNR, rel=0.1)
    noise = draws_of(problem.covariance, np.random.default_rng(1), 1)[:, 0]
    force = far.copy()
    force[planned.read] += noise
    recorded = replace(problem, observations=replace(planned, force=force))
    found = {one.name: one for one in screened(recorded.residual, recorded.covariance, recorded.candidates)}
    assert found["gel_stiffness"].snr == pytest.approx(
        5 * DETECTED_SNR, rel=0.1, abs=3
    )  # and three deviations of noise


def test_a_wider_plan_has_smaller_limits(solver, limits):
    wider = limits_table(planned_problem(replace(solver, study=study(**WIDER))))
    assert list(wider["effect"]) == list(limits["effect"])
    assert (wider["detectable"] < limits["detectable"]).all()


# --- plan


@pytest.fixture(scope="module")
def judged(home):
    """Return the folder with the verdict on a session whose gel is 30 % stiffer than the study says."""
    stiffer = SOLVER_EFFECTS["gel_stiffness"](study(), 0.3)
    sites = [(8.0, 8.0), (5.0, 8.0), (5.0, 5.0)]
    session = record(home / "stiffer", stiffer, specimens.STUDY_LAWS, sites=sites)
    assert command(home, session, "--out", home / "out", "--no-page") == 0
    return home / "out"


@pytest.mark.thorough
def test_plan_prints_and_writes_what_to_record_next(home, judged, capsys):
    """A stiffer gel is a gain under displacement control: only dead weights part them, at 20 s for each of 12."""
    capsys.readouterr()
    assert command(home, "plan", "--out", judged) == 0
    table, printed = pd.read_csv(judged / "experiments.csv"), capsys.readouterr().out
    # next to a last, empty column whose name is the checksum
    assert list(table.columns)[:-1] == [
        "tells apart",
        "experiment",
        "minutes",
        "expected_log_odds",
        "decides",
    ]
    assert set(table["tells apart"]) == {"gel_stiffness or force_gain"}
    assert all(name in printed for name in table["experiment"])
    assert (table["decides"] == (table["expected_log_odds"] >= DECISIVE)).all()
    first, others = table.iloc[0], table.iloc[1:]
    assert first["experiment"].startswith("dead weights") and first["decides"]
    assert first["minutes"] == pytest.approx(12 * 20 / 60)
    assert not others["decides"].any() and (others["expected_log_odds"] > 0).all()
    assert others["expected_log_odds"].is_monotonic_decreasing  # of those that do not decide what tells most


@pytest.mark.thorough
def test_an_experiment_costs_its_presses(home, judged):
    """Way down at 1 mm/s, readings for 0.9 or 60 s, and 8 s to the next of eight presses."""
    assert command(home, "plan", "--out", judged) == 0
    minutes = pd.read_csv(judged / "experiments.csv").set_index("experiment")["minutes"]
    presses, down = 8, 4 * (0.6 + 1.2)
    assert minutes["the same plan again"] * 60 == pytest.approx(down + presses * 0.9 + (presses - 1) * 8)
    dwelling = minutes["the same plan with dwells of 60 s"]
    assert dwelling * 60 == pytest.approx(down + presses * 60 + (presses - 1) * 8)
    # two sessions, and the way between them
    assert minutes["the same plan now and in 30 days"] * 60 == pytest.approx(2 * (down + presses * 8.9) - 8)


def test_where_readings_cannot_tell_the_plan_says_what_would(home, tmp_path, limits):
    """Of three effects a stiffness, a gain and a depth zero; another session has another zero of its depth."""
    found = content(state="inconclusive", answer=[], effects=[])
    write_verdict(tmp_path, Verdict.model_validate(found))
    assert command(home, "plan", "--out", tmp_path) == 0
    table = pd.read_csv(tmp_path / "experiments.csv").set_index("experiment")
    assert table.loc["the same plan again", "plausible_values_seen"] == limits["plausible_value_seen"].sum()
    assert pd.isna(table.loc["the same plan again", "seen_newly"])
    again, later = table.loc["the same plan again"], table.loc["the same plan now and in 30 days"]
    assert later["plausible_values_seen"] >= again["plausible_values_seen"]
    assert later["minutes"] > again["minutes"]


# --- bad input


def refusal(home, capsys, *arguments):
    """Return what is printed of a command that is refused: one line."""
    capsys.readouterr()
    assert command(home, *arguments) == 1
    printed = capsys.readouterr().err
    assert printed.startswith("gelforge: ") and printed.count("\n") == 1
    return printed


def test_what_cannot_be_planned_is_refused(home, capsys, tmp_path):
    assert "verdict.json: no such file; write it anew with `gelforge mismatch`" in refusal(
        home, capsys, "plan", "--out", tmp_path
    )

    # A recording that is not there is refused
    assert "limit" in refusal(home, capsys, home / "limit", "--out", tmp_path)

    # No workers are refused
    for what in ("limits", "plan"):
        printed = refusal(home, capsys, what, "--out", tmp_path, "--workers", 0)
        assert "--workers 0: 1 or more are needed" in printed

    # A plan after a verdict with another table is refused
    (tmp_path / "readings.csv").write_text("of another verdict\n")
    write_verdict(tmp_path, Verdict.model_validate(content(tables={"readings.csv": "0" * 64})))
    printed = refusal(home, capsys, "plan", "--out", tmp_path)
    assert (
        "readings.csv: damaged or edited" in printed and "write it anew with `gelforge mismatch`" in printed
    )

    # A plan after a verdict that leaves no choice is refused
    write_verdict(tmp_path, Verdict.model_validate(content()))
    printed = refusal(home, capsys, "plan", "--out", tmp_path)
    assert "the verdict is identified" in printed and "nothing is to be decided" in printed
    assert not (tmp_path / "experiments.csv").exists()

    # What the camera alone sees is not for presses to tell
    names = ("camera_scale", "camera_pose")
    answer = [{"members": list(names), "probability": 0.97}]
    found = content(state="identified", answer=answer, effects=[effect(name, 0.5) for name in names])
    write_verdict(tmp_path, Verdict.model_validate(found))
    printed = refusal(home, capsys, "plan", "--out", tmp_path)
    assert "no indentation shows what the camera alone sees" in printed
    assert "camera_scale: a ruler or a checkerboard" in printed
