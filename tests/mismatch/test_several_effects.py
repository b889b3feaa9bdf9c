"""One effect or several, on ARTIFICIAL readings whose changes are patterns along chosen directions."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import SETTINGS, problem_of
from artificial_readings import draws_of
from numpy.testing import assert_allclose

from gelforge.mismatch.evidence.kernels import kernels_of
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.inference.fits import fitted
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.inference.posterior import posterior_of


def patterned(patterns, change, truth):
    """Return a problem of some named effects, each one pattern along K axes, and the names of what was solved.

    Axes are orthonormal, in hundreds of standard deviations; change: amounts by name -> what they do along them (K,);
    truth: the same of what is read.
    """
    problem = problem_of(artificial.context(25, per_side=3))
    rng, n = np.random.default_rng(26), len(problem.labels)
    noise = draws_of(problem.covariance, rng, 1)[:, 0]
    covariance = problem.covariance
    # columns W^-1 q of orthonormal q, by least squares in the span of random draws of the covariance
    draws = draws_of(covariance, rng, max(map(len, patterns.values())))
    Q, R = np.linalg.qr(covariance.whiten(draws))
    basis = 100 * draws @ np.linalg.inv(R)
    assert_allclose(covariance.whiten(basis), 100 * Q, atol=1e-6)
    prior_sd = {name: np.array([0.2]) for name in patterns}
    candidates = [
        Candidate(name, {}, basis @ np.array(pattern)[:, None], prior_sd[name], np.zeros(1, int))
        for name, pattern in patterns.items()
    ]
    solved = []

    def forces_with(terms, rows):
        solved.append(tuple(part.name for part, _ in terms))
        along = change({part.name: float(a[0]) for part, a in terms})
        found = np.full(problem.base.shape, np.nan)
        found[problem.observations.read] = problem.base[problem.observations.read] + basis @ along
        found[~rows] = np.nan
        return found

    force = problem.base.copy()
    force[problem.observations.read] += basis @ np.array(truth, dtype=float) + noise
    observations = replace(problem.observations, force=force)
    assert n == len(basis)
    return replace(
        problem, observations=observations, candidates=candidates, forces_with=forces_with, change_error=0.0
    ), solved


def linear(patterns):
    return lambda amounts: sum(a * np.array(patterns[name]) for name, a in amounts.items())


def test_one_effect_that_stands_for_a_pair_is_not_sure_and_a_curved_one_is_no_second():
    # One effect that stands for a pair is not sure. Two effects together look like a third but for 2.6 standard
    # deviations: it is adequate, and as likely as they are
    patterns = {
        "gel_stiffness": [1, 0, 0],
        "wall_stiffness": [0, 1, 0],
        "skin_stiffness": [0.7, 0.7, np.sqrt(0.02)],
    }
    problem, _ = patterned(patterns, linear(patterns), [0.13, 0.13, 0.0])
    found = judge(problem, SETTINGS, seed=1)
    assert found.answer.adequacy.p > 0.01
    pair = found.posterior.probability[frozenset(["gel_stiffness", "wall_stiffness"])]
    alone = found.posterior.probability[frozenset(["skin_stiffness"])]
    assert 0.02 < pair / alone < 50
    chance = {group.members[0]: group.probability for group in found.answer.groups}
    for name, other in (("skin_stiffness", pair), ("gel_stiffness", alone), ("wall_stiffness", alone)):
        if name in chance:
            assert chance[name] < 1 - 0.5 * other

    # What a curved effect does is no second effect. At its fitted amount it also does what another effect would;
    # the linear change alone would ask for that one too
    patterns = {"gel_stiffness": [1, 0, 0], "wall_stiffness": [0, 1, 0], "skin_stiffness": [0, 0, 1]}

    def curved(amounts):
        a = amounts.get("gel_stiffness", 0.0)
        return linear(patterns)(amounts) + np.array([0.0, 10 / 3 * a**2, 0.0])

    problem, _ = patterned(patterns, curved, [0.2, 10 / 3 * 0.2**2, 0.0])
    found = judge(problem, SETTINGS, seed=1)
    assert found.state == "identified"
    assert [group.members for group in found.answer.sure] == [["gel_stiffness"]]


def test_the_largest_effect_is_fitted_first_and_orders_are_solved_at_the_end():
    # What is solved in order is solved at the end of a fit and for the answer. A softening gel next to a wall: fits
    # take its change for linear, as each solution follows all presses anew
    patterns = {"mullins": [1, 0, 0], "wall_stiffness": [0, 1, 0], "skin_stiffness": [0, 0, 1]}
    problem, solved = patterned(patterns, linear(patterns), [0.2, 0.2, 0.0])
    found = judge(problem, SETTINGS, seed=1).answer
    assert found.fit.effects == {"mullins", "wall_stiffness"}
    assert sum("mullins" in names and len(names) > 1 for names in solved) == 2
    amounts = dict(zip((part.name for part in found.fit.parts), found.fit.amounts))
    assert amounts["mullins"] == pytest.approx(0.2, abs=0.03)  # its noise is 0.01

    # The largest effect is fitted alone first. Its curvature looks like a second effect to the linear pass, which
    # has it next to 60 standard deviations of change
    patterns = {"gel_stiffness": (1, 0, 0), "friction": (0, 0.5, 0.5), "skin_stiffness": (0, 0, 1)}

    def curved(amounts):
        along = linear(patterns)(amounts)
        return along + np.array([0, 0.5, 0.5]) * amounts.get("gel_stiffness", 0.0) ** 2

    problem, solved = patterned(patterns, curved, curved({"gel_stiffness": 0.6}))
    kernels = kernels_of(problem)
    posterior = posterior_of(problem, kernels)
    (first, *_) = posterior.ranked()
    assert first == {"gel_stiffness", "friction"}
    found = fitted(problem, posterior, lambda again: posterior_of(again, kernels))
    assert set(solved[0]) == {"gel_stiffness"}
    assert found.mode == {"gel_stiffness"}
