"""A force sensor under the tilted sensor or on the stage: forces and their derivatives against full solutions, turned."""

from dataclasses import replace
from functools import cache

import artificial
import numpy as np
import pytest
import specimens
from artificial_problem import judged
from numpy.testing import assert_allclose

from gelforge.config import Session
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem.asked import asked_of, observed_by
from gelforge.mismatch.fem.solutions import Solver, follow
from gelforge.mismatch.model.effect import Context

TIGHT = {"solver": {"force_tolerance": 1e-10, "gap_tolerance": 1e-9, "max_iterations": 80}}
PRESSED = PlannedCell("", *specimens.CORNER, (0.5,))
STEP_DEG = 0.05
WEDGE = 0.001
DIRECTED = ("tilt", "thickness_gradient")


def solver(folder, friction, turns_with="sensor"):
    """Return the finite elements of a small study; what is differentiated is solved on a mesh 1.2 times as coarse."""
    study = specimens.study(friction=friction, **TIGHT)
    study = study.model_copy(update={"mismatch": study.mismatch.model_copy(update={"coarser": 1.2})})
    return Solver(study, specimens.STUDY_LAWS, {}, folder, turns_with=turns_with)


@cache
def solved(friction, effect, x, y):
    """Return the force (3,) [N] in the sensor's axes with both values of an effect."""
    study = CATALOGUE[effect].to_study(solver(None, friction).coarse, {}, (x, y))
    cell = simulate_cell(study, specimens.STUDY_LAWS, PRESSED)
    assert cell.converged
    return cell.arrays["total_force_N"][0]


def derivatives(folder, friction, turns_with):
    own = solver(folder, friction, turns_with)
    asked = list(asked_of(own, [CATALOGUE[name] for name in DIRECTED], Context.before_readings(own.study)))
    return follow((own, PRESSED, observed_by(asked, PRESSED)))


def to_stage(about):
    """Return the rotation (3, 3) of forces from the axes of a sensor to the stage's: turned about x, then y, (2,) [deg]."""
    a, b = np.radians(about)
    about_x = [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
    about_y = [[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]
    return np.array(about_y) @ about_x


@pytest.mark.parametrize("turns_with", ["sensor", "stage"])
@pytest.mark.parametrize("friction", [0.0, 0.1, 0.45])
def test_forces_under_tilt_are_those_of_full_solutions(tmp_path, friction, turns_with):
    """By either frame, with friction that slips, sticks or is none, over a twentieth of a degree."""
    found = derivatives(tmp_path, friction, turns_with)
    for k, about in enumerate(np.eye(2)):
        sides = []
        for angle in (STEP_DEG, -STEP_DEG):
            F = solved(friction, "tilt", *(angle * about))
            sides.append(to_stage(angle * about) @ F if turns_with == "stage" else F)
        slope = (sides[0] - sides[1]) / (2 * STEP_DEG)
        key = f"tilt.about_{'xy'[k]}"
        assert np.linalg.norm(found[key][0] - slope) < 0.02 * np.linalg.norm(slope)


def test_frames_differ_by_the_force_turned_as_full_solutions_and_tilted_studies_do(tmp_path):
    # Both frames differ by the force turned. By omega x F: a pressing force of a tilted sensor has a share of the
    # angle along the stage
    by_sensor, by_stage = (derivatives(tmp_path, 0.45, turns_with) for turns_with in ("sensor", "stage"))
    F = by_sensor["base"][0]
    for k, axis in enumerate(np.radians(np.eye(3)[:2])):
        key = f"tilt.about_{'xy'[k]}"
        assert_allclose(by_stage[key][0] - by_sensor[key][0], np.cross(axis, F), rtol=2e-3, atol=2e-5 * -F[2])
    for key in ("base", "thickness_gradient.x", "thickness_gradient.y"):
        assert np.array_equal(by_stage[key], by_sensor[key])  # a wedge leaves the sensor's base where it is

    # A wedge with friction is that of full solutions
    wedge = tmp_path / "wedge"
    found = derivatives(wedge, 0.45, "stage")
    for k, along in enumerate(np.eye(2)):
        there, back = (solved(0.45, "thickness_gradient", *(s * WEDGE * along)) for s in (1, -1))
        slope = (there - back) / (2 * WEDGE)
        key = f"thickness_gradient.{'xy'[k]}"
        assert np.linalg.norm(found[key][0] - slope) < 0.02 * np.linalg.norm(slope)

    # A study that is tilted is read in the stage's axes
    of_study = tmp_path / "of_study"
    about = (2.0, -1.0)
    for turns_with, turn in (("sensor", np.eye(3)), ("stage", to_stage(about))):
        own = solver(of_study / turns_with, 0.45, turns_with)
        tilted = CATALOGUE["tilt"].to_study(own.study, {}, about)
        found = follow((Solver(tilted, own.laws, {}, own.kept, turns_with=turns_with), PRESSED, {}))["base"]
        assert_allclose(found[0], turn @ solved(0.45, "tilt", *about), rtol=1e-12, atol=1e-12)


def test_a_session_says_its_frame_and_one_not_said_is_taken_for_a_cross_talk():
    # A session says it and older ones are written as before
    plain = Session(session="s")
    assert plain.force.turns_with == "sensor" and "turns_with" not in plain.model_dump()["force"]
    stage = Session(session="s", force={"turns_with": "stage"})
    assert stage.model_dump()["force"]["turns_with"] == "stage"

    # A frame that is not said is taken for a cross talk. A recorded force that keeps to the stage's axes, next to
    # derivatives by the sensor's
    for by_stage, names in ((True, {"tilt"}), (False, {"tilt", "cross_talk"})):
        _, found = judged(tilted_readings(by_stage))
        assert {part.name for part in found.answer.fit.parts} == names, found.answer.groups


def tilted_readings(by_stage):
    """Return a context that holds a tilt of 0.9 deg read by the stage's axes, and derivatives by these or the sensor's.

    ARTIFICIAL: where all sticks the sensor's base feels 0.9 of the pressing force times the angle, by its own axes; depth
    counts from one touch of the session, so that one side is pressed deeper.
    """
    base = artificial.context(5, per_side=3, zero_by="session")
    table, F, slope = base.observations.table, base.force, base.slope()
    deeper = np.radians(table[["x_mm", "y_mm"]].to_numpy() - artificial.WIDTH / 2)
    in_sensor, in_stage = {}, {}
    for k, (name, axis, sign) in enumerate((("x", 1, 1.0), ("y", 0, -1.0))):
        own = sign * deeper[:, [axis]] * slope
        own[:, axis] += sign * np.radians(0.9) * F[:, 2]
        in_sensor[f"tilt.about_{name}"] = own
        in_stage[f"tilt.about_{name}"] = own + np.cross(np.radians(np.eye(3)[k]), F)
    held = replace(base, at_readings=dict(base.at_readings) | in_stage)
    read = artificial.with_effect(held, "tilt", [0.9, -0.5], np.random.default_rng(6))
    known = in_stage if by_stage else in_sensor
    return replace(read, at_readings=dict(base.at_readings) | known)
