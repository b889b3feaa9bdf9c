"""Probabilities over sets of no, one and several effects: priors that add up, and groups that know of pairs."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import poisson

from gelforge.mismatch.evidence.gaussian import NOTHING, UNKNOWN, log_prior
from gelforge.mismatch.inference.posterior import Posterior
from gelforge.mismatch.thresholds import NULL_PRIOR, TEMPERING


@pytest.mark.parametrize("known", [2, 40])
def test_priors_add_up_to_one_and_nothing_is_missing_half_of_the_time(known):
    """But for what Poisson's law has beyond all effects that there are: 3.3 % with two, nothing with forty."""
    by_count = np.array([comb(known, k) * np.exp(log_prior(k, known)) for k in range(known + 1)])
    assert by_count[0] == pytest.approx(NULL_PRIOR)
    assert by_count.sum() == pytest.approx(poisson.cdf(known, np.log(2)), abs=1e-12)
    assert_allclose(by_count[2] / by_count[1], np.log(2) / 2)


def posterior(evidence):
    """Return the posterior of sets by their log evidence, of forty effects."""
    return Posterior({}, {}, evidence, {}, 40, {})


def test_an_effect_that_stands_for_two_is_not_sure_and_counts_in_all_sets_that_hold_it():
    # One effect that stands for two is not sure where pairs do as well
    names = [f"effect {k}" for k in range(9)]
    evidence = {frozenset([names[0]]): 60.0}
    assert posterior(evidence).holding([names[0]]) > 0.999
    pairs = {frozenset(pair): 63.0 for pair in combinations(names[1:], 2)}
    both = posterior(evidence | pairs)
    odds = len(pairs) * np.exp(TEMPERING * 3.0 + log_prior(2, 40) - log_prior(1, 40))
    assert_allclose(both.holding([names[0]]), 1 / (1 + odds), rtol=1e-6)
    assert_allclose(sum(both.probability.values()), 1)
    # each of the others is in 7 of the 28 pairs; two of them in 13
    assert_allclose(both.holding(names[1:2]), odds / (1 + odds) * 7 / 28, rtol=1e-6)
    assert_allclose(both.holding(names[1:3]), odds / (1 + odds) * 13 / 28, rtol=1e-6)

    # A part of the evidence counts in all sets that hold an effect
    one, other, strange = frozenset(["tilt"]), frozenset(["yaw"]), frozenset([UNKNOWN])
    found = posterior({one: 12.0, other: 7.0, strange: 11.0}).probability
    assert_allclose(found[one] / found[other], np.exp(5.0 * TEMPERING))
    assert_allclose(found[one] / found[strange], np.exp(TEMPERING))
    assert_allclose(
        found[strange] / found[NOTHING], np.exp(TEMPERING * 11.0 + log_prior(1, 40) - log_prior(0, 40))
    )

    # An effect is as probable as all sets that hold it
    pair, tilt = frozenset(["tilt", "yaw"]), frozenset(["tilt"])
    found = posterior({pair: 50.0, tilt: 50.0})
    assert found.holding(["tilt"]) == pytest.approx(found.probability[pair] + found.probability[tilt])
