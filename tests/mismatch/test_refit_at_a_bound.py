"""Evidence of a refit where an amount's sign holds it at none: of a linear problem it is the screen's, which is exact."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import problem_of

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects_told import _interval
from gelforge.mismatch.refit import refitted
from gelforge.mismatch.screen import screened


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


def test_intervals_stay_in_the_physical_range():
    compliance, turn = CATALOGUE["frame_compliance"].parameters[0], CATALOGUE["yaw"].parameters[0]
    assert _interval(compliance, 0.0, 0.1) == (0.0, pytest.approx(0.1645, abs=1e-4))
    assert _interval(compliance, 0.3, 0.1)[0] == pytest.approx(0.3 - 0.1645, abs=1e-4)
    assert _interval(compliance, compliance.bounds[1], 0.1)[1] == compliance.bounds[1]
    assert _interval(turn, 0.0, 1.0)[0] == pytest.approx(-1.645, abs=1e-3)
