"""Readings of presses that the base cannot follow are left out and reported; the others are judged as if alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import specimens

from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mismatch.fem import nominal, solutions
from gelforge.mismatch.fem.nominal import base_where_solved, without
from gelforge.mismatch.fem.solutions import Solver, SolverFailed, Unsolved
from gelforge.mismatch.fem.solver import base_of
from gelforge.mismatch.readings.observations import COLUMNS, Observations

MIDDLE, EDGE, MIRRORED = (8.0, 8.0), (8.0, 1.1), (1.1, 8.0)  # of 16 mm; the wall is 1 mm thick
DEEP = 2.3  # mm: next to the wall a ball of 5 mm finds no equilibrium there, in the middle it does


def pressed(*presses):
    """Return readings of presses (site, depths on loading, depths in unloading)."""
    sites, rows = [], []
    for number, (site, down, up) in enumerate(presses):
        if site not in sites:
            sites.append(site)
        course = [("load", d) for d in down] + [("dwell", down[-1])] + [("unload", d) for d in up]
        for k, (phase, depth) in enumerate(course):
            at = (sites.index(site), phase, 60.0 * number + k, float(k), *site, depth, down[-1])
            rows.append(("s", f"p{number}", number, *at, np.nan, np.nan))
    table = pd.DataFrame(rows, columns=COLUMNS)
    ones = np.ones((len(table), 3))
    return Observations(
        table, ones, np.array(sites), ones, ones, np.ones(len(table)), np.full(len(table), "press")
    )


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return Solver(specimens.study(), specimens.STUDY_LAWS, {}, tmp_path_factory.mktemp("solves"))


def test_a_press_too_deep_keeps_the_way_down_and_a_place_needs_readings(solver):
    # Of a press that went too deep loading to there is kept
    found = pressed((MIDDLE, [1.0, 2.0], [0.5]), (EDGE, [0.5, 1.0, 2.0], [0.5]), (EDGE, [0.5], [0.2]))
    image = (14.9, 8.0)  # what stands for both edges
    kept = without(solver, found, [Unsolved(*image, "its mesh", "it folds", beyond_mm=1.2)])
    rows = [*range(4), 4, 5, *range(9, 12)]
    pd.testing.assert_frame_equal(
        kept.table.drop(columns="deepest_mm"),
        found.table.drop(columns="deepest_mm").iloc[rows].reset_index(drop=True),
    )
    assert list(kept.table["deepest_mm"]) == [2.0] * 4 + [1.0] * 2 + [0.5] * 3
    (told,) = kept.cannot_know
    assert "3 of 12 readings are not judged" in told and "beyond 1.2 mm on its mesh: it folds" in told

    # Where only an unloading is not solved loading stays
    found = pressed((EDGE, [1.0, 2.0], [0.5]), (EDGE, [1.0], [0.5]))
    kept = without(solver, found, [Unsolved(14.9, 8.0, "its mesh", "it snaps", unloading_from_mm=2.0)])
    assert list(kept.table["phase"]) == ["load", "load", "dwell", "load", "dwell", "unload"]
    assert list(kept.table["deepest_mm"]) == [2.0] * 3 + [1.0] * 3
    assert "during unloading from 2 mm on its mesh: it snaps" in kept.cannot_know[0]

    # A place without readings is no place
    found = pressed((EDGE, [1.0], []), (MIDDLE, [1.0], []))
    kept = without(solver, found, [Unsolved(14.9, 8.0, "its mesh", "it folds", beyond_mm=0.5)])
    assert kept.sites.tolist() == [list(MIDDLE)] and list(kept.table["site"]) == [0, 0]
    assert list(kept.table["x_mm"]) == [8.0, 8.0]


def test_readings_beyond_the_base_are_left_out_and_too_few_make_no_base(solver):
    # Readings beyond what the base can follow are left out at mirror images too
    course = [0.5, 1.0, DEEP]
    found = pressed((EDGE, course, []), (MIDDLE, course, []), (MIRRORED, course, []))
    base = base_where_solved(solver, found, [])
    kept = base.context.observations
    assert kept.table.groupby(["x_mm", "y_mm"])["depth_mm"].max().to_dict() == {
        EDGE: 1.0, MIDDLE: DEEP, MIRRORED: 1.0
    }  # fmt: skip
    alone = base_of(solver, replace(kept, cannot_know=()), [])
    np.testing.assert_array_equal(base.context.force, alone.context.force)
    np.testing.assert_array_equal(base.floor, alone.floor)
    assert "at (14.9, 8) mm" in kept.cannot_know[0] and "4 of 12 readings" in kept.cannot_know[0]

    # A base that follows less than half of the readings is none
    found = pressed((EDGE, [DEEP], []), (MIDDLE, [1.0], []), (MIRRORED, [DEEP], []))
    with pytest.raises(SolverFailed, match=r"at \(14.9, 8\) mm.* beyond .* 33% of the readings are left"):
        base_where_solved(solver, found, [])

    # Of a gel that softens no press may be missing. Its own symmetry is none, as presses come in an order; what
    # stopped is reported all the same, and nothing goes on
    softening = {"mullins": {"gel": {"amount": 0.2, "m_kPa": 1.0}}}
    study = with_keys(solver.study, history=softening)
    found = pressed((EDGE, [0.5, DEEP], []), (MIDDLE, [0.5], []))
    with pytest.raises(SolverFailed, match=r"at \(14.9, 8\) mm"):
        base_where_solved(replace(solver, study=study), found, [])


def test_what_stopped_is_not_solved_again_and_a_failure_without_a_place_ends_the_verdict(solver, monkeypatch):
    # What stopped is not solved again
    found = pressed((EDGE, [0.5, 1.0, DEEP], []), (MIDDLE, [0.5, 1.0, DEEP], []))
    first = base_where_solved(solver, found, [])
    monkeypatch.setattr(solutions, "simulate_cell", None)
    again = base_where_solved(solver, found, [])
    np.testing.assert_array_equal(first.context.force, again.context.force)
    assert again.context.observations.cannot_know == first.context.observations.cannot_know

    # A failure without a place ends the verdict
    def nowhere(*_):
        raise SolverFailed("the nominal model, followed in the time of the readings, does not converge")

    monkeypatch.setattr(nominal, "base_of", nowhere)
    with pytest.raises(SolverFailed, match="in the time of the readings"):
        base_where_solved(solver, pressed((MIDDLE, [0.5], [])), [])
