"""Scores of cases whose answers are known."""

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq

from validation.score import Judged, Rate, held_out_gain, judged_from, scores, wrong_cases


@pytest.mark.parametrize(("k", "n"), [(0, 200), (4, 200), (51, 60), (60, 60), (1, 3)])
def test_wilsons_interval_holds_the_rates_that_the_score_test_accepts(k, n):
    """Its bounds are where |p_hat - p| = z sqrt(p (1 - p) / n), found here by bisection."""
    z, share = 1.959963984540054, k / n
    test = lambda p: abs(share - p) - z * np.sqrt(p * (1 - p) / n)  # noqa: E731
    low = brentq(test, 1e-12, share - 1e-12) if k else 0.0
    high = brentq(test, share + 1e-12, 1 - 1e-12) if k < n else 1.0
    assert Rate(k, n).interval() == pytest.approx((low, high), abs=1e-9)


def test_rates_wrong_cases_and_claims_of_rivals_are_counted():
    # Rates medians and wrong cases are counted
    assert Rate(0, 0).interval() == (0.0, 1.0)

    # How often the tests fire is counted on nulls whose p is known
    nulls = [Judged("null", 0.0, (), "consistent", (), p=p) for p in (0.5, 0.009, 0.011, float("nan"))]
    other = Judged("single", 10.0, ("tilt",), "consistent", (), p=1e-6)
    assert scores([*nulls, other])["a test below 0.01 on nulls"] == Rate(1, 3)

    # Median size of right groups
    assert scores(CASES)["median size of right groups"] == 1.5

    # Wrong cases are listed
    named = [(f"c{k}", {"effects": []}, judged) for k, judged in enumerate(CASES)]
    # a weak single that is called wrong is wrong; a weak one that is not seen would not be
    assert list(wrong_cases(named)["case"]) == ["c2", "c3", "c6", "c7", "c9", "c10", "c12"]

    # Rivals lines and free forms count as claims
    answer = [{"members": ["wedge"], "or_else": ["tilt"], "probability": 0.95}]
    verdict = {"state": "identified", "answer": answer, "effects": []}
    found = judged_from(truth_of([[0, 0, 0]] * 2), verdict, None)
    assert found.found == [True] and not found.first and not found.wrong_and_confident

    # A line is claimed and the credible set is the answer
    answer = [{"members": ["wedge"], "alternatives": ["tilt"], "probability": 0.95}]
    verdict = {"state": "identified", "answer": answer, "effects": []}
    found = judged_from(truth_of([[0, 0, 0]] * 2), verdict, None)
    assert found.answer == ((("wedge", "tilt"), 0.95),)
    assert found.claims == ((("wedge",), 0.95),) and found.wrong_and_confident

    # A cause with a free form is a claim and right of what it generalises
    model = {"cause": "depth_map", "probability": 0.97}
    verdict = {"state": "form_free", "answer": [], "effects": [], "model": model}
    tilted = truth_of([[0, 0, 0]] * 2)
    assert judged_from(tilted, verdict, None).found == [True]
    other = tilted | {"effects": [tilted["effects"][0] | {"name": "yaw"}]}
    assert judged_from(other, verdict, None).wrong_and_confident
    for changed in ({"state": "modelled"}, {"model": model | {"probability": 0.6}}, {"model": None}):
        assert judged_from(other, verdict | changed, None).claims == ()


CASES = [
    Judged("null", 0.0, (), "consistent", ()),
    Judged("null", 0.0, (), "inconclusive", ()),
    Judged("null", 0.0, (), "unexplained", ()),  # an alarm
    Judged("null", 0.0, (), "identified", ((("yaw",), 0.95),)),  # an alarm, wrong and confident
    Judged(
        "single", 10.0, ("tilt",), "identified", ((("tilt",), 0.97),), (True, True), 0.9, snr_each=(10.0,)
    ),
    Judged(
        "single", 10.0, ("tilt",), "identified", ((("wedge", "tilt"), 0.92),), (False,), 0.5
    ),  # right group, not first
    Judged("single", 3.0, ("void",), "identified", ((("yaw",), 0.6),)),  # wrong, not confident
    Judged("single", 9.0, ("void",), "failed", ()),
    Judged(
        "pair",
        12.0,
        ("tilt", "yaw"),
        "identified",
        ((("tilt",), 0.9), (("yaw", "tilt"), 0.8)),
        snr_each=(9.0, 8.0),
    ),
    Judged("pair", 12.0, ("tilt", "void"), "identified", ((("tilt",), 0.9),), snr_each=(9.0, 8.5)),
    Judged("pair", 12.0, ("tilt", "void"), "identified", ((("tilt",), 0.9),), snr_each=(12.0, 4.0)),
    Judged("outside", 9.0, ("",), "unexplained", ((("yaw",), 0.95),)),  # a hint
    Judged("outside", 9.0, ("",), "identified", ((("yaw",), 0.95),)),  # wrong and confident
]


@pytest.mark.parametrize(
    ("name", "k", "n"),
    [
        ("failed", 1, 13),
        ("false alarms on nulls", 2, 4),
        ("wrong and confident", 2, 13),
        ("singles, SNR >= 8: group", 2, 3),
        ("singles, SNR >= 8: first", 1, 3),
        ("singles, SNR 2 to 4: group", 0, 1),
        ("pairs: both", 1, 3),
        ("pairs, each SNR >= 8: both", 1, 2),
        ("pairs: one at least", 3, 3),
        ("effects of singles and pairs, SNR >= 8: in a group", 5, 6),
        ("outside: no name", 1, 2),
        ("outside, SNR >= 8: not wrongly named", 1, 2),
        ("inconclusive on nulls", 1, 4),
        ("singles, SNR >= 8: a claim of 0.9 and more", 2, 3),
        ("90 % intervals: cover", 2, 3),
        ("share of the oracle's gain >= 80 %", 1, 2),
    ],
)
def test_scores_of_a_hand_made_set(name, k, n):
    assert scores(CASES)[name] == Rate(k, n)


def truth_of(forces):
    readings = {"session": [0, 0], "press": ["p0", "p0"], "phase": ["load", "load"], "time_s": [1.0, 2.0]}
    effect = {"name": "tilt", "snr": 10.0, "parameters": {"about_x": 0.5}}
    return {
        "case": "c1",
        "content": "single",
        "snr": 9.0,
        "effects": [effect],
        "readings": {**readings, "force_N": forces},
    }


def test_gains_distances_and_intervals_are_measured_against_the_truth():
    # Held out gain is measured against the truth
    truth = truth_of([[0, 0, -1.0], [0, 0, -2.0]])
    rows = pd.DataFrame(
        {"session": "c1_a", "time_s": [1.0, 2.0], "axis": ["z", "z"], "held_out": ["no", "positions"]}
    ).assign(measured_N=[-1.0, -2.1], base_N=[-1.0, -2.5], after_N=[-1.0, -2.3], sigma_N=0.1)
    share, ratio, left = held_out_gain(
        truth, rows
    )  # mean squares 16, 4, 1; the change is 0.5 N and 0.3 N of it are left
    assert (share, ratio, left) == (pytest.approx(12 / 15), pytest.approx(2.0), pytest.approx(0.6))

    # Intervals count where the effect was found
    verdict = {
        "state": "identified", "answer": [{"members": ["tilt"], "probability": 0.99}], "where": [],
        "effects": [{"name": "tilt", "parameters": [{"name": "about_x", "value": 0.48, "interval_90": [0.4, 0.6]}]}],
    }  # fmt: skip
    found = judged_from(truth_of([[0, 0, 0]] * 2), verdict, None)
    assert found.covered == (True,) and found.short == pytest.approx((0.02 * 3.29 / 0.2,))  # 0.5 is true
    verdict["effects"][0]["parameters"][0]["interval_90"] = [0.51, 0.6]
    assert judged_from(truth_of([[0, 0, 0]] * 2), verdict, None).covered == (False,)

    # A claimed defect is as far as it lies from the true one
    truth = truth_of([[0, 0, 0]] * 2)
    truth["effects"] = [
        {"name": "void", "snr": 10.0, "parameters": {}, "where": {"x_mm": 8.0, "y_mm": 9.0, "radius_mm": 1.0}}
    ]
    place = {"x_mm": 5.0, "y_mm": 13.0, "z_mm": -3.0, "radius_mm": 1.2}
    verdict = {
        "state": "identified", "answer": [{"members": ["inclusion", "void"], "probability": 0.99}],
        "effects": [{"name": "void", "hyperparameters": place}, {"name": "yaw", "hyperparameters": {}}],
    }  # fmt: skip
    assert judged_from(truth, verdict, None).distance_mm == pytest.approx(5.0)
    assert np.isnan(judged_from(truth, verdict | {"state": "ambiguous"}, None).distance_mm)
    other = verdict | {"answer": [{"members": ["yaw"], "probability": 0.99}]}
    assert np.isnan(judged_from(truth, other, None).distance_mm)


@pytest.mark.parametrize(
    ("former", "probability", "now"),
    [
        ("null", 0.0, "consistent"),
        ("insufficient", 0.0, "inconclusive"),
        ("open", 0.97, "unexplained"),
        ("named", 0.97, "identified"),
        ("group", 0.93, "identified"),
        ("group", 0.7, "ambiguous"),
        ("form_free", 0.97, "identified"),
        ("modelled", 0.97, "unexplained"),
    ],
)
def test_verdicts_of_the_former_format_are_read_in_the_words_of_this_one(former, probability, now):
    answer = [{"members": ["wedge", "tilt"], "probability": probability}]
    verdict = {"state": former, "answer": answer if probability else [], "effects": []}
    found = judged_from(truth_of([[0, 0, 0]] * 2), verdict, None)
    assert found.state == now and found.found == [now == "identified"]
