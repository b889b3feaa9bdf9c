"""What has a place is found between the places that are tried: by refits, and by first order where nothing is solved."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import problem_of

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.refit import refitted
from gelforge.mismatch.evidence.screen import displaced, judged_by, log_evidence, screened, slopes
from gelforge.mismatch.inference.posterior import weighed, with_form_errors
from gelforge.mismatch.model import places
from gelforge.mismatch.thresholds import FORM_ERRORS, PLACE_ERROR

TRIED = places.balls(artificial.study())


def between(first, second, share):
    return {axis: first[axis] + share * (second[axis] - first[axis]) for axis in first}


def test_a_place_tried_is_the_nearest_one_and_slopes_are_of_linear_columns():
    # A place tried or beyond is the nearest one
    assert places.shares(TRIED[7], TRIED) == {7: 1.0}

    # Beyond the outermost place is that place
    corner = min(TRIED, key=lambda place: place["x_mm"] + place["y_mm"])
    beyond = {**corner, "x_mm": corner["x_mm"] - 1, "y_mm": corner["y_mm"] - 1}
    assert places.shares(beyond, TRIED) == {TRIED.index(corner): 1.0}

    # Slopes are those of columns linear in the place within the layers
    problem = problem_of(artificial.context(61, per_side=3), left_out=())
    rows = np.linspace(0, 1, len(problem.labels))[:, None]
    balls = [
        replace(c, columns=(2 * c.shape["x_mm"] - 3 * c.shape["y_mm"]) * rows)
        for c in problem.candidates
        if c.name == "void"
    ]
    for ball in balls:  # those at the rim have a place on one side only
        found = slopes(ball, balls)
        assert set(found) >= {"x_mm", "y_mm"}
        for axis, slope in (("x_mm", 2), ("y_mm", -3)):
            assert found[axis].columns == pytest.approx(slope * rows)
            assert 1 < found[axis].half <= places.SPACING / 2
            assert found[axis].low < 0 < found[axis].high

    # A ball grows no further than the layers
    balls = [c for c in problem.candidates if c.name == "void"]
    sizes = sorted({place["radius_mm"] for place in TRIED})
    for ball in balls:
        slope = slopes(ball, balls)["radius_mm"]
        reach = [ball.shape["radius_mm"] + end for end in (slope.low, slope.high)]
        assert reach[1] == pytest.approx(sizes[1]) and 0 < reach[0] <= sizes[0]

    # The first order of a void between places is between theirs
    base = artificial.context(64, per_side=3)
    effect, shapes = CATALOGUE["void"], CATALOGUE["void"].shapes(base)
    ends = [effect.to_forces(base, shapes[k], base.force, [0.5]) for k in (6, 7)]
    middle = effect.to_forces(base, between(shapes[6], shapes[7], 0.5), base.force, [0.5])
    assert middle == pytest.approx((ends[0] + ends[1]) / 2, abs=1e-12)


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_half_way_is_half_of_either(share):
    found = places.shares(between(TRIED[6], TRIED[7], share), TRIED)
    assert found == {6: pytest.approx(1 - share), 7: pytest.approx(share)}


def bubble(context, place, amount=1.0):
    """Return the change (R, 3) [N] by a bubble at any place."""
    table = context.observations.table
    x, y, d = (table[name].to_numpy(float) for name in ("x_mm", "y_mm", "depth_mm"))
    return -0.2 * amount * artificial._bump(place, x, y) * d[:, None] * context.force


def solvable(context):
    """Return the problem of a context whose void is "solved" wherever it is."""
    problem = replace(problem_of(context, left_out=()), change_error=1e-3)
    linear = problem.forces_with

    def forces_with(terms, rows):
        force = linear([(part, a) for part, a in terms if part.name != "void"], rows)
        for part, a in terms:
            if part.name == "void":
                force = force + bubble(context, part.shape, a[0])
        return np.where(rows[:, None], force, np.nan)

    return replace(problem, forces_with=forces_with)


def fitted_alone(context):
    """Return the problem of a context, its void as screened and as refitted to all readings."""
    problem = solvable(context)
    voids = [c for c in problem.candidates if c.name == "void"]
    (start,) = screened(problem.residual, problem.covariance, voids)
    return problem, start, refitted(problem, start, np.ones(len(problem.labels), bool))


def beside_the_middle(along, across):
    k = next(k for k, place in enumerate(TRIED) if place["x_mm"] > 8 and place["y_mm"] > 8)
    spacing = min(p["x_mm"] - TRIED[k]["x_mm"] for p in TRIED if p["x_mm"] > TRIED[k]["x_mm"] + 1e-9)
    there = TRIED[k] | {
        "x_mm": TRIED[k]["x_mm"] + along * spacing,
        "y_mm": TRIED[k]["y_mm"] + across * spacing,
    }
    return there, spacing


def away(place, there):
    return np.hypot(place["x_mm"] - there["x_mm"], place["y_mm"] - there["y_mm"])


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize(("along", "across"), [(0.3, 0.4), (0.4, 0.0), (-0.45, 0.2)])
def test_a_refit_moves_to_where_the_bubble_is(along, across):
    """Within 0.09 of the spacing: it waits for no step below 0.05. An error of the way would hold it back by 0.1."""
    base = artificial.context(62)
    there, spacing = beside_the_middle(along, across)
    context = artificial.read(base, base.force + bubble(base, there), np.random.default_rng(63))
    _, start, fit = fitted_alone(context)
    (found,) = fit.parts
    assert fit.converged and found.tried == dict(start.parts[0].shape)
    assert away(found.shape, there) < 0.09 * spacing < away(found.tried, there)
    assert fit.amounts[0] == pytest.approx(1.0, rel=0.1)  # its form may be another by a quarter
    assert fit.log_bayes_factor > start.log_bayes_factor


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_a_refit_finds_how_large_the_bubble_is(share):
    """Between the sizes that are tried, of readings so quiet that a large one of which less is lost is no small one."""
    base = artificial.context(68)
    seen = base.observations
    quiet = {
        name: getattr(seen, name) / 10 for name in ("noise_N", "zero_N", "press_depth_mm", "session_depth_mm")
    }
    base = replace(base, observations=replace(seen, **quiet))
    there, spacing = beside_the_middle(0.2, 0.1)
    sizes = sorted({place["radius_mm"] for place in TRIED})
    there["radius_mm"] = sizes[0] + share * (sizes[1] - sizes[0])
    context = artificial.read(base, base.force + bubble(base, there), np.random.default_rng(69))
    *_, fit = fitted_alone(context)
    (found,) = fit.parts
    off = abs(found.shape["radius_mm"] - there["radius_mm"])
    assert off < 0.1 < abs(found.tried["radius_mm"] - there["radius_mm"])
    assert fit.amounts[0] == pytest.approx(1.0, rel=0.1)
    assert away(found.shape, there) < 0.05 * spacing


@pytest.mark.thorough
def test_beside_another_effect_the_place_is_fitted_too():
    """Its linear change is then that of its own place, not of the one that was tried."""
    base = artificial.context(62)
    there, spacing = beside_the_middle(0.3, 0.3)
    stiffer = CATALOGUE["gel_stiffness"].to_forces(base, {}, base.force, [0.1])
    context = artificial.read(base, stiffer + bubble(base, there), np.random.default_rng(64))
    problem = solvable(context)
    every = np.ones(len(problem.labels), bool)
    gel = next(c for c in problem.candidates if c.name == "gel_stiffness")
    voids = [c for c in problem.candidates if c.name == "void"]
    alone = weighed(replace(problem, candidates=voids))[0]
    parts = (gel, *alone.parts)
    columns = [problem.covariance.whiten(part.columns) for part in parts]
    start = judged_by(problem.covariance.whiten(problem.residual), parts, columns)
    fit = refitted(problem, start, every)
    void = fit.parts[1]
    assert away(void.shape, there) < 0.1 * spacing and len(fit.spread) > 2
    change = problem.observations.flat(bubble(context, there))
    off = [
        np.linalg.norm(one.columns @ fit.amounts[1] - change)
        for one in (problem.at_its_place(void), problem.tried(void))
    ]
    assert off[0] < 0.6 * off[1]


def test_errors_are_of_form_once_a_place_is_found_and_a_step_too_far_is_not_taken():
    # Errors are of form once a place is found. In form as others do, and no more towards the next places
    problem = replace(problem_of(artificial.context(65, per_side=3), left_out=()), change_error=0.1)
    part = next(c for c in problem.candidates if c.name == "void" and c.tried == TRIED[12])
    there = displaced(part, {"x_mm": 1.0})
    assert there.shape["x_mm"] == TRIED[12]["x_mm"] + 1.0 and there.tried == TRIED[12]
    assert (problem.error_of(part), problem.error_of(there)) == (PLACE_ERROR, FORM_ERRORS[1])
    tried, found = (problem.errors_of([(one, np.ones(1))]) for one in (part, there))
    next_to = slice(6, None)  # before: three shares of pressing and of sideways forces
    assert found[:, :6] == pytest.approx(tried[:, :6] * FORM_ERRORS[1] / PLACE_ERROR)
    assert tried[:, next_to].any() and not found[:, next_to].any()

    # All physics errs by its form and a wrong entry by nothing
    problem = replace(problem_of(artificial.context(65, per_side=3), left_out=()), change_error=0.15)
    names = ("misregistration", "force_hysteresis", "force_gain", "force_unit")
    parts = [next(c for c in problem.candidates if c.name == name) for name in names]
    for error in FORM_ERRORS:
        wrong = [replace(part, form_error=error) for part in parts]
        # the base's mesh is behind what is solved, and not behind what the force sensor does
        assert [problem.error_of(part) for part in wrong] == [max(error, 0.15), error, error, 0.0]
    assert replace(problem, change_error=0.0).error_of(parts[0]) == 0.0

    # A step too far is not taken. Of a model that fits nowhere as well as where the fit begins
    base = artificial.context(66, per_side=3)
    context = artificial.with_effect(base, "gel_stiffness", [0.35], np.random.default_rng(67))
    problem = replace(problem_of(context), change_error=0.0)
    (own,) = (c for c in problem.candidates if c.name == "gel_stiffness")
    (start,) = screened(problem.residual, problem.covariance, [own])

    def odd(terms, rows):
        ((part, a),) = terms
        share = 0.9 if a == pytest.approx(start.amounts, abs=1e-9) else -1.0
        found = problem.base.copy()
        found[context.observations.read] += share * part.columns @ start.amounts
        return found

    fit = refitted(replace(problem, forces_with=odd), start, np.ones(len(problem.labels), bool))
    assert fit.amounts[0] == pytest.approx(start.amounts, abs=1e-9)


def test_evidence_is_averaged_over_errors_of_form():
    """A change off by two standard deviations of an error of 0.3 is better met by that error than by one of 0.1."""
    base = artificial.context(21, per_side=3)
    exact = problem_of(artificial.with_effect(base, "gel_stiffness", [0.5], np.random.default_rng(22)))
    part = next(c for c in exact.candidates if c.name == "gel_stiffness")
    problem, every = replace(exact, change_error=0.1), np.ones(len(exact.labels), bool)
    wrong = problem.errors_of([(replace(part, form_error=0.3), np.array([0.5]))])
    off = wrong @ np.array([0, 2, -2, 0, -2, 2.0])
    force = exact.observations.force.copy()
    force[exact.observations.read] += off
    problem = replace(problem, observations=replace(exact.observations, force=force))
    (alone,) = screened(
        problem.residual, problem.covariance, [c for c in problem.candidates if c.name == "gel_stiffness"]
    )
    each = []
    for error in FORM_ERRORS:
        part = replace(alone.parts[0], form_error=error)
        wider = problem.with_model_error([(part, alone.amounts)]).covariance
        more = log_evidence(wider, problem.residual, [part])
        more -= log_evidence(problem.covariance, problem.residual, [part])
        each.append(alone.log_bayes_factor + more)
    assert each[2] > each[0] + 1.0
    found = with_form_errors(problem, alone)
    assert found.parts[0].form_error == FORM_ERRORS[int(np.argmax(each))]
    assert found.log_bayes_factor == pytest.approx(np.logaddexp.reduce(each) - np.log(3))
    fit = refitted(problem, found, every)
    assert fit.parts[0].form_error == found.parts[0].form_error
    # the fit pays for the choice among the errors, as the set does
    best = refitted(problem, replace(found, log_bayes_factor=found.best_log_bayes_factor), every)
    assert fit.log_bayes_factor - best.log_bayes_factor == pytest.approx(
        found.log_bayes_factor - found.best_log_bayes_factor
    )
