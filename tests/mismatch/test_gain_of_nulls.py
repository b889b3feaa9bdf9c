"""What the judge's own choice gains on readings set aside where there is nothing to find. ARTIFICIAL readings."""

import artificial
import numpy as np
import pytest
from artificial_problem import CATALOGUE, SETTINGS, problem_of

from gelforge.mismatch import search
from gelforge.mismatch.confirmation import forces_of, scores_of
from gelforge.mismatch.holdout import gain, paid_for_choice, split
from gelforge.mismatch.search import Terms, explained
from gelforge.mismatch.unknown import manners_of, weighed_unknown
from gelforge.mismatch.weighing import those_felt, weighed

NULLS = 24
# One shape each, of every family that forces feel: enough to choose among.
TRIED = {
    *("gel_stiffness", "law_exponent", "compressibility", "wall_stiffness", "tilt", "misregistration", "yaw"),
    *("contact_zero", "force_gain", "cross_talk"),
}


def null(seed):
    """Return a problem whose readings are the base and what its covariance allows, one reading of each press."""
    context = artificial.context(1000 + seed, per_side=3, depths=(0.5, 1.0, 2.0))
    once = (context.observations.table["phase"] == "load").to_numpy()
    return problem_of(context.chosen(once), left_out=set(CATALOGUE) - TRIED)


def forced(problem, seed):
    """Return the answer to a null: the judge asks for one only after an alarm, this one whatever was read."""
    blocks = split(problem.labels, seed)
    manners = manners_of(problem)[
        :1
    ]  # that of something unknown decides nothing here, and weighing all takes most of the time
    felt = those_felt(weighed(problem, blocks.train, problem.candidates))
    unknown = weighed_unknown(problem, manners)
    rng = np.random.default_rng(seed)
    answer, _ = explained(problem, Terms(blocks, SETTINGS, rng, len(felt), manners, unknown))
    return blocks, answer


def gain_of(problem, blocks, fit):
    left = problem.observations.flat(problem.observations.force - forces_of(problem, fit))
    scores = scores_of(problem, blocks, left, fit)
    return gain(scores["before"], scores["after"])


@pytest.fixture(scope="module")
def gains():
    """Return the held-out gains (NULLS,) of the answers as shipped, and of the best refits by training readings alone."""
    shipped, blind = [], []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "MOST_EFFECTS", 1)  # no null asks for a second effect: it saves the look ahead
        for seed in range(NULLS):
            problem = null(seed)
            blocks, answer = forced(problem, seed)
            shipped.append(answer.gain.total + answer.gain.paid)
            trained = max(answer.refits, key=lambda fit: fit.log_bayes_factor)
            blind.append(gain_of(problem, blocks, trained).total)
    return np.array(shipped), np.array(blind)


def standard_error(values):
    return np.std(values, ddof=1) / np.sqrt(len(values))


@pytest.mark.thorough
def test_what_training_readings_choose_gains_nothing_on_nulls(gains):
    _, blind = gains
    assert blind.mean() < -standard_error(blind)  # below 0 by more than chance (Gibbs' inequality)


@pytest.mark.thorough
def test_what_the_judge_chooses_gains_nothing_on_nulls(gains):
    """Less what it pays for the choice: without that the mean is +0.39 +- 0.14, and +0.31 +- 0.09 of 40 nulls."""
    shipped, _ = gains
    assert shipped.mean() <= standard_error(shipped)


def test_a_choice_costs_the_more_the_less_the_training_readings_had_chosen():
    trained = np.zeros(4)
    assert paid_for_choice(trained, np.array([5.0, -40.0, -40.0, -40.0])) == pytest.approx(-np.log(4))
    assert paid_for_choice(np.array([0.0, -9.0]), np.array([5.0, -20.0])) == pytest.approx(
        -np.log1p(np.exp(-9))
    )
    assert paid_for_choice(np.array([-9.0, 0.0]), np.array([5.0, -20.0])) < -8.9
    assert paid_for_choice(trained, np.full(4, 5.0)) == pytest.approx(0.0, abs=1e-12)  # all predict alike
    assert paid_for_choice(np.array([3.0]), np.array([7.0])) == 0.0
