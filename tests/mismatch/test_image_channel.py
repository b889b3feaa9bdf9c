"""The images' channel on a small SYNTHETIC session: measured next to predicted flow, columns, covariance, both channels."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from gelforge.config import Camera, VirtualImaging
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE as SOLVER_EFFECTS
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.screen import screened
from gelforge.mismatch.fem.nominal import IMAGES_LEFT_OUT, observations_of, problem_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.images import flow_images
from gelforge.mismatch.images import flow_model as flow_model_module
from gelforge.mismatch.images.flow import COARSER, with_flow
from gelforge.mismatch.images.flow_covariance import Rows
from gelforge.mismatch.images.flow_images import (
    REGIONS,
    CameraView,
    even_points,
    likely_particles,
    seen_flows,
    shows_gel,
)
from gelforge.mismatch.images.flow_model import FlowUnknown, flow_model, motions_of
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.inference.patterns import dictionary
from gelforge.mismatch.pipeline.stage import judge_recording
from gelforge.mismatch.result.verdict import read_verdict
from gelforge.mismatch.result.verdict_tables import FLOW, READINGS, read_table
from gelforge.mismatch.summary.sections import after_of, flow_section
from gelforge.mismatch.thresholds import SCATTERED, SEEN_ERROR
from gelforge.recording.readings import read_recording
from gelforge.report.verdict.mismatch_flow import flow_residual_figure
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.virtual_lab.particles import VirtualLabError, gel_boxes

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import flow_channel

# What the screen knows at no cost of its own: enough to part the camera, the gel and the force sensor.
KEPT = {"gel_stiffness", "skin_stiffness", "contact_zero", "force_gain", "camera_scale", "camera_pose"}
SCALE = 0.06
DEEPER_MM = 0.1


@pytest.fixture(scope="module")
def study():
    """Return the study of the benchmark at three places and on a coarser mesh: a solution takes a second."""
    plain = flow_channel.small_study().model_dump(mode="json")
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": 6.5}, "depths_mm": [0.5, 1.0], "symmetry": "d4"}
    mismatch = {"leave_out": sorted(set(CATALOGUE) - KEPT), "sites": 4}
    mesh = {"near_mm": 0.6, "far_mm": 1.2}
    keys = {"plan": plan, "mismatch": mismatch, "mechanics": {"mesh": mesh}}
    return flow_channel.study_from(merged(plain, keys))


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """Return the folder of true cells, which sessions share."""
    return tmp_path_factory.mktemp("truth")


@pytest.fixture(scope="module")
def recorded(study, truth, tmp_path_factory):
    """Return a solver and a session that has been read, whose camera magnifies more than it says.

    Its truth is on the study's own mesh.
    """
    folder = tmp_path_factory.mktemp("flow")
    focal = flow_channel.CAMERA["focal_px"] * (1 + SCALE)
    case = flow_channel.Case("camera_scale", SCALE, 1.0, (0.0, 0.0, 0.0), {"focal_px": focal})
    session = flow_channel.record(case, study, 3, truth, folder / "out", study.mechanics.mesh)
    laws, _ = flow_channel.laws_and_doubts(flow_channel.material_laws_of(study, []))
    return Solver(study, laws, {}, folder / "solves"), read_recording(session, None, study.sensor)


@pytest.fixture(scope="module")
def joint(recorded, study):
    """Return the problem of that session with its images."""
    solver, session = recorded
    observations, _ = observations_of([session], study)
    forces, base = problem_of(solver, observations)
    return with_flow(solver, base, forces, [session])


def flow_entries(joint):
    return np.arange(len(joint.labels)) >= joint.flow.entries


@pytest.mark.thorough
def test_flow_is_the_measured_one_but_for_the_camera_and_a_far_defect_changes_none(joint):
    # Predicted flow is the measured one but for the camera
    mask = flow_entries(joint)
    measured = joint.observations.flat(joint.observations.force)[mask]
    predicted = joint.observations.flat(joint.base)[mask]
    # half of the growth is a larger flow, half is flow farther from the middle: see the column's test. The scale of one
    # placement of particles scatters by 3 % about the mean (measured): two of these
    assert_allclose(measured @ predicted / (predicted @ predicted), 1 + 2 * SCALE, atol=0.06)
    assert np.corrcoef(measured, predicted)[0, 1] > 0.97

    # A defect far from all images changes no flow. Forces elsewhere may show it: it stays a candidate. What the
    # study has no derivative of is not known
    model = joint.flow.model
    far = replace(model, known=model.known | {"void@7"})
    assert not far.change_along("void@7").any()
    with pytest.raises(FlowUnknown):
        model.change_along("void@7")


def test_forces_and_their_patterns_stay_clean_and_the_camera_leads(joint):
    # Forces are untouched and effects move their own channel
    forces, n = joint.flow.forces, joint.flow.entries
    assert np.array_equal(joint.residual[:n], forces.residual)
    assert (joint.labels["channel"][:n] == "force").all() and (joint.labels["channel"][n:] == "flow").all()
    assert_allclose(joint.covariance.standard_deviation[:n], forces.covariance.standard_deviation, rtol=1e-12)

    # Camera moves no force and the force sensor no image
    n = joint.flow.entries
    by_name = {candidate.name: candidate.columns for candidate in joint.candidates}
    for name in ("camera_scale", "camera_pose"):
        assert not by_name[name][:n].any() and by_name[name][n:].any()
    assert by_name["force_gain"][:n].any() and not by_name["force_gain"][n:].any()
    assert by_name["gel_stiffness"][:n].any() and by_name["gel_stiffness"][n:].any()

    # A flow f becomes (1 + a) f(p / (1 + a)): along f that is 1, and 1 more as -f p grad f
    # integrates to f^2.
    column = next(c for c in joint.candidates if c.name == "camera_scale").columns[joint.flow.entries :, 0]
    flow = joint.observations.flat(joint.base)[flow_entries(joint)]
    # less what leaves the image, and the gel's rim
    assert 1.5 < column @ flow / (flow @ flow) < 2.5

    # The camera leads with forces clean
    alone = screened(joint.flow.forces.residual, joint.flow.forces.covariance, joint.flow.forces.candidates)
    assert alone[0].log_bayes_factor < 5
    both = screened(joint.residual, joint.covariance, joint.candidates)
    assert both[0].name in ("camera_scale", "camera_pose")
    others = [s.log_bayes_factor for s in both if not s.name.startswith("camera")]
    assert both[0].log_bayes_factor > max(others) + 5
    scale = next(s for s in both if s.name == "camera_scale")
    # five standard deviations: where the real particles are is one draw, and so is its error
    assert_allclose(scale.theta[0], SCALE, atol=5 * np.sqrt(scale.covariance[0, 0]))
    assert np.sqrt(scale.covariance[0, 0]) < SCALE / 10


@pytest.mark.thorough
def test_the_stage_tells_of_the_images(recorded, tmp_path):
    """One verdict of both channels: tables in newtons hold the forces alone, the camera is named or in the group."""
    solver, session = recorded
    verdict = judge_recording(solver, [session], tmp_path, "camera")
    assert verdict.fit.flow.used == "fitted" and verdict.fit.flow.rmse_before_px > 0.1
    assert verdict.state in ("identified", "ambiguous")
    assert {"camera_scale", "camera_pose"} & set(verdict.answer[0].members)
    assert verdict.fit.flow.rmse_after_px < verdict.fit.flow.rmse_before_px
    assert verdict.where[0].channel == "flow"
    readings = read_table(tmp_path, READINGS)
    assert len(readings) == verdict.fit.before.readings and set(readings["axis"]) == {"x", "y", "z"}
    assert_allclose(readings["after_N"], readings["base_N"], rtol=1e-9)
    assert read_verdict(tmp_path).fit.flow == verdict.fit.flow
    flow = read_table(tmp_path, FLOW)
    for state, told in (("base", verdict.fit.flow.rmse_before_px), ("after", verdict.fit.flow.rmse_after_px)):
        left = np.column_stack([flow[f"measured_{axis}_px"] - flow[f"{state}_{axis}_px"] for axis in "uv"])
        assert_allclose(np.sqrt(np.mean(left**2)), told, rtol=1e-6)
    assert (flow[["sigma_u_px", "sigma_v_px"]] > 0).all(axis=None)
    assert flow["middle_u_px"].between(0, 399).all() and flow["middle_v_px"].between(0, 399).all()
    page = MismatchResults(tmp_path)
    assert set(page.flow["depth_mm"]) == {flow["depth_mm"].max()}
    drawn = [ax for ax in flow_residual_figure(page).axes if ax.get_title()]
    assert len(drawn) == len(flow.groupby(["x_mm", "y_mm"]))


def test_forces_alone_predict_the_images_and_patterns_of_one_channel_stay_in_it(joint, study):
    # Forces alone predict the images
    judgement = judge(joint.flow.forces, study.mismatch, study.seed)
    assert judgement.state in ("consistent", "inconclusive")
    section = flow_section(joint, judgement, after_of(joint, judgement))
    assert section.used == "predicted" and section.rmse_after_px is None

    # Patterns of one channel are nothing on the other
    atoms, n = dictionary(joint.labels, joint.observations.flat(joint.base)), joint.flow.entries
    of_flow = np.array([one.name.startswith("the images") for one in atoms.patterns])
    assert of_flow.any() and (~of_flow).any()
    assert not atoms.values[:n, of_flow].any() and not atoms.values[n:, ~of_flow].any()


def test_motion_at_a_mirror_image_is_the_one_solved_here(recorded, study):
    """At points in the gel; the mesh is as symmetric as the sensor."""
    solver, _ = recorded
    points = even_points(study.sensor, 0.3)[::97]
    places = [PlannedCell("", x, y, (0.5,)) for x, y in ((9.5, 9.5), (6.5, 9.5))]
    for place in places:
        (there,) = motions_of(solver, solver.coarse, [place])
        alone = flow_model_module.moved_by((solver, solver.coarse, place, {}))
        assert_allclose(
            there.weights(points) @ there.base[0], alone.weights(points) @ alone.base[0], atol=1e-6
        )
    assert {one.symmetry for one in motions_of(solver, solver.coarse, places)} != {"identity"}


@pytest.mark.thorough
def test_images_are_of_the_deepest_depth_at_which_no_region_moves_far(recorded, study, monkeypatch):
    """Of two depths: the larger where anything goes, the smaller where it does not, and where all move too far."""
    session = recorded[1]
    observations, _ = observations_of([session], study)

    def seen_up_to(most_px: float) -> list:
        monkeypatch.setattr(flow_images, "MOST_PX", most_px)
        return seen_flows([session], observations, study.sensor)

    deep = seen_up_to(100.0)
    assert {float(press.row["depth_mm"]) for press in deep} == {1.0}
    assert len({int(press.row["site"]) for press in deep}) == len(deep) == len(observations.sites)
    first = np.linalg.norm(deep[0].flow, axis=1).max()  # which decides for all
    assert {float(press.row["depth_mm"]) for press in seen_up_to(1.01 * first)} == {1.0}
    for less in (0.99 * first, 1e-6):
        assert {float(press.row["depth_mm"]) for press in seen_up_to(less)} == {0.5}


def test_what_bends_the_mesh_stays_at_first_order_in_the_flow(joint, monkeypatch):
    """No particle is found in elements that are no boxes: the flow then changes by the columns, the forces as solved."""
    part, a = next(c for c in joint.candidates if c.name == "gel_stiffness"), np.array([0.3])
    every = np.ones(len(joint.base), bool)
    n, R = joint.flow.entries, len(joint.flow.forces.base)
    solved = joint.forces_with([(part, a)], every)

    def bent(*_):
        raise VirtualLabError("elements are not boxes")

    monkeypatch.setattr(flow_model_module, "motions_of", bent)
    linear = joint.forces_with([(part, a)], every)
    assert_allclose(linear[:R], solved[:R], rtol=1e-12)
    change = joint.observations.flat(linear - joint.base)[n:]
    assert_allclose(change, part.columns[n:] @ a, atol=1e-12)
    assert np.abs(joint.observations.flat(linear - solved)[n:]).max() > 1e-3 * np.abs(change).max()


def test_changes_of_the_flow_have_a_finer_mesh_and_points_fill_the_gel(joint, study):
    # Changes of the flow are solved on a finer mesh than those of the forces. No finer than the study asks for, and
    # nothing else of it is another
    solver, own = joint.flow.model.solver, study.mechanics.mesh.near_mm
    assert_allclose(solver.coarse.mechanics.mesh.near_mm, COARSER * own)
    assert study.mismatch.coarser > COARSER
    kept = solver.study.mismatch.model_copy(update={"coarser": study.mismatch.coarser})
    assert solver.study.model_copy(update={"mismatch": kept}) == study

    # Points fill the gel and regions without particles are left out
    points, inset = even_points(study.sensor, 0.3), 0.15
    ((low, high),) = gel_boxes(study.sensor)
    assert (points >= low + inset).all() and (points <= high - inset).all()
    assert_allclose(points.mean(axis=0), (low + high) / 2, atol=1e-3 * (high - low).max())

    # Regions without particles are left out
    camera = Camera(**(flow_channel.CAMERA | {"focal_px": 240.0}))  # the gel fills the middle only
    shown = shows_gel(CameraView(camera, None, VirtualImaging()), likely_particles(study.sensor, 1)).reshape(
        REGIONS, -1
    )
    assert shown[2:6, 2:6].all() and not shown[[0, -1]].any() and not shown[:, [0, -1]].any()


def test_errors_of_a_flow_follow_the_distance_and_placements_are_as_far_off_as_said(joint, study):
    # Errors of a flow follow the distance and the sites of forces. A fifth of it, more than a change of the forces,
    # each on its own; at the indenter as far as at the rim
    part = next(c for c in joint.candidates if c.name == "gel_stiffness")
    errors, n = joint.errors_of([(part, np.array([0.3]))]), joint.flow.entries
    change = 0.3 * part.columns[:, 0]
    size = np.sqrt(np.sum(errors**2, axis=1))
    assert_allclose(size[n:], SEEN_ERROR * np.abs(change[n:]), rtol=1e-9)
    assert_allclose(size[:n], part.form_error * np.abs(change[:n]), rtol=1e-9)
    assert not (errors[:n].any(axis=0) & errors[n:].any(axis=0)).any()
    wider = joint.with_model_error([(part, np.array([0.3]))]).covariance
    assert_allclose(
        wider.variance - joint.covariance.variance,
        np.where(np.arange(len(change)) < n, 0, SCATTERED * change) ** 2,
    )
    away = joint.labels["errs_over"][n:]
    assert away.max() == 1.0 and away.min() < 0.2 and away.nunique() > 20

    # Errors of a change are drawn for sites, and not for regions: these would take up where
    # particles are.
    n, labels = joint.flow.entries, joint.labels
    group = joint.covariance.levels[-2].group
    forces = dict(zip(labels["site"][:n], group[:n]))
    assert all(forces[site] == g for site, g in zip(labels["site"][n:], group[n:]))

    # Other placements are as far off as the covariance says. Those that it was not made of: their flow over all
    # regions, and its share as a whole
    model, mask = joint.flow.model, flow_entries(joint)
    covariance, base = joint.covariance.restricted(mask), model.drawn.mean(axis=1)
    others = likely_particles(study.sensor, study.seed + 1).first(8)
    drawn = flow_model(model.solver, model.base, model.seen, {}, others).drawn
    rows = Rows(joint.observations, 0, np.stack([shows_gel(p.eye, model.particles) for p in model.seen]))
    white = covariance.whiten(np.column_stack([rows.flat(drawn[:, k] - base) for k in range(8)]))
    whole = covariance.whiten(rows.flat(base))
    shares = whole @ white / np.linalg.norm(whole)
    # noise and looks of the particles are in the covariance, and not in these: some 0.8
    assert 0.5 < np.mean(white**2) < 1.1
    assert 0.4 < np.sqrt(np.mean(shares**2)) < 1.7  # of eight draws: 0.4 and 1.6 have a chance of 1 % each


def test_a_session_without_images_has_no_flow(tmp_path, study):
    from session_folder import write_session

    folder = write_session(tmp_path / "forces")
    observations, _ = observations_of([folder], flow_channel.small_study())
    assert seen_flows([folder], observations, study.sensor) == []


@pytest.mark.parametrize(
    ("setting", "camera", "said"),
    [("left_out", True, True), ("fitted", True, False), ("left_out", False, False)],
)
def test_images_that_are_not_looked_at_are_told(tmp_path, study, setting, camera, said):
    from session_folder import write_session

    stated = yaml.safe_dump({"camera": flow_channel.CAMERA}) if camera else ""
    folder = write_session(tmp_path / "forces", extra=stated)
    own = study.model_copy(update={"mismatch": study.mismatch.model_copy(update={"images": setting})})
    assert (IMAGES_LEFT_OUT in observations_of([folder], own)[0].cannot_know) == said


def test_images_that_no_session_can_show_are_told(tmp_path, recorded, joint):
    from session_folder import write_session

    folder = write_session(tmp_path / "forces")
    plain = with_flow(recorded[0], None, joint.flow.forces, [folder])
    assert any("images were not used" in said for said in plain.observations.cannot_know)


def test_motion_that_cannot_be_solved_leaves_the_forces_and_is_told(recorded, joint, monkeypatch):
    def folds(*_):
        raise NotConverged("it folds")

    solver, session = recorded
    monkeypatch.setattr(flow_model_module, "each_derivative", folds)
    planned = PlannedCell("", 8.0, 8.0, (0.313,))  # a depth that nothing else is solved at
    with pytest.raises(NotConverged, match=r"at \(8, 8\) mm: it folds"):
        motions_of(solver, solver.coarse, [planned], [])
    monkeypatch.setattr(flow_model_module, "moved_by", lambda task: "it folds")
    forces = joint.flow.forces
    alone = with_flow(solver, joint.flow.model.base, forces, [session])
    assert alone.flow is None and len(alone.labels) == len(forces.labels)
    assert any("images were not used: the gel's motion" in said for said in alone.observations.cannot_know)


@pytest.mark.thorough
def test_what_the_forces_find_predicts_the_images_better(study, truth, tmp_path):
    """The study takes depth zero for 0.1 mm higher than it is: found from forces, the flow of the images follows."""
    higher = SOLVER_EFFECTS["contact_zero"](study, -DEEPER_MM)
    higher = flow_channel.study_from(
        merged(higher.model_dump(mode="json"), {"mismatch": {"images": "predicted"}})
    )
    case = flow_channel.Case("nothing", 0.0, 1.0, (0.0, 0.0, 0.0), {})
    session = flow_channel.record(case, study, 4, truth, tmp_path / "out", study.mechanics.mesh)
    laws, _ = flow_channel.laws_and_doubts(flow_channel.material_laws_of(study, []))
    verdict = judge_recording(Solver(higher, laws, {}, tmp_path / "solves"), [session], tmp_path, "zero")
    assert verdict.state in ("identified", "ambiguous")
    assert len(verdict.answer) == 1 and verdict.answer[0].members[0] == "contact_zero"
    (deeper,) = next(effect for effect in verdict.effects if effect.name == "contact_zero").parameters
    low, high = deeper.interval_90
    # next to the interval a tenth, by which a change on the coarser mesh may err
    assert low - 0.1 * DEEPER_MM < DEEPER_MM < high + 0.1 * DEEPER_MM
    flow = verdict.fit.flow
    assert flow.used == "predicted" and flow.p < 1e-3
    # what is left is where the real particles lie: 0.3 px of 0.4
    assert flow.rmse_after_px < 0.8 * flow.rmse_before_px
    table = read_table(tmp_path, FLOW)
    missing, found = (
        np.concatenate([table[f"{state}_{axis}_px"] - table[f"base_{axis}_px"] for axis in "uv"])
        for state in ("measured", "after")
    )
    assert 0.7 < missing @ found / (found @ found) < 1.3  # along what was found nearly all of it was missing
