"""Evidence of a refit where an amount's sign holds it at none: of a linear problem it is the screen's, which is exact."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import problem_of

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.screen import screened
from gelforge.mismatch.summary.effect_entries import interval
from gelforge.mismatch.terms.refit import _step, refitted


@pytest.mark.thorough(but_first=2)
@pytest.mark.parametrize("amount", [0.1, 0.0, -0.02, -0.1])
def test_the_evidence_of_one_sign_is_exact(amount):
    """Negative ones, too, which readings may ask for and which are held at none."""
    base = artificial.context(51, per_side=3)
    context = artificial.with_effect(base, "frame_compliance", [amount], np.random.default_rng(52))
    problem = replace(problem_of(context), change_error=0.0)
    (own,) = (c for c in problem.candidates if c.name == "frame_compliance")
    every = np.ones(len(problem.labels), bool)
    (start,) = screened(problem.residual, problem.covariance, [own])
    fit = refitted(problem, start, every)
    assert fit.log_bayes_factor == pytest.approx(start.log_bayes_factor, abs=1e-6)
    assert fit.amounts[0][0] >= 0 and (amount >= 0 or fit.amounts[0][0] < 1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_what_a_bound_holds_back_leaves_the_others_where_they_fit_best_beside_it(seed):
    """The conditions of Karush, Kuhn and Tucker; a step that is cut after it was solved leaves the others' slope."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((9, 4)) @ np.diag([1.0, 1.0, 10.0, 1.0])
    H, gradient = J.T @ J, 30 * rng.standard_normal(4)
    a, low, high = np.zeros(4), np.full(4, -0.5), np.full(4, 0.3)
    moving = np.arange(4) != 3
    step = _step(H, gradient, a, low, high, moving)
    slope = (gradient - H @ step)[moving]
    tolerance = 1e-9 * np.abs(gradient).max()  # rounding
    for s, g in zip(step[moving], slope):
        up, down = np.isclose(s, 0.3, rtol=1e-12), np.isclose(s, -0.5, rtol=1e-12)
        assert up or down or -0.5 < s < 0.3
        assert abs(g) < tolerance or (up and g > 0) or (down and g < 0)
    assert step[3] == 0 and np.abs(step).max() > 0.299  # one at least is held


def test_all_that_there_can_be_is_reached_and_physical():
    """A bond that reads as lost four times over is lost: no amount below that, and no refusal."""
    base = artificial.context(51, per_side=3)
    problem = problem_of(artificial.with_effect(base, "wall_gap", [4.0], np.random.default_rng(52)))
    every = np.ones(len(problem.labels), bool)
    (own,) = (c for c in problem.candidates if c.name == "wall_gap")
    (start,) = screened(problem.residual, problem.covariance, [own])
    fit = refitted(problem, start, every)
    assert fit.amounts[0] == [1.0] and fit.converged
    assert CATALOGUE["wall_gap"].in_range(fit.amounts[0])


def test_intervals_stay_in_the_physical_range():
    compliance, turn = CATALOGUE["frame_compliance"].parameters[0], CATALOGUE["yaw"].parameters[0]
    assert interval(compliance, 0.0, 0.1) == (0.0, pytest.approx(0.1645, abs=1e-4))
    assert interval(compliance, 0.3, 0.1)[0] == pytest.approx(0.3 - 0.1645, abs=1e-4)
    assert interval(compliance, compliance.bounds[1], 0.1)[1] == compliance.bounds[1]
    assert interval(turn, 0.0, 1.0)[0] == pytest.approx(-1.645, abs=1e-3)
