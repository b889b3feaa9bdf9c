"""What has a place is found between the places that are tried: by refits, and by first order where nothing is solved."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import problem_of

from gelforge.mismatch import places
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.problem import FORM_ERROR, FOUND_PLACE_ERROR, PLACE_ERROR
from gelforge.mismatch.refit import refitted
from gelforge.mismatch.screen import screened

TRIED = places.balls(artificial.study())


def between(first, second, share):
    return {axis: first[axis] + share * (second[axis] - first[axis]) for axis in first}


def test_a_place_that_was_tried_is_itself():
    assert places.shares(TRIED[7], TRIED) == {7: 1.0}


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_half_way_is_half_of_either(share):
    found = places.shares(between(TRIED[6], TRIED[7], share), TRIED)
    assert found == {6: pytest.approx(1 - share), 7: pytest.approx(share)}


def test_beyond_the_outermost_place_is_that_place():
    corner = min(TRIED, key=lambda place: place["x_mm"] + place["y_mm"])
    beyond = {**corner, "x_mm": corner["x_mm"] - 1, "y_mm": corner["y_mm"] - 1}
    assert places.shares(beyond, TRIED) == {TRIED.index(corner): 1.0}


def test_slopes_are_those_of_columns_that_are_linear_in_the_place():
    problem = problem_of(artificial.context(61, per_side=3), left_out=())
    rows = np.linspace(0, 1, len(problem.labels))[:, None]
    balls = [
        replace(c, columns=(2 * c.shape["x_mm"] - 3 * c.shape["y_mm"]) * rows)
        for c in problem.candidates
        if c.name == "void"
    ]
    for ball in balls:  # those at the rim have a place on one side only
        found = places.slopes(ball, balls)
        assert set(found) >= {"x_mm", "y_mm"}
        for axis, slope in (("x_mm", 2), ("y_mm", -3)):
            assert found[axis][0] == pytest.approx(slope * rows)
            assert 2 < found[axis][1] <= places.SPACING


@pytest.mark.parametrize(("along", "across"), [(0.4, 0.0), (0.3, 0.4), (-0.45, 0.2)])
def test_a_refit_moves_to_where_the_bubble_is(along, across):
    """Readings are made at the very place, the refit's forces are interpolated: within a fifth of the spacing."""
    base = artificial.context(62)
    k = next(k for k, place in enumerate(TRIED) if place["x_mm"] > 8 and place["y_mm"] > 8)
    spacing = min(p["x_mm"] - TRIED[k]["x_mm"] for p in TRIED if p["x_mm"] > TRIED[k]["x_mm"] + 1e-9)
    there = TRIED[k] | {
        "x_mm": TRIED[k]["x_mm"] + along * spacing,
        "y_mm": TRIED[k]["y_mm"] + across * spacing,
    }
    table = base.observations.table
    x, y, d = (table[name].to_numpy(float) for name in ("x_mm", "y_mm", "depth_mm"))
    softer = -0.2 * artificial._bump(there, x, y) * d[:, None] * base.force
    context = artificial.read(base, base.force + softer, np.random.default_rng(63))
    problem = replace(problem_of(context, left_out=()), change_error=1e-3)
    every = np.ones(len(problem.labels), bool)
    voids = [c for c in problem.candidates if c.name == "void"]
    (start,) = screened(problem.residual, problem.covariance, voids)
    fit = refitted(problem, start, every)
    (found,) = fit.parts

    def away(place):
        return np.hypot(place["x_mm"] - there["x_mm"], place["y_mm"] - there["y_mm"])

    assert found.tried == dict(start.shape) and away(found.shape) < 0.2 * spacing < away(found.tried)
    assert fit.amounts[0] == pytest.approx(1.0, rel=0.15)
    assert fit.log_bayes_factor > start.log_bayes_factor

    solved = problem.forces_with(fit.parts, fit.amounts, np.ones(len(problem.base), bool))
    seated = problem.seated(found, fit.amounts[0], solved)
    assert seated.own(found).shape == found.shape  # and later rounds weigh it there
    change = problem.observations.flat(solved - problem.base)
    assert seated.own(found).columns @ fit.amounts[0] == pytest.approx(change, abs=1e-12)


def test_what_has_been_found_errs_less_than_what_was_tried():
    """In form by a quarter of the change, and towards the next places by a fifth of the way."""
    problem = replace(problem_of(artificial.context(65, per_side=3), left_out=()), change_error=0.1)
    part = next(c for c in problem.candidates if c.name == "void" and c.tried == TRIED[12])
    there = places.moved(part, {"x_mm": 1.0})
    assert there.shape["x_mm"] == TRIED[12]["x_mm"] + 1.0 and there.tried == TRIED[12]
    assert (problem.error_of(part), problem.error_of(there)) == (PLACE_ERROR, FORM_ERROR)
    tried, found = (problem.errors_of([one], np.ones(1)) for one in (part, there))
    next_to = slice(6, None)  # before: three shares of pressing and of sideways forces
    assert found[:, :6] == pytest.approx(tried[:, :6] * FORM_ERROR / PLACE_ERROR)
    assert tried[:, next_to].any()
    assert found[:, next_to] == pytest.approx(tried[:, next_to] * FOUND_PLACE_ERROR / PLACE_ERROR)


def test_a_step_too_far_is_not_taken():
    """Of a model that fits nowhere as well as where the fit begins."""
    base = artificial.context(66, per_side=3)
    context = artificial.with_effect(base, "gel_stiffness", [0.35], np.random.default_rng(67))
    problem = replace(problem_of(context), change_error=0.0)
    (own,) = (c for c in problem.candidates if c.name == "gel_stiffness")
    (start,) = screened(problem.residual, problem.covariance, [own])

    def odd(parts, amounts, rows):
        share = 0.9 if amounts[0] == pytest.approx(start.amounts, abs=1e-9) else -1.0
        found = problem.base.copy()
        found[context.observations.read] += share * parts[0].columns @ start.amounts
        return found

    fit = refitted(replace(problem, forces_with=odd), start, np.ones(len(problem.labels), bool))
    assert fit.amounts[0] == pytest.approx(start.amounts, abs=1e-9)


def test_the_first_order_of_a_void_between_places_is_between_theirs():
    base = artificial.context(64, per_side=3)
    effect, shapes = CATALOGUE["void"], CATALOGUE["void"].shapes(base)
    ends = [effect.to_forces(base, shapes[k], base.force, [0.5]) for k in (6, 7)]
    middle = effect.to_forces(base, between(shapes[6], shapes[7], 0.5), base.force, [0.5])
    assert middle == pytest.approx((ends[0] + ends[1]) / 2, abs=1e-12)
