"""What the report says of the network in words: from its tables alone."""

import pandas as pd
import pytest

from gelforge.report.chapters.network_words import network_words


def tables(own=0.004, ridge=0.016, wall=0.004, sessions=(0.004, 0.004), inside=0.9):
    baselines = pd.DataFrame(
        {"predictor": ["network", "ridge", "training mean", "zero"], "RMSES_z_N": [own, ridge, 0.05, 0.06]}
    )
    rows = [("depth", "1 mm", 0.004, 0.01), ("depth", "2 mm", 0.004, 0.03)]
    rows += [("place", "near a wall (0 to 6.4 mm)", wall, 0.01), ("place", "in the middle", 0.004, 0.01)]
    rows += [("session", name, error, 0.01) for name, error in zip(("day1", "day2"), sessions)]
    by = pd.DataFrame(rows, columns=["by", "class", "RMSES_z_N", "total_Fz_rms_N"])
    names = [
        f"{kind}, {axis}: share inside the 90 % interval" for kind in ("bins", "totals") for axis in "xyz"
    ]
    return baselines, by, pd.DataFrame({"quantity": names, "value": [inside] * 6})


LOSS = pd.DataFrame({"epoch": [1, 2], "training": [1.0, 0.1], "validation": [1.0, 0.12]})
OVERFITTED = LOSS.assign(validation=[1.0, 0.5])


@pytest.mark.parametrize(
    ("given", "loss", "words"),
    [
        (
            {},
            LOSS,
            ["is good", "0.25 times", "ridge, 16 mN", "2 mm: 30 mN", "hold what they say", "help little"],
        ),
        ({"own": 0.016}, LOSS, ["no better than a baseline"]),
        ({"own": 0.03}, LOSS, ["of no use"]),
        ({"wall": 0.02}, LOSS, ["errs most near a wall", "More sites near a wall"]),
        ({"sessions": (0.004, 0.009)}, LOSS, ["session day2 is unlike"]),
        ({"inside": 0.7}, LOSS, ["bins 70 %", "distrust"]),
        ({"inside": 0.953}, LOSS, ["hold what they say"]),
        ({"inside": 0.99}, LOSS, ["they are wide"]),
        ({"inside": float("nan")}, LOSS, ["no intervals"]),
        ({}, OVERFITTED, ["More sites would help", "5.0 times"]),
        ({}, None, ["is good"]),
    ],
)
def test_the_network_in_a_paragraph(given, loss, words):
    said = network_words(*tables(**given), loss)
    for word in words:
        assert word in said, said


def test_without_a_pressed_row_nothing_is_said():
    baselines, by, reliability = tables()
    baselines["RMSES_z_N"] = float("nan")
    assert "nothing can be said" in network_words(baselines, by, reliability, LOSS)


def test_a_loss_of_simulated_sites_says_nothing_of_recordings():
    said = network_words(*tables(), OVERFITTED, only_simulated=True)
    assert "gelforge adapt" in said
    assert "More sites" not in said


def test_a_poor_network_is_not_told_that_its_sites_are_as_good_as_others():
    assert "help little" not in network_words(*tables(own=0.05), LOSS)
