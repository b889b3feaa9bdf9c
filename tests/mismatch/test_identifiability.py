"""What a recording tells apart, what it detects, and which experiment would decide."""

from dataclasses import replace

import numpy as np
import pytest
from artificial_readings import covariance_of, draws_of, grid, readings
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal
from test_screen import make

from gelforge.mismatch.evidence.identifiability import (
    Plan,
    correlations,
    detection_limits,
    expected_log_odds,
    indistinguishable,
    next_experiment,
)
from gelforge.mismatch.evidence.screen import Candidate, screened
from gelforge.mismatch.inference.patterns import dictionary
from gelforge.mismatch.inference.scan import scan, whitened
from gelforge.mismatch.thresholds import DETECTED_SNR


@pytest.fixture(scope="module")
def world():
    context = readings(grid(3), depths=(0.5, 1.0, 1.5))
    return context, covariance_of(context), make(context)


def named(candidates, name):
    return next(c for c in candidates if c.name == name)


def test_correlations_are_cosines_and_of_several_parameters_the_share_that_can_be_followed():
    e = np.eye(4)
    one, mixed, plane = e[:, :1], (e[:, :1] + e[:, 1:2]) / np.sqrt(2), e[:, :2]
    changes = np.column_stack([one, 3 * mixed, np.zeros(4), mixed])
    found = correlations(changes, [one, mixed, np.zeros((4, 1)), plane])
    half = np.sqrt(0.5)
    assert_allclose(
        found[0], [1, half, 0, half], atol=1e-12
    )  # the plane follows `one`, which follows half of the plane's
    assert_allclose(found[1], [half, 1, 0, 1], atol=1e-12)
    assert_allclose(found, found.T)


def lines_of(covariance, candidates):
    r = draws_of(covariance, np.random.default_rng(1), 1)[:, 0]
    return indistinguishable(covariance, {one.name: one for one in screened(r, covariance, candidates)})


def test_effects_of_a_line_correlate_all_and_the_limit_has_the_stated_snr(world):
    # Effects of a line scale alike and correlate all
    _, covariance, candidates = world
    stiffness, drift = named(candidates, "gel_stiffness"), named(candidates, "force_drift")
    lines = lines_of(covariance, [stiffness, replace(stiffness, name="force_gain"), drift])
    assert lines["gel_stiffness"] == lines["force_gain"] == {"gel_stiffness", "force_gain"}
    assert lines["force_drift"] == {"force_drift"}
    assert lines_of(covariance, [drift]) == {"force_drift": {"force_drift"}}

    # Three changes 15 degrees apart: neighbours correlate by 0.966, the outer two by 0.866.
    covariance = world[1]
    draws = draws_of(covariance, np.random.default_rng(2), 2)
    _, R = np.linalg.qr(covariance.whiten(draws))
    basis = draws @ np.linalg.inv(R)
    fan = [
        Candidate(str(k), {}, basis @ [[np.cos(t)], [np.sin(t)]], np.ones(1), np.zeros(1, int))
        for k, t in enumerate(np.radians([0.0, 15.0, 30.0]))
    ]
    lines = lines_of(covariance, fan)
    assert "2" not in lines["0"] and sorted(map(len, set(lines.values()))) == [1, 2]

    # The limit has the stated snr
    _, covariance, candidates = world
    limits = {(part.name, k): (part, amount) for part, k, amount in detection_limits(covariance, candidates)}
    for candidate in candidates[:6]:
        for k in range(candidate.columns.shape[1]):
            part, amount = limits[candidate.name, k]
            change = amount * candidate.columns[:, k]
            assert part is candidate
            assert np.linalg.norm(covariance.whiten(change)) == pytest.approx(DETECTED_SNR)
    place, amount = limits["inclusion", 0]
    assert 0 < amount < np.inf and place in candidates
    nothing = Candidate("none", {}, np.zeros((len(covariance), 1)), np.ones(1), np.zeros(1, int))
    assert detection_limits(covariance, [nothing]) == [(nothing, 0, np.inf)]


def test_what_the_limit_promises(world):
    """At the limit the scan sees a change mostly, at half of it hardly: why 4 is the limit."""
    context, covariance, candidates = world
    labels = context.observations.labels()
    atoms = whitened(dictionary(labels, context.observations.flat(context.force)), covariance)
    column = named(candidates, "late").columns[:, 0]
    change = DETECTED_SNR * column / np.linalg.norm(covariance.whiten(column))
    noise = draws_of(covariance, np.random.default_rng(4), 200)

    def seen(share):
        white = covariance.whiten(share * change[:, None] + noise)
        return np.mean([scan(r, atoms, np.random.default_rng(0), draws=1000).p < 0.025 for r in white.T])

    assert 0.5 < seen(1.0) < 0.95
    assert seen(0.5) < 0.25
    assert seen(1.5) > 0.95


@pytest.mark.parametrize("erring", [0.0, 0.3])
def test_expected_log_odds_are_the_mean_of_many_experiments(world, erring):
    """With errors of the late effect's own change too, of some standard deviations in all."""
    _, covariance, candidates = world
    rng = np.random.default_rng(6)
    drift, late = named(candidates, "force_drift"), named(candidates, "late")
    r = drift.columns @ [0.02, 0.0, -0.02] + draws_of(covariance, rng, 1)[:, 0]
    first, second = (screened(r, covariance, [c])[0] for c in (drift, late))
    columns = {"force_drift": drift.columns, "late": late.columns}
    apart = np.sin(3 * np.arange(len(r)))[:, None]
    errors = {"late": erring * covariance.standard_deviation[:, None] * np.hstack([1 + apart, apart])}
    plan = Plan("again", 60.0, 5, covariance, columns, errors if erring else {})
    W = covariance.whiten(np.eye(len(r)))
    C = np.linalg.inv(W.T @ W)
    laws = [
        multivariate_normal(j.change, C + j.parts[0].columns @ j.covariance @ j.parts[0].columns.T + E @ E.T)
        for j, E in ((first, 0 * errors["late"]), (second, errors["late"]))
    ]
    odds = []
    for right, wrong in (laws, laws[::-1]):
        draws = right.rvs(4000, random_state=rng)
        odds.append(right.logpdf(draws) - wrong.logpdf(draws))
    wanted, error = np.mean(odds), np.sqrt(np.sum(np.var(odds, axis=1)) / 4 / 4000)
    assert abs(expected_log_odds(plan, first, second) - wanted) < 4 * error


def test_the_cheapest_deciding_experiment_comes_first(world):
    _, covariance, candidates = world
    stiffness = named(candidates, "gel_stiffness")
    twin = replace(stiffness, name="force_gain")
    r = 0.4 * stiffness.columns[:, 0] + draws_of(covariance, np.random.default_rng(7), 1)[:, 0]
    first, second = (screened(r, covariance, [c])[0] for c in (stiffness, twin))
    same = {"gel_stiffness": stiffness.columns, "force_gain": twin.columns}
    weights = {
        "gel_stiffness": 0 * stiffness.columns,
        "force_gain": twin.columns,
    }  # dead weights: no gel is pressed
    plans = [
        Plan("the same again", 10.0, 5, covariance, same),
        Plan("many dead weights", 90.0, 0, covariance, weights),
        Plan("dead weights", 20.0, 0, covariance, weights),
    ]
    found = next_experiment(plans, first, second)
    assert [e.words for e in found][:2] == ["dead weights", "many dead weights"]
    assert found[0].decides and not found[2].decides
    # Two effects of one change differ only by their amounts' priors, which are equal here.
    assert found[2].expected_log_odds == pytest.approx(0, abs=1e-9)
    most = next_experiment(
        [plans[0], Plan("a little", 5.0, 0, covariance, {**weights, "force_gain": 0.01 * twin.columns})],
        first,
        second,
    )
    assert most[0].words == "a little"
