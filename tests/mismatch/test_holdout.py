"""What is held out, and what is said of it: against dense conditional densities, and with nothing to find."""

from dataclasses import replace

import numpy as np
import pytest
from artificial_readings import covariance_of, draws_of, grid, readings
from scipy.stats import multivariate_normal
from test_screen import make

from gelforge.mismatch.evidence.screen import screened
from gelforge.mismatch.inference.holdout import (
    Blocks,
    Prediction,
    gain,
    predictive_scores,
    selection_penalty_of,
    split,
)
from gelforge.mismatch.result.scores import shown


@pytest.fixture(scope="module")
def world():
    context = readings(grid(3), depths=(0.5, 1.0, 1.5))
    return context.observations.labels(), covariance_of(context), make(context)


def test_readings_are_set_aside_in_turns_and_scored_as_dense_matrices_do(world):
    # A quarter of sites and depths is held out in turns
    labels, _, _ = world
    blocks = split(labels, seed=3)
    assert labels["site"][blocks.held["positions"]].nunique() == 2  # of 9
    assert set(labels["depth_mm"][blocks.held["deepest"]]) == {1.0, 1.5}  # of 0.25, 0.5, 0.75, 1, 1.5
    parts = np.array([blocks.train, *blocks.held.values()])
    assert np.all(parts.sum(axis=0) == 1)
    held = set(labels["site"][blocks.held["positions"]])
    assert not held & set(labels["site"][blocks.train | blocks.held["deepest"]])
    assert np.all(split(labels, seed=3).train == blocks.train)
    assert np.any(split(labels, seed=4).train != blocks.train)
    assert np.all(blocks.held_out == ~blocks.train)

    # Turns go through all sites
    held = [set(labels["site"][split(labels, 0, turn).held["positions"]]) for turn in range(5)]
    assert set.union(*held) == set(range(9)) and not held[0] & held[1]

    # Scores are those of dense matrices. With the amounts' posterior from the training readings the scores add up
    # to ln p(all) - ln p(training)
    labels, covariance, candidates = world
    drift = candidates[4]
    rng = np.random.default_rng(0)
    r = drift.columns @ [0.03, -0.03, 0.02] + draws_of(covariance, rng, 1)[:, 0]
    blocks = split(labels, seed=3)
    t = blocks.train
    W = covariance.whiten(np.eye(len(r)))
    C = np.linalg.inv(W.T @ W)
    prior = np.diag(drift.prior_sd**2)
    K = C + drift.columns @ prior @ drift.columns.T
    wanted = multivariate_normal.logpdf(r, cov=K) - multivariate_normal.logpdf(r[t], cov=K[np.ix_(t, t)])
    J, inverse = drift.columns[t], np.linalg.inv(C[np.ix_(t, t)])
    S = np.linalg.inv(J.T @ inverse @ J + np.linalg.inv(prior))
    a = S @ J.T @ inverse @ r[t]
    scores = predictive_scores(Prediction(r - drift.columns @ a, covariance, drift.columns, S), blocks)
    assert sum(scores.values())[0] == pytest.approx(wanted, abs=1e-6)
    plain = predictive_scores(Prediction(r, covariance), blocks)
    wanted = multivariate_normal.logpdf(r, cov=C) - multivariate_normal.logpdf(r[t], cov=C[np.ix_(t, t)])
    assert sum(plain.values())[0] == pytest.approx(wanted, abs=1e-6)
    assert list(plain) == list(scores) == ["positions", "deepest"]
    total, _ = gain(sum(plain.values()), sum(scores.values()))
    assert total == pytest.approx(sum(scores[name][0] - plain[name][0] for name in plain))


def test_of_one_or_two_sites_the_deepest_readings_are_set_aside_and_a_choice_has_its_cost():
    # Of one or two sites the deepest readings are held out
    labels = readings(grid(2)[:2]).observations.labels()
    deepest, first, second = (split(labels, 0, turn) for turn in range(3))
    assert not deepest.held["positions"].any() and deepest.held["deepest"].any()
    assert set(labels["site"][deepest.train]) == {0, 1}
    for blocks, site in ((first, 0), (second, 1)):
        assert set(labels["site"][blocks.held["positions"]]) == {site}
        assert set(labels["site"][blocks.train]) == {1 - site} and not blocks.held["deepest"].any()

    # A single site keeps its shallow readings
    labels = readings(grid(1)).observations.labels()
    blocks = split(labels, 0)
    assert not blocks.held["positions"].any() and blocks.held["deepest"].any() and blocks.train.any()

    # A choice costs the more the less the training readings had chosen
    trained = np.zeros(4)
    assert selection_penalty_of(trained, np.array([5.0, -40.0, -40.0, -40.0])) == pytest.approx(-np.log(4))
    assert selection_penalty_of(np.array([0.0, -9.0]), np.array([5.0, -20.0])) == pytest.approx(
        -np.log1p(np.exp(-9))
    )
    assert selection_penalty_of(np.array([-9.0, 0.0]), np.array([5.0, -20.0])) < -8.9
    assert selection_penalty_of(trained, np.full(4, 5.0)) == pytest.approx(
        0.0, abs=1e-12
    )  # all predict alike
    assert selection_penalty_of(np.array([3.0]), np.array([7.0])) == 0.0


def chosen_gain(r, covariance, candidates, blocks):
    """Return the held-out gain of the effect that the training readings put first."""
    t = blocks.train
    part = [replace(candidate, columns=candidate.columns[t]) for candidate in candidates]
    best = screened(r[t], covariance.restricted(t), part)[0]
    name, hyperparameters = best.name, best.parts[0].hyperparameters
    columns = next(c.columns for c in candidates if (c.name, c.hyperparameters) == (name, hyperparameters))
    change = columns @ best.theta
    before = predictive_scores(Prediction(r, covariance), blocks, change)
    after = predictive_scores(Prediction(r - change, covariance, columns, best.covariance), blocks)
    return name, gain(sum(before.values()), sum(after.values()))


@pytest.mark.thorough
def test_nothing_to_find_gives_no_gain_and_its_error_is_what_noise_gives(world):
    # Nothing to find gives no gain. Whatever the training readings choose: without a mismatch the expected gain is
    # at most 0 (Gibbs' inequality)
    labels, covariance, candidates = world
    rng, gains, clear = np.random.default_rng(1), [], 0
    for _ in range(150):
        blocks = split(labels, seed=int(rng.integers(1 << 30)))
        found = chosen_gain(draws_of(covariance, rng, 1)[:, 0], covariance, candidates, blocks)[1]
        gains.append(found[0])
        clear += shown(*found)
    error = np.std(gains) / np.sqrt(len(gains))
    assert np.mean(gains) < -error  # below 0 by more than chance
    assert clear <= 8  # 5 %

    # The error of a gain is what noise gives it. For fixed predictions the gain scatters over draws of noise as its
    # standard error says, also where one site gains
    labels, covariance, _ = world
    blocks = split(labels, seed=3)
    where = (labels["site"] == labels["site"][blocks.held["positions"]].iloc[0]).to_numpy()
    change = np.where(where, 0.02, 0.0)
    gains, rng = [], np.random.default_rng(5)
    for _ in range(300):
        r = change + draws_of(covariance, rng, 1)[:, 0]
        before = predictive_scores(Prediction(r, covariance), blocks, change)
        after = predictive_scores(Prediction(r - change, covariance), blocks)
        total, expected = gain(sum(before.values()), sum(after.values()))
        gains.append(total)
    # of 300 draws a standard deviation is known to 1 / sqrt(600) = 4 %; three times that
    assert np.std(gains) == pytest.approx(expected, rel=0.12)
    assert np.mean(gains) == pytest.approx(expected**2 / 2, rel=0.12)


def test_what_is_there_is_predicted_by_presses_that_are_fitted_and_training_is_needed(world):
    # What is there is predicted
    labels, covariance, candidates = world
    drift = candidates[4]
    rng, clear = np.random.default_rng(2), 0
    for k in range(10):
        r = drift.columns @ [0.06, -0.06, 0.06] + draws_of(covariance, rng, 1)[:, 0]
        name, found = chosen_gain(r, covariance, candidates, split(labels, seed=k))
        assert name == "force_drift" and found[0] > 5
        clear += shown(*found)
    assert clear >= 8

    # Presses held out are not fitted and training is needed. A depth error of one held-out indentation costs it
    # alone what its variance allows, whatever the training says
    labels, covariance, _ = world
    blocks = split(labels, seed=3)
    r = draws_of(covariance, np.random.default_rng(4), 1)[:, 0]
    scores = predictive_scores(Prediction(r, covariance), blocks)
    at = covariance.restricted(blocks.held["positions"])
    # Without what sites share (law and floor, small here) the held-out sites would be independent of training.
    alone = at.log_density(r[blocks.held["positions"]])
    assert scores["positions"][0] == pytest.approx(alone, abs=15)

    # No training is an error
    every = np.ones(len(labels), bool)
    with pytest.raises(ValueError, match="training"):
        predictive_scores(Prediction(np.zeros(len(labels)), covariance), Blocks(~every, {"all": every}))
