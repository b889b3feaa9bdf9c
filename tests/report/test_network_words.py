"""What the report says of the network in words: from its tables alone."""

import pandas as pd
import pytest

from gelforge.report.chapters.network_words import network_words


def tables(own=0.004, ridge=0.016, wall=0.004, sessions=(0.004, 0.004), inside=0.9):
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
    return baselines, by, pd.DataFrame({"quantity": names, "value": [inside] * 6})


LOSS = pd.DataFrame({"epoch": [1, 2], "training": [1.0, 0.1], "validation": [1.0, 0.12]})
OVERFITTED = LOSS.assign(validation=[1.0, 0.5])


@pytest.mark.parametrize(
    ("given", "loss", "words"),
    [
        ({}, LOSS, ["2 mm: 0.03 N", "nine in ten", "help little"]),
        (
            {"wall": 0.02},
            LOSS,
            ["is largest 0 to 6.4 mm from a wall: 20 mN", "More sites 0 to 6.4 mm from a wall"],
        ),
        ({"sessions": (0.004, 0.009)}, LOSS, ["session `day2` is unlike"]),
        ({"inside": 0.7}, LOSS, ["70 % of the bins", "too narrow"]),
        ({"inside": 0.953}, LOSS, ["nine in ten"]),
        ({"inside": 0.99}, LOSS, ["wider than they need"]),
        ({"inside": float("nan")}, LOSS, ["no intervals"]),
        ({}, OVERFITTED, ["More sites would help", "5.0 times"]),
        ({}, None, ["2 mm: 0.03 N"]),
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


def test_the_remedy_is_not_given_twice_where_the_parts_of_the_error_are_known():
    assert "would help" not in network_words(*tables(wall=0.02), OVERFITTED, has_budget=True)


def test_a_poor_network_is_not_told_that_its_sites_are_as_good_as_others():
    assert "help little" not in network_words(*tables(own=0.05), LOSS)
