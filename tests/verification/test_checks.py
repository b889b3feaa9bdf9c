"""The checks behind the report's verification table, run by the same functions."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import yaml

from gelforge.config.studies.study import Check as CheckName
from gelforge.verification.check import Check, absolute, check_table, relative, vanishing
from gelforge.verification.run import CHECKS

TEST_STUDY = Path(__file__).parents[2] / "config/test.yaml"
IN_TEST_STUDY = yaml.safe_load(TEST_STUDY.read_text())["verification"]  # which ends where one fails
ELSEWHERE = {
    *IN_TEST_STUDY,
    "hertz_presses",
}  # in the study a ball presses bonded layers, down to a third of them


def once(name):
    """Return the case of a check; one that runs elsewhere too is run here before a release only."""
    return pytest.param(name, marks=[pytest.mark.thorough] if name in ELSEWHERE else [])


@pytest.mark.parametrize("name", map(once, CHECKS))
def test_check(name):
    """Each function argues its own limits."""
    for check in CHECKS[name]():
        assert check.passed, check


def test_a_study_can_ask_for_every_check_and_a_check_fails_beyond_its_limit():
    # A study can ask for every check
    assert get_args(CheckName) == tuple(CHECKS)

    # A check fails beyond its limit and has its row
    assert relative("F", "Hertz", 2.0, 2.03, 0.02).passed
    assert not relative("F", "Hertz", 2.0, 2.05, 0.02).passed
    assert absolute("n", "six", 6, 6, 0).passed
    assert not absolute("n", "six", 6, 7, 0).passed
    assert not vanishing("R", "zero", -1e-3, 1e-4).passed
    assert not Check("F", "Hertz", 1.0, np.nan, np.nan, 0.02).passed

    # Table has a row per check
    table = check_table([relative("F", "Hertz", 2.0, 2.05, 0.02), vanishing("R", "zero", 1e-9, 1e-6)])
    assert list(table.columns) == ["quantity", "source", "reference", "found", "error", "limit", "passed"]
    assert list(table["passed"]) == [False, True]
    assert table["error"][0] == pytest.approx(0.025)
