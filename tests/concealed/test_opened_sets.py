"""Two judges beside each other on the cases of an opened set."""

import pytest

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")

from opened_sets import (
    IN_ANSWER,
    MISSED,
    SURE,
    Case,
    Judged,
    forms_table,
    lost_table,
    reached,
    strong_table,
)


def judged(state, *answer):
    return Judged("single", 10.0, ("tilt",), state, answer, snr_each=(10.0,))


CLAIMED = judged("identified", (("wedge", "tilt"), 0.95))
HINT = judged("modelled", (("tilt",), 0.97))
WRONG = judged("identified", (("yaw",), 0.95))


@pytest.mark.parametrize(
    ("one", "how"),
    [
        (CLAIMED, SURE),
        (judged("form_free", (("tilt",), 0.6)), IN_ANSWER),
        (HINT, IN_ANSWER),
        (WRONG, MISSED),
        (judged("failed"), MISSED),
    ],
)
def test_how_far_an_effect_was_told(one, how):
    assert reached(one) == how


def test_both_judges_stand_beside_each_other():
    truth = {"effects": [{"name": "tilt", "form": "turned body", "snr": 10.0}]}
    cases = [Case("set c1", truth, CLAIMED, HINT, 3.0), Case("set c2", truth, WRONG, CLAIMED, 4.0)]
    table = strong_table(cases).set_index("strong single effects")
    assert table.loc[SURE, "now"].startswith("1/2") and table.loc[IN_ANSWER, "former"].startswith("1/2")
    (row,) = forms_table(cases).to_dict("records")
    assert (row["cases"], row["claimed"], row["in the answer"], row["former judge"]) == (2, 1, 1, 1)
    assert list(lost_table(cases)["case"]) == ["set c2"]
