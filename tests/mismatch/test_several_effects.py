"""One effect or several, on ARTIFICIAL readings whose changes are patterns along chosen directions."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import SETTINGS, problem_of
from numpy.testing import assert_allclose

from gelforge.mismatch.alternatives import effects_of
from gelforge.mismatch.judge import judge
from gelforge.mismatch.screen import Candidate
from gelforge.mismatch.weighing import FELT_SNR, moved, weighed, weighed_beside


def patterned(patterns, change, truth):
    """Return a problem of some named effects, each one pattern along K axes, and the names of what was solved.

    Axes are orthonormal, in hundreds of standard deviations; change: amounts by name -> what they do along them (K,);
    truth: the same of what is read.
    """
    problem = problem_of(artificial.context(25, per_side=3))
    rng, n = np.random.default_rng(26), len(problem.labels)
    noise = problem.covariance.draw(rng, 1)[:, 0]
    covariance = problem.covariance
    # columns W^-1 q of orthonormal q, by least squares in the span of random draws of the covariance
    draws = covariance.draw(rng, max(map(len, patterns.values())))
    Q, R = np.linalg.qr(covariance.whiten(draws))
    basis = 100 * draws @ np.linalg.inv(R)
    assert_allclose(covariance.whiten(basis), 100 * Q, atol=1e-6)
    widths = {name: np.array([0.2]) for name in patterns}
    candidates = [
        Candidate(name, {}, basis @ np.array(pattern)[:, None], widths[name], np.zeros(1, int))
        for name, pattern in patterns.items()
    ]
    solved = []

    def forces_with(parts, amounts, rows):
        solved.append(tuple(part.name for part in parts))
        along = change({part.name: float(a[0]) for part, a in zip(parts, amounts)})
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


def test_one_effect_that_stands_for_a_pair_is_not_sure():
    """Two effects together look like a third but for 2.6 standard deviations: it is adequate, and as likely as they are."""
    patterns = {
        "gel_stiffness": [1, 0, 0],
        "wall_stiffness": [0, 1, 0],
        "skin_stiffness": [0.7, 0.7, np.sqrt(0.02)],
    }
    problem, _ = patterned(patterns, linear(patterns), [0.13, 0.13, 0.0])
    found = judge(problem, SETTINGS, seed=1).answer
    assert found.adequacy.p > 0.01
    pair = found.alternatives.probability[frozenset(["gel_stiffness", "wall_stiffness"])]
    alone = found.alternatives.probability[frozenset(["skin_stiffness"])]
    assert 0.02 < pair / alone < 50
    (group,) = found.groups
    assert group.members == ("skin_stiffness",) and group.probability < 1 - 0.5 * pair


def test_what_a_curved_effect_does_is_no_second_effect():
    """At its fitted amount it also does what another effect would; the linear change alone would ask for that one too."""
    patterns = {"gel_stiffness": [1, 0, 0], "wall_stiffness": [0, 1, 0], "skin_stiffness": [0, 0, 1]}

    def curved(amounts):
        a = amounts.get("gel_stiffness", 0.0)
        return linear(patterns)(amounts) + np.array([0.0, 10 / 3 * a**2, 0.0])

    problem, solved = patterned(patterns, curved, [0.2, 10 / 3 * 0.2**2, 0.0])
    found = judge(problem, SETTINGS, seed=1)
    assert found.state == "named" and found.answer.winner.name == "gel_stiffness"
    assert set(map(len, solved)) == {1}  # no pair was wanted
    # Of three effects either other one is beside it as likely as not at all: neither adds anything.
    both = {name: found.answer.alternatives.holding([name]) for name in ("wall_stiffness", "skin_stiffness")}
    assert both["wall_stiffness"] < 0.2 and abs(both["wall_stiffness"] - both["skin_stiffness"]) < 0.02


def test_what_a_refit_has_taken_back_is_not_promised_again():
    """Beside an effect that lost 20 in its refit a pair has 20 less than its linear change promises."""
    patterns = {"gel_stiffness": [1, 0, 0], "wall_stiffness": [0, 1, 0], "skin_stiffness": [0, 0, 1]}
    problem, _ = patterned(patterns, linear(patterns), [0.2, 0.1, 0.0])
    every = np.ones(len(problem.labels), bool)
    first = weighed(problem, every, problem.candidates)[0]
    promised, left = (
        weighed_beside(problem, every, set(patterns), [given]) for given in (first, moved(first, -20.0))
    )
    assert [one.name for one in left] == [one.name for one in promised]
    lost = [was.log_bayes_factor - one.log_bayes_factor for was, one in zip(promised, left)]
    assert_allclose(lost, 20.0)
    assert_allclose([one.paid for one in left], [one.paid for one in promised])  # no shape has cost it


def test_what_is_solved_in_order_is_solved_beside_others_only_for_the_best():
    """A softening gel beside a gain: its own solution is taken along in the fits, and both together are solved for the
    answer and for its amounts by all readings."""
    patterns = {"mullins": [1, 0, 0], "wall_stiffness": [0, 1, 0], "skin_stiffness": [0, 0, 1]}

    def curved(amounts):
        a = amounts.get("mullins", 0.0)
        return linear(patterns)(amounts) + np.array([a**2, 0.0, 0.0])

    problem, solved = patterned(patterns, curved, [0.2 + 0.2**2, 0.2, 0.0])
    found = judge(problem, SETTINGS, seed=1).answer
    assert effects_of(found.winner) == {"mullins", "wall_stiffness"}
    assert sum("mullins" in names and len(names) > 1 for names in solved) == 2
    assert sum(names == ("wall_stiffness",) for names in solved) > 1
    amounts = dict(zip((part.name for part in found.fit.parts), found.fit.amounts))
    assert amounts["mullins"] == pytest.approx(0.2, abs=0.03)  # its noise is 0.01


def test_an_answer_that_its_secant_makes_hardly_felt_is_still_an_answer():
    """A plausible amount is felt with 0.8 standard deviations, and with 0.4 as it is solved; the readings ask for more."""
    patterns = {"wall_stiffness": [1.0]}
    problem, _ = patterned(patterns, lambda amounts: 0.5 * linear(patterns)(amounts), [0.2])
    (weak,) = problem.candidates
    problem = replace(problem, candidates=[replace(weak, widths=np.array([0.008]))])
    found = judge(problem, SETTINGS, seed=1)
    (solved,) = found.answer.problem.candidates
    assert 0.008 * np.linalg.norm(problem.covariance.whiten(solved.columns)) < FELT_SNR
    assert found.answer.winner.name == "wall_stiffness"
