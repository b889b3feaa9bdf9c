"""A few of the random presses of benchmarks/random_presses.py, and that its judge finds what it looks for."""

from dataclasses import replace

import numpy as np
import pytest
import random_presses  # benchmarks/random_presses.py
from random_presses import BALANCE, Draw, Outcome, drawn, is_clear, not_finite, outcome

from gelforge.indentation.cells.cell_file import Cell

SEED = 1
# The wedge under tilt; a ball taken back, with two effects; a box on one layer with a wall; a flat box taken back to where
# rounding kept nodes in and out of contact; a ball with adhesion; a cylinder 2 mm from two edges.
SMALL = (5, 9, 10, 86, 17, 16)


@pytest.mark.thorough(but_first=3)
@pytest.mark.parametrize("number", SMALL)
def test_a_random_press_is_sound(number):
    found = outcome(drawn(SEED, number))
    assert found.status == "converged", found.reason
    assert found.is_sound, (found.not_finite, found.balance)


def test_draws_repeat_differ_and_hold_every_kind():
    first, again, other = drawn(SEED, 3), drawn(SEED, 3), drawn(SEED, 4)
    assert first == again
    assert first.words != other.words

    # Draws hold every kind of indenter sensor path and law
    draws = [draw for draw in (drawn(SEED, number) for number in range(60)) if draw.study]
    assert {d.study.indenter.kind for d in draws} == {"sphere", "cylinder", "box", "several", "mesh"}
    assert {d.study.sensor.shape.kind for d in draws} == {"block", "dome"}
    assert {len(d.study.sensor.layers) for d in draws} == {1, 2, 3}
    assert {phase for d in draws for phase in d.planned.phases} == {"load", "shear", "tilt", "unload"}
    laws = {material.parameters.law for d in draws for material in d.study.materials.values()}
    assert laws == {"neo_hooke", "mooney_rivlin", "yeoh", "gent", "ogden"}
    edge = min(min(d.planned.x_mm, d.study.sensor.width_x_mm - d.planned.x_mm) for d in draws)
    assert edge == pytest.approx(random_presses.EDGE_MM)


GOOD = Outcome(Draw(0, "", None, None), "converged", "", (), 1e-7, 1.0)


@pytest.mark.parametrize(
    ("change", "sound"),
    [
        ({}, True),
        ({"balance": 2 * BALANCE}, False),
        ({"not_finite": ("total_force_N",)}, False),
        ({"status": "error", "reason": "ValueError: 3 is wrong; use 2"}, False),
        ({"status": "failed", "reason": "no equilibrium after 40 iterations"}, True),
        ({"status": "failed", "reason": "no equilibrium"}, False),
        ({"status": "refused", "reason": "depth 4 mm would pierce; press less deep"}, True),
        ({"status": "refused", "reason": "depth 4 mm would pierce"}, False),
    ],
)
def test_what_is_sound(change, sound):
    assert replace(GOOD, **change).is_sound == sound


def test_a_clear_reason_and_anything_not_finite_are_told():
    assert is_clear("shape.kind: block, found dome; leave toe out", with_remedy=True)
    assert not is_clear("leave toe out", with_remedy=True)

    # Anything not finite is found
    arrays = {
        "good": np.zeros(3),
        "words": np.array(["a"]),
        "count": np.array([1]),
        "bad": np.array([0.0, np.inf]),
    }
    assert list(
        not_finite(Cell(arrays, {"seconds": np.nan, "iterations": [3, 4], "status": "converged"}))
    ) == [
        "bad",
        "seconds",
    ]
