"""What counts as a mismatch, and as a gain of what was held out: bounds that chance keeps to. ARTIFICIAL readings."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import judged, problem_of
from artificial_readings import draws_of

from gelforge.mismatch.inference.posterior import chance_of_known, weighed
from gelforge.mismatch.result.scores import shown
from gelforge.mismatch.thresholds import ALARM_P


def read_as(problem, residual):
    """Return the problem with other readings: the base and a residual (n,) [N]."""
    force = problem.base.copy()
    force[problem.observations.read] += residual
    return replace(problem, observations=replace(problem.observations, force=force))


@pytest.mark.thorough
def test_noise_gives_known_effects_little_evidence():
    """The mean Bayes factor of noise is 1, much of it in rare draws: of 200 hardly one beyond 10."""
    problem = problem_of(artificial.context(7, per_side=3))
    draws = draws_of(problem.covariance, np.random.default_rng(3), 200).T
    factors = 1 / np.array([chance_of_known(read_as(problem, draw)) for draw in draws])  # those below 1 as 1
    assert 1.0 < factors.mean() < 1.5
    assert (factors > 2).mean() < 1 / 2 and (factors > 10).mean() < 1 / 10  # Markov, with room for 200 draws


def test_the_bound_is_the_mean_of_the_bayes_factors_and_what_only_a_known_effect_can_see_is_an_alarm():
    # The bound is the mean of the bayes factors
    base = artificial.context(7, per_side=3)
    problem = problem_of(artificial.with_effect(base, "tilt", [0.4, 0.0], np.random.default_rng(5)))
    exact = replace(problem, change_error=0.0)  # as the bound takes them
    factors = np.exp([one.log_bayes_factor for one in weighed(exact)])
    assert chance_of_known(problem) == pytest.approx(min(1.0, 1 / factors.mean()), rel=1e-9)
    assert chance_of_known(problem) < 0.9

    # What only a known effect can see is an alarm. A grid that is turned by 2 degrees: neither its size nor any
    # pattern of the scan nor a random function shows it
    _, found = judged(artificial.with_effect(base, "yaw", [2.0], np.random.default_rng(8)))
    seen = found.mismatch
    assert min(seen.test.p, seen.scan.p, seen.unknown_p) > ALARM_P > seen.known_p
    assert found.state == "identified" and found.answer.fit.name == "yaw"


@pytest.mark.parametrize(
    ("total", "error", "clear"),
    [(3.0, 1.0, True), (1.9, 1.0, False), (5.0, 6.0, True), (4.5, 6.0, False), (-20.0, 0.0, False)],
)
def test_a_gain_is_shown_above_two_errors_or_a_hundred_to_one(total, error, clear):
    assert shown(total, error) is clear


def test_without_anything_to_find_a_gain_is_rarely_shown():
    """Of an answer that was fixed before: 1 % by odds of a hundred, 2.3 % of two standard errors where these are less."""
    rng, clear = np.random.default_rng(4), 0
    for distance in np.linspace(0.5, 12.0, 4000):  # of the promised change, in standard deviations
        noise = rng.standard_normal()
        clear += shown(distance * noise - distance**2 / 2, distance)
    assert clear <= 0.023 * 4000
