"""What the report says of the network in words: from its tables alone."""

import pandas as pd
import pytest

from gelforge.report.chapters.network_words import network_words


def tables(own=0.004, ridge=0.016, wall=0.004, sessions=(0.004, 0.004), inside=0.9, trained=0.003):
    baselines = pd.DataFrame(
        {"predictor": ["network", "ridge", "training mean", "zero"], "RMSES_z_N": [own, ridge, 0.05, 0.06]}
    )
    rows = [("depth", "1 mm", 0.004, 0.01), ("depth", "2 mm", 0.004, 0.03)]
    rows += [
        ("place", "0 to 6.4 mm from a wall", wall, 0.01),
        ("place", "6.4 mm and more from a wall", 0.004, 0.01),
    ]
    rows += [("session", name, error, 0.01) for name, error in zip(("day1", "day2"), sessions)]
    by = pd.DataFrame(rows, columns=["by", "class", "RMSES_z_N", "total_Fz_rms_N"])
    names = [
        f"{kind}, {axis}: share inside the 90 % interval" for kind in ("bins", "totals") for axis in "xyz"
    ]
    errors = pd.DataFrame({"error": ["RMSES", "RMSES_TRAINING"], "z_N": [0.004, trained]})
    return baselines, by, pd.DataFrame({"quantity": names, "value": [inside] * 6}), errors


def losses(last):
    """Return a loss that is 1, and `last` in the last tenth of a hundred steps."""
    return pd.DataFrame({"step": range(1, 101), "training": [1.0] * 90 + [last] * 10})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, ["2 mm: 0.03 N", "nine in ten", "help little"]),
        ({"wall": 0.02}, ["is largest 0 to 6.4 mm from a wall: 20 mN", "More sites 0 to 6.4 mm from a wall"]),
        ({"sessions": (0.004, 0.009)}, ["session `day2` is unlike"]),
        ({"inside": 0.7}, ["70 % of the bins", "too narrow"]),
        ({"inside": 0.953}, ["nine in ten"]),
        ({"inside": 0.99}, ["wider than they need"]),
        ({"inside": float("nan")}, ["no intervals"]),
        ({"trained": 0.0008}, ["More sites would help", "5.0 times"]),
        ({"trained": 0.0038}, ["1.05 times that on training rows", "Try more steps (learning.steps) first"]),
    ],
)
def test_the_network_in_a_paragraph(given, words):
    said = network_words(*tables(**given), None)
    for word in words:
        assert word in said, said
    assert ("more steps" in said) == (given == {"trained": 0.0038})
    assert not ("more steps" in said and "help little" in said)


@pytest.mark.parametrize(("last", "falls"), [(0.9, True), (0.94, True), (0.96, False), (1.1, False)])
def test_a_loss_that_still_falls_is_told(last, falls):
    said = network_words(*tables(), losses(last))
    assert (f"still falling, by {100 * (1 - last):.0f} %" in said) == falls
    assert ("more steps" in said) == falls


def test_what_is_not_known_or_of_no_use_is_not_said():
    assert "falling" not in network_words(*tables(), losses(0.5).iloc[[49, 99]])

    # Without a pressed row nothing is said
    baselines, *others = tables()
    baselines["RMSES_z_N"] = float("nan")
    assert "nothing can be said" in network_words(baselines, *others, None)

    # The remedy is not given twice where the parts of the error are known
    assert "would help" not in network_words(*tables(wall=0.02, trained=0.0008), None, has_budget=True)

    # A table without training rows says nothing of them
    baselines, by, reliability, errors = tables()
    said = network_words(baselines, by, reliability, errors[errors["error"] == "RMSES"], None)
    assert "training rows" not in said and "2 mm: 0.03 N" in said

    # Of a poor network no report says that its sites are as good as others
    assert "help little" not in network_words(*tables(own=0.05), None)


@pytest.mark.parametrize("trained", [0.0008, 0.004])
def test_errors_on_simulated_rows_say_nothing_of_recordings(trained):
    said = network_words(*tables(trained=trained), None, only_simulated=True)
    assert "gelforge adapt" in said
    assert "More sites" not in said and "more steps" not in said
