"""Which path and which step of it every reading is."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import specimens

from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.effects.kinematics import real_place
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem import solver as fem
from gelforge.mismatch.fem.asked import asked_of, observed_by
from gelforge.mismatch.fem.solutions import Solver, follow, unloading_key
from gelforge.mismatch.fem.solver import (
    _by_observable_parts,
    base_of,
    forces_with,
)
from gelforge.mismatch.model.solver_effects import FAR_OUT, LARGEST_MOVE
from gelforge.mismatch.readings.observations import COLUMNS, Observations
from gelforge.mismatch.readings.runs import runs_of, timed_runs_of
from gelforge.mismatch.thresholds import REACH_MM

PRESSES = [  # site, depth, depths on the way up
    (0, 0.5, ()),
    (0, 2.0, (1.5, 0.75)),  # of these, no press goes to 1.5 or 0.75
    (1, 1.0, (0.25,)),
    (1, 2.0, ()),
    (0, 0.5, ()),
]


def observations():
    rows = []
    for number, (site, depth, up) in enumerate(PRESSES):
        course = [("load", depth), ("dwell", depth), *(("unload", d) for d in up)]
        for k, (phase, d) in enumerate(course):
            at = 2.0 * k + depth
            rows.append(
                (
                    "s",
                    f"p{number}",
                    number,
                    site,
                    phase,
                    60.0 * number + at,
                    at,
                    3.0 + site,
                    4.0,
                    d,
                    depth,
                    np.nan,
                    np.nan,
                )
            )
    table = pd.DataFrame(rows, columns=COLUMNS)
    R = len(table)
    ones = np.ones((R, 3))
    return Observations(
        table, ones, np.array([[3.0, 4.0], [4.0, 4.0]]), ones, ones, np.ones(R), np.full(R, "press")
    )


def test_every_reading_has_its_place_and_presses_alike_in_time_are_solved_once():
    # Every reading is at its own site depth and phase
    found = observations()
    runs = runs_of(found)
    for row, way, step, number, back in zip(
        found.table.itertuples(), runs.way, runs.step, runs.unloading, runs.back
    ):
        loading = runs.ways[way]
        assert way == row.site and loading.x_mm == 3.0 + row.site and not loading.phases
        assert loading.depths_mm[step] == row.depth_mm
        assert (number >= 0) == (row.phase == "unload")
        if number >= 0:
            of, run = runs.unloadings[number]
            assert of == way and run.x_mm == loading.x_mm and run.depths_mm[back] == row.depth_mm
            assert run.phases[back] == "unload" and max(run.depths_mm) == row.deepest_mm

    # Ways down hold every depth that is read at their site
    for site, planned in enumerate(runs_of(found).ways):
        read = found.table.loc[found.table["site"] == site, "depth_mm"]
        assert planned.depths_mm == tuple(np.unique(read)) and not planned.phases

    # Presses alike in time are solved once unless the sensor remembers
    once, each = (timed_runs_of(found, 0.25, path_dependent) for path_dependent in (False, True))
    assert len(once.trajectories) == 4 and len(each.trajectories) == 5  # p0 and p4 are alike
    for runs in (once, each):
        for row, run, step in zip(found.table.itertuples(), runs.run, runs.step):
            path = runs.trajectories[run]
            assert path.depths_mm[step] == row.depth_mm
            assert abs(path.times_s[step] - row.press_time_s) < 0.02
            assert np.all(np.diff(path.times_s) > 0)
            assert np.abs(np.diff([0.0, *path.depths_mm])).max() <= 0.25 + 1e-9


def test_what_has_a_place_is_solved_only_where_it_is_felt():
    found = observations()
    site = found.table["site"].to_numpy()
    stiffer = (CATALOGUE["gel_stiffness"], {}, np.array([0.1]))
    near = {
        "x_mm": 4.0 + REACH_MM - 0.5,
        "y_mm": 4.0,
        "z_mm": -2.0,
        "radius_mm": 1.0,
    }  # of site 1 alone
    void = (CATALOGUE["void"], near, np.array([0.5]))
    groups = {
        tuple(e.name for e, *_ in observable): rows
        for observable, rows in _by_observable_parts(found, [stiffer, void])
    }
    assert set(groups) == {("gel_stiffness",), ("gel_stiffness", "void")}
    np.testing.assert_array_equal(groups["gel_stiffness", "void"], site == 1)
    ((observable, rows),) = _by_observable_parts(found, [void])
    np.testing.assert_array_equal(rows, site == 1)
    softening = (CATALOGUE["mullins"], {"m_kPa": 0.5}, np.array([0.2]))
    ((observable, rows),) = _by_observable_parts(found, [softening, void])
    assert (
        rows.all() and len(observable) == 2
    )  # each press finds what those before it have left, wherever they were


# ---------------------------------------------------------------------------------------- what is held out was pressed
@pytest.mark.parametrize(
    ("name", "hyperparameters", "theta"),
    [
        ("viscoelastic", {"part": "gel", "time_s": 1.0}, [0.5]),
        ("force_hysteresis", {"loop": "lens"}, [0.1, 0.1, 0.1]),
        ("force_hysteresis", {"loop": "play"}, [0.1, 0.1, 0.1]),
        ("clock_offset", {"stamp": "late"}, [0.05]),
    ],
)
def test_presses_are_followed_as_a_whole_whatever_was_chosen_of_them(name, hyperparameters, theta, kept):
    """Without its deepest readings an unloading comes from the same peak, and a reading has the same way before it."""
    solver, found = Solver(specimens.study(), specimens.STUDY_LAWS, {}, kept), observations()
    table = found.table.assign(x_mm=8.0, y_mm=8.0)
    found = replace(found, table=table, sites=np.array([[8.0, 8.0], [5.0, 8.0]]))
    base = base_of(solver, found, [])
    chosen = [(CATALOGUE[name], hyperparameters, theta)]
    whole = forces_with(solver, base, chosen)
    shallow = (table["depth_mm"] < 2.0).to_numpy()
    cut = forces_with(solver, base, chosen, shallow)
    assert np.array_equal(cut[shallow], whole[shallow]) and np.isnan(cut[~shallow]).all()
    up = (table["phase"] == "unload").to_numpy()
    assert np.abs(whole - base.context.force)[up].max() > 1e-3


@pytest.mark.parametrize(
    "name", ["gel_stiffness", "friction"]
)  # solved in loading only, and in unloading too
def test_forces_at_some_sites_are_those_of_all(name, kept):
    """Sites keep their numbers where only some are solved."""
    solver, found = Solver(specimens.study(), specimens.STUDY_LAWS, {}, kept), observations()
    sites = np.array([[8.0, 8.0], [5.0, 8.0]])
    table = found.table.assign(**dict(zip(("x_mm", "y_mm"), sites[found.table["site"]].T)))
    base = base_of(solver, replace(found, table=table, sites=sites), [])
    chosen, second = [(CATALOGUE[name], {}, np.array([0.3]))], (table["site"] == 1).to_numpy()
    whole, some = (forces_with(solver, base, chosen, rows) for rows in (None, second))
    assert second.any() and np.array_equal(some[second], whole[second]) and np.isnan(some[~second]).all()


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return tmp_path_factory.mktemp("solves")


# ------------------------------------------------------------------------------------------------------- unloading
@pytest.mark.parametrize("kinematics", [{}, {"frame_compliance_mm_per_N": 0.02}], ids=["stiff", "yielding"])
def test_unloading_from_a_kept_state_is_that_of_its_own_path(kinematics, tmp_path):
    """Friction has the same history either way: the steps of the loading to the peak, and those of the way back."""
    study = with_keys(specimens.study(), kinematics=kinematics)
    solver = Solver(study, specimens.STUDY_LAWS, {}, tmp_path)
    place, laws = ("", 10.0, 8.0), specimens.STUDY_LAWS
    shallow, deep = (
        PlannedCell(*place, depths, phases=("load",) * n + ("unload",) * (len(depths) - n))
        for n, depths in ((2, (1.0, 1.5, 1.0)), (3, (1.0, 1.5, 2.0, 1.5, 1.0)))
    )
    found = follow((solver, PlannedCell(*place, (1.0, 1.5, 2.0)), {}, shallow, deep))
    alone = simulate_cell(solver.coarse, laws, deep).arrays["total_force_N"]
    size = np.abs(alone).max()
    np.testing.assert_allclose(found[unloading_key(deep)], alone, atol=2e-5 * size)
    assert np.abs(alone[:2] - alone[:-3:-1]).max() > 1e-3 * size
    # as deep as the loading, so that the mesh is the same
    again = replace(shallow, depths_mm=(1.0, 1.5, 1.0, 2.0), phases=("load", "load", "unload", "load"))
    there = simulate_cell(solver.coarse, laws, again).arrays["total_force_N"]
    np.testing.assert_allclose(found[unloading_key(shallow)], there[:3], atol=2e-5 * size)


@pytest.mark.parametrize("name", ["gel_stiffness", "friction"])
def test_unloading_is_solved_with_an_effect_where_the_contact_is_another(name, kept):
    """What leaves the contact alone changes the force by the same share of loading and unloading."""
    solver, found = Solver(specimens.study(), specimens.STUDY_LAWS, {}, kept), observations()
    table = found.table.assign(x_mm=8.0, y_mm=8.0)
    found = replace(found, table=table, sites=np.array([[8.0, 8.0], [5.0, 8.0]]))
    base, effect = base_of(solver, found, []), CATALOGUE[name]
    changed = effect.to_study(solver.study, {}, [0.3])
    with_it = base_of(replace(solver, study=changed), found, []).coarse - base.coarse
    change = (forces_with(solver, base, [(effect, {}, np.array([0.3]))]) - base.context.force) / base.finer
    up = (table["phase"] == "unload").to_numpy()
    np.testing.assert_allclose(change[~up], with_it[~up], atol=1e-6)
    size = np.abs(with_it[up]).max()
    assert np.abs(change - with_it)[up].max() < (1e-5 if name == "friction" else 0.2) * size


# ----------------------------------------------------------------------------------------------- derivatives that are asked
def test_a_site_is_differentiated_once_whatever_its_presses_go_to(kept, monkeypatch):
    """Also where they are read during unloading, each from its own depth; there the derivative is that of the same depth."""
    solver, tasks = Solver(specimens.study(), specimens.STUDY_LAWS, {}, kept), []
    monkeypatch.setattr(fem, "follow", lambda task: tasks.append(task) or follow(task))
    found = observations()
    runs, stiffness = runs_of(found), CATALOGUE["gel_stiffness"]
    base = base_of(solver, found, [stiffness])
    assert sorted(task[1].depths_mm for task in tasks) == [(0.25, 1.0, 2.0), (0.5, 0.75, 1.5, 2.0)]
    (number,) = (k for k, (_, run) in enumerate(runs.unloadings) if max(run.depths_mm) == 1.0)
    run = runs.unloadings[number][1]
    variations = observed_by(list(asked_of(solver, [stiffness], base.context)), run)
    alone = follow((solver, replace(run, depths_mm=(0.25, 1.0), phases=()), variations))
    own = runs.unloading == number
    expected = base.finer[own] * alone["gel_stiffness"][[0]]  # it is read at 0.25 mm, during unloading
    given = base.context.at_readings["gel_stiffness"][own]
    # the mesh is fine as far as a press touches the surface, and it was another one where it goes to 1 mm only
    np.testing.assert_allclose(given, expected, atol=3e-3 * np.abs(alone["gel_stiffness"]).max())


@pytest.mark.parametrize("name", ["misregistration", "yaw", "grid_scale"])
def test_where_nodes_cannot_come_along_moves_of_the_grid_are_differences_across_an_element(name, kept):
    """As the ball moves over nodes its force has ripples: a slope at the base would be that of one ripple."""
    solver = Solver(specimens.study(), specimens.STUDY_LAWS, {}, kept)
    blank = replace(base_of(solver, observations(), []).context, derivatives={})
    effect, found = CATALOGUE[name], list(asked_of(solver, [CATALOGUE[name]], blank))
    assert len(found) == len(effect.parameters)
    for one in found:
        variation = one.variation.instead
        assert not one.variation.alone
        places = [
            real_place(s.sensor, s.mechanics.effects, 4.0, 4.0) for s in (variation.study, variation.without)
        ]
        from_middle = np.array([4.0, 4.0]) - 8.0
        along = {
            "misregistration": np.eye(2)[one.which],
            "yaw": np.deg2rad(1.0) * np.array([-from_middle[1], from_middle[0]]),
            "grid_scale": from_middle,
        }[name]  # d place / d theta
        shift = np.subtract(*places)
        # a turn's chord is shorter than its arc by a 24th of the angle's square, 7e-4 here
        np.testing.assert_allclose(shift, variation.amount * along, rtol=1e-3)
        far = 1.0 if name == "misregistration" else np.linalg.norm(from_middle) / (FAR_OUT * 16.0)
        assert solver.coarse.mechanics.mesh.near_mm > 2 * LARGEST_MOVE
        assert variation.alone and np.linalg.norm(shift) == pytest.approx(2 * LARGEST_MOVE * far, rel=1e-3)
