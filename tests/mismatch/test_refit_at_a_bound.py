"""Evidence of a refit where a value's sign holds it at none: of a linear problem it is the screen's, which is exact."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import problem_of

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.refit import refitted
from gelforge.mismatch.evidence.screen import judged_under, screened
from gelforge.mismatch.summary.findings import interval


@pytest.mark.thorough(but_first=2)
@pytest.mark.parametrize("value", [0.1, 0.0, -0.02, -0.1])
def test_the_evidence_of_one_sign_is_exact(value):
    """Negative ones, too, which readings may ask for and which are held at none."""
    base = artificial.context(51, per_side=3)
    context = artificial.with_effect(base, "frame_compliance", [value], np.random.default_rng(52))
    problem = replace(problem_of(context), change_error=0.0)
    (own,) = (c for c in problem.candidates if c.name == "frame_compliance")
    every = np.ones(len(problem.labels), bool)
    (start,) = screened(problem.residual, problem.covariance, [own])
    fit = refitted(problem, start, every)
    assert fit.log_bayes_factor == pytest.approx(start.log_bayes_factor, abs=1e-6)
    assert fit.theta[0][0] >= 0 and (value >= 0 or fit.theta[0][0] < 1e-3)


def test_what_a_bound_holds_back_is_reached_within_the_physical_range():
    # What a bound holds back leaves the others where they fit best next to it. A compliance that the readings ask
    # for below zero is held at none; the slope of the rest is none there
    base = artificial.context(51, per_side=3)
    both = CATALOGUE["frame_compliance"].to_forces(base, {}, base.force, [-0.1])
    both = CATALOGUE["skin_stiffness"].to_forces(base, {}, both, [0.3])
    problem = problem_of(artificial.read(base, both, np.random.default_rng(52)))
    problem = replace(problem, change_error=0.0)
    parts = [c for c in problem.candidates if c.name in ("frame_compliance", "skin_stiffness")]
    every = np.ones(len(problem.labels), bool)
    start = judged_under(problem.covariance, problem.residual, parts)
    fit = refitted(problem, start, every)
    a = dict(zip([part.name for part in fit.parts], np.concatenate(fit.theta)))
    assert a["frame_compliance"] == 0.0
    left = problem.covariance.whiten(problem.residual - fit.columns @ np.concatenate(fit.theta))
    J, prior_sd = problem.covariance.whiten(fit.columns), np.concatenate([p.prior_sd for p in fit.parts])
    slope = J.T @ left - np.concatenate(fit.theta) / prior_sd**2
    held = [part.name == "frame_compliance" for part in fit.parts]
    sd = np.sqrt(np.diag(fit.spread))
    assert slope[held] < 0 and np.abs(slope * sd)[np.logical_not(held)] < 0.05

    # All that there can be is reached and physical. A bond that reads as lost four times over is lost: no amount
    # below that, and no refusal
    problem = problem_of(artificial.with_effect(base, "wall_gap", [4.0], np.random.default_rng(52)))
    every = np.ones(len(problem.labels), bool)
    (own,) = (c for c in problem.candidates if c.name == "wall_gap")
    (start,) = screened(problem.residual, problem.covariance, [own])
    fit = refitted(problem, start, every)
    assert fit.theta[0] == [1.0] and fit.converged
    assert CATALOGUE["wall_gap"].in_range(fit.theta[0])

    # Intervals stay in the physical range
    compliance, turn = CATALOGUE["frame_compliance"].parameters[0], CATALOGUE["yaw"].parameters[0]
    assert interval(compliance, 0.0, 0.1) == (0.0, pytest.approx(0.1645, abs=1e-4))
    assert interval(compliance, 0.3, 0.1)[0] == pytest.approx(0.3 - 0.1645, abs=1e-4)
    assert interval(compliance, compliance.bounds[1], 0.1)[1] == compliance.bounds[1]
    assert interval(turn, 0.0, 1.0)[0] == pytest.approx(-1.645, abs=1e-3)
