"""Two judges side by side on the cases of opened sets."""

import pytest

from validation.again import (
    IN_ANSWER,
    MISSED,
    SURE,
    Both,
    forms_table,
    in_order,
    lost_table,
    reached,
    report,
    strong_table,
)
from validation.pooled import Scored
from validation.score import Judged


def judged(state, *answer):
    return Judged("single", 10.0, ("tilt",), state, answer, snr_each=(10.0,))


CLAIMED = judged("identified", (("wedge", "tilt"), 0.95))
HINT = judged("unexplained", (("tilt",), 0.97))
WRONG = judged("identified", (("yaw",), 0.95))


@pytest.mark.parametrize(
    ("one", "how"),
    [
        (CLAIMED, SURE),
        (judged("identified", (("tilt",), 0.6)), IN_ANSWER),
        (HINT, IN_ANSWER),
        (WRONG, MISSED),
        (judged("failed"), MISSED),
    ],
)
def test_how_far_an_effect_was_told(one, how):
    assert reached(one) == how


def both(case, now, former):
    truth = {"effects": [{"name": "tilt", "form": "turned body", "snr": 10.0}]}
    return Both(truth, Scored("set_again", case, now, 3.0), Scored("set", case, former, 90.0))


def test_both_judges_stand_side_by_side_with_strong_effects_first():
    # Both judges stand next to each other
    cases = [both("c1", CLAIMED, HINT), both("c2", WRONG, CLAIMED)]
    table = strong_table(cases).set_index("one strong effect")
    assert table.loc[SURE, "today"].startswith("1/2") and table.loc[IN_ANSWER, "former judge"].startswith(
        "1/2"
    )
    (row,) = forms_table(cases).to_dict("records")
    assert [row[name] for name in ("cases", SURE, IN_ANSWER, MISSED)] == [2, 1, 0, 1]
    (lost,) = lost_table(cases).to_dict("records")
    assert lost["case"] == "set c2" and lost["today"] == "identified: yaw 0.95"
    assert "90; 90" in report(cases)  # seconds of the former judge

    # Strong effects come first then nulls
    from validation.truths import read_truths

    truths = read_truths()
    order = [truths[name][case] for name, case in in_order(["eighteenth", "nineteenth"])]
    kinds = ["strong" if t["snr"] >= 8 else "null" if t["content"] == "null" else "weak" for t in order]
    assert kinds == ["strong"] * 93 + ["null"] * 11 + ["weak"] * 69
    assert {truth["base"] for truth in order} == {"concealed"}
