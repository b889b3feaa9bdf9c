"""Play across the press: from where the stage came, where the ball lands, and what it reads there."""

from dataclasses import replace

import artificial
import numpy as np
import pandas as pd
import specimens
from numpy.testing import assert_allclose, assert_array_equal

from gelforge.config import StageToSensor
from gelforge.indentation.sensor.stage_frame import axes_of_stage, stage_to_sensor
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.fem.solver import base_of, forces_with
from gelforge.mismatch.readings.observations import COLUMNS, Observations, last_moves

PLAY, SHIFT = CATALOGUE["lateral_play"], CATALOGUE["misregistration"]
STUDY = specimens.study()
PLACES = np.array([[8.0, 8.0], [6.5, 8.0]])
DEPTH = 0.5


def pressed(sites, came_along):
    """Return observations of one reading per press at sites, the stage having come along some directions."""
    rows = [
        ("s", f"p{k}", k, site, "load", 20.0 * k, DEPTH, *PLACES[site], DEPTH, DEPTH, np.nan, np.nan)
        for k, site in enumerate(sites)
    ]
    R = len(rows)
    ones = np.ones((R, 3))
    table = pd.DataFrame(rows, columns=COLUMNS)
    moves = np.array([np.diag(signs) for signs in came_along], dtype=float)
    by = np.full(R, "press")
    return Observations(table, ones, PLACES, ones, ones, np.ones(R), by, came_along=moves)


def test_the_last_move_along_each_axis_counts_as_a_grid_shifted_the_other_way():
    # The last move of the stage along each axis counts
    table = pd.DataFrame(
        {
            "press": ["a", "a", "b", "c", "d", "d"],
            "x_mm": [5.0, 5.0, 7.0, 7.0, 6.0, 6.0],
            "y_mm": [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
        }
    )
    expected = [[0, 0], [0, 0], [1, 0], [1, -1], [-1, -1], [-1, -1]]
    assert_array_equal(last_moves(table), [np.diag(signs) for signs in expected])

    # Along a line of one stage coordinate the other axis does not move, in rounding, in jitter or
    # turned by 90 degrees.
    rng = np.random.default_rng(5)
    sent = np.array([[5.0, 3.0], [7.0, 3.0], [4.0, 3.0], [6.0, 3.0]]) + rng.uniform(-1e-3, 1e-3, (4, 2))
    for stage in (StageToSensor(rotation_deg=90.0), StageToSensor(rotation_deg=31.0, handedness="left")):
        axes = axes_of_stage(stage)
        table = pd.DataFrame(stage_to_sensor(sent, stage), columns=["x_mm", "y_mm"]).assign(
            press=list("abcd")
        )
        assert_allclose(last_moves(table, axes), [axes * [sign, 0] for sign in (0, 1, -1, 1)], atol=1e-15)

    # Play along one axis alone is an answer and none is not
    assert PLAY.in_range([0.3, 0.0]) and PLAY.in_range([0.3, 0.2])
    assert not PLAY.in_range([0.0, 0.0]) and not PLAY.in_range([0.3, -0.1]) and not PLAY.in_range([0.0, 2.0])

    # The first order is that of a grid shifted the other way
    context, to_forces = artificial.context(), CATALOGUE["misregistration"].to_forces
    R = len(context.force)
    moves = np.tile(np.diag([1.0, -1.0]), (R, 1, 1))
    context = replace(context, observations=replace(context.observations, came_along=moves))
    played = PLAY.to_forces(context, {}, context.force, [0.4, 0.2])
    assert_allclose(played, to_forces(context, {}, context.force, [-0.2, 0.1]), rtol=1e-12)


def test_with_play_a_press_stays_behind_and_without_it_is_the_base(tmp_path):
    found = pressed([0, 1, 0], [[1, 0], [-1, 0], [0, 0]])
    solver = Solver(STUDY, specimens.STUDY_LAWS, {}, tmp_path)
    base = base_of(solver, found, [SHIFT])
    played = forces_with(solver, base, [(PLAY, {}, [0.6, 0.0])])
    slope = base.context.derivative("misregistration.x")
    assert_allclose(played - base.context.force, np.array([[-0.3], [0.3], [0.0]]) * slope, atol=1e-12)
    assert np.abs(slope[1]).max() > 1e-4  # next to the middle

    # No play is the base bit for bit
    found = pressed([0, 1], [[1, 0], [-1, 1]])
    base = base_of(solver, found, [SHIFT])
    assert_array_equal(forces_with(solver, base, [(PLAY, {}, [0.0, 0.0])]), base.context.force)
