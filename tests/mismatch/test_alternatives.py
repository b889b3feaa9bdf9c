"""Probabilities over answers of no, one and several effects: priors that add up, and groups that know of pairs."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import poisson

from gelforge.mismatch.alternatives import NULL_PRIOR, UNKNOWN, WORTH, Alternatives, log_prior


@pytest.mark.parametrize("known", [2, 40])
def test_priors_add_up_to_one_and_nothing_is_missing_half_of_the_time(known):
    """But for what Poisson's law has beyond all effects that there are: 3.3 % with two, nothing with forty."""
    each = np.array([comb(known, k) * np.exp(log_prior(k, known)) for k in range(known + 1)])
    assert each[0] == pytest.approx(NULL_PRIOR)
    assert each.sum() == pytest.approx(poisson.cdf(known, np.log(2)), abs=1e-12)
    assert_allclose(each[2] / each[1], np.log(2) / 2)


def test_one_effect_that_stands_for_two_is_not_sure_where_pairs_do_as_well():
    names = [f"effect {k}" for k in range(9)]
    evidence = {frozenset([names[0]]): 60.0}
    alone = Alternatives(evidence, 40)
    assert alone.holding([names[0]]) > 0.999
    pairs = {frozenset(pair): 63.0 for pair in combinations(names[1:], 2)}
    both = Alternatives(evidence | pairs, 40)
    odds = len(pairs) * np.exp(WORTH * 3.0 + log_prior(2, 40) - log_prior(1, 40))
    assert_allclose(both.holding([names[0]]), 1 / (1 + odds), rtol=1e-6)
    assert_allclose(sum(both.probability.values()), 1)
    # each of the others is in 7 of the 28 pairs; two of them in 13
    assert_allclose(both.holding(names[1:2]), odds / (1 + odds) * 7 / 28, rtol=1e-6)
    assert_allclose(both.holding(names[1:3]), odds / (1 + odds) * 13 / 28, rtol=1e-6)


def test_known_answers_share_by_a_part_of_their_evidence_what_they_have_beside_nothing_and_the_unknown():
    one, other, strange = frozenset(["tilt"]), frozenset(["yaw"]), frozenset([UNKNOWN])
    found = Alternatives({one: 12.0, other: 7.0, strange: 11.0}, 40).probability
    assert_allclose(found[one] / found[other], np.exp(5.0 * WORTH))
    known, each = np.exp(12.0) + np.exp(7.0), np.exp(log_prior(1, 40))
    assert_allclose((found[one] + found[other]) / found[strange], known / np.exp(11.0))
    assert_allclose((found[one] + found[other]) / found[frozenset()], known * each / np.exp(log_prior(0, 40)))
    alone = Alternatives({strange: 11.0}, 40).probability  # no known one was tried
    assert_allclose(alone[strange] / alone[frozenset()], np.exp(11.0) * each / np.exp(log_prior(0, 40)))


def test_a_likelier_answer_of_one_more_effect_is_seen():
    one, two = frozenset(["tilt"]), frozenset(["tilt", "yaw"])
    found = Alternatives({one: 50.0, two: 55.0}, 40)
    dearer = log_prior(1, 40) - log_prior(2, 40)
    assert 3.9 < dearer < 4.2
    weight = found.weight(one, 50.0)
    assert found.likelier_of(2, weight) and not found.likelier_of(2, weight + 1.2)
    assert not found.likelier_of(3, weight)


def test_something_unknown_that_is_likelier_alone_asks_for_one_effect_more():
    one, unknown = frozenset(["tilt"]), frozenset([UNKNOWN])
    found = Alternatives({one: 50.0, unknown: 60.0}, 40)
    weight = found.weight(one, 50.0)
    assert found.likelier_of(2, weight + 9) and not found.likelier_of(2, weight + 11)
    assert not Alternatives({one: 50.0, frozenset(["yaw"]): 60.0}, 40).likelier_of(2, weight)


def test_what_adds_to_an_answer_is_left_out_and_what_stands_in_its_place_is_not():
    tilt, pair, more = frozenset(["tilt"]), frozenset(["yaw", "void"]), frozenset(["tilt", "yaw"])
    strange = frozenset(["tilt", UNKNOWN])
    found = Alternatives({tilt: 50.0, pair: 53.0, more: 60.0, strange: 51.0}, 40).without_more_than(tilt)
    assert set(found.evidence) == {tilt, pair, strange}
    assert found.holding(["yaw"]) == found.probability[pair]
