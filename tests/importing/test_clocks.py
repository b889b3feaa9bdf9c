"""Clocks of made raw logs are found within 5 ms; what cannot be decided is refused with the key that decides it."""

from dataclasses import replace

import numpy as np
import pytest
from raw_logs import CAMERA, MAPPING, Lab, generate

from gelforge.importing.importer import import_logs
from gelforge.importing.refusals import ImportingError

LAG_S = 0.005  # the number

LAB = Lab(presses=6)
REPEATED = replace(LAB, waits=(1.2, 1.2), rests=(1.0, 1.0), depths=(0.8,))


def imported(folder, lab, mapping=MAPPING, seed=0):
    generate(folder, lab, seed)
    (folder / "mapping.yaml").write_text(mapping)
    return import_logs(folder / "mapping.yaml", "s1")


def with_force(*lines):
    """Return the mapping with more keys of the force log."""
    return MAPPING.replace("  unit: N\n", "  unit: N\n" + "".join(f"  {line}\n" for line in lines))


def lag_at(clock, at_s):
    """Return how much later a clock shows a moment of the stage's clock [s]."""
    return clock.lag_s + clock.law.rate * at_s


@pytest.mark.parametrize(
    ("lab", "keys"),
    [
        (LAB, ()),
        (replace(LAB, stage_hz=13.0, force_hz=97.0, force_lag_s=1.7e9 + 3.3), ()),
        (replace(LAB, presses=8, force_ppm=400.0), ("drift: true",)),
        (replace(LAB, jitter_s=0.002), ("time: {column: Time, unit: s}", "even: true")),
    ],
    ids=["offset", "slow logs, epochs", "drift", "jitter"],
)
def test_force_clock_is_found(tmp_path, lab, keys):
    mapping = MAPPING.replace("  time: {column: Time, unit: s}\n", "", 1 if "even: true" in keys else 0)
    mapping = mapping.replace("  unit: N\n", "  unit: N\n" + "".join(f"  {key}\n" for key in keys))
    found = imported(tmp_path, lab, mapping)
    for at in (0.0, found.stage.time_s[-1]):
        # a 1.7e9 s epoch leaves 0.2 us of a double
        true = lab.force_lag_s + lab.force_ppm * 1e-6 * at
        assert abs(lag_at(found.force_clock, at) - true) < LAG_S


def test_camera_clock_is_found_and_stamps_of_other_frames_are_refused(tmp_path):
    # Camera clock is found
    lab = replace(LAB, fps=27.0)
    found = imported(tmp_path, lab, MAPPING + CAMERA)
    assert abs(found.camera_clock.lag_s - lab.camera_lag_s) < LAG_S

    # Stamps of other frames are refused
    dropped = tmp_path / "dropped"
    lab = replace(LAB, presses=3, fps=20.0)
    generate(dropped, lab)
    stamps = (dropped / "film.csv").read_text().splitlines()
    (dropped / "film.csv").write_text("\n".join(stamps[:-7]) + "\n")
    (dropped / "mapping.yaml").write_text(MAPPING + CAMERA)
    with pytest.raises(ImportingError, match=r"stamps for .* frames of .*: frames were dropped"):
        import_logs(dropped / "mapping.yaml", "s1")


def test_repeating_presses_need_a_rest_at_the_ends(tmp_path):
    lab = replace(
        REPEATED, presses=8, cut_force_s=(7.5, 0.0)
    )  # the log begins between two of the equal presses
    with pytest.raises(ImportingError, match=r"the indentations repeat; set force\.lag_s"):
        imported(tmp_path, lab)
    found = imported(tmp_path, lab, with_force(f"lag_s: {lab.force_lag_s}") + "incomplete: drop\n")
    assert [number for number, _, _ in found.presses.left_out] == [1]
    assert len(found.presses.kept) == 7

    # Repeating presses between rests are not
    found = imported(tmp_path, replace(REPEATED, presses=8))
    assert len(found.presses.kept) == 8
    assert abs(found.force_clock.lag_s - REPEATED.force_lag_s) < LAG_S


CONTRADICTIONS = {
    "drift that is not declared": (
        replace(LAB, presses=8, force_ppm=900.0),
        MAPPING,
        r"ft\.csv: its clock gains .* ms over .* set force\.drift: true",
    ),
    "dropped frames": (
        replace(
            LAB,
            fps=27.0,
            presses=8,
            fault={"frames": lambda times: np.delete(times, np.arange(420, 431))},  # 0.4 s are gone
        ),
        MAPPING + "camera: {video: film.avi, rate_hz: 27}\n",
        r"its lag jumps from .* frames were dropped; name their own time stamps",
    ),
    "logs of two sessions": (
        replace(LAB, fault={"push": lambda t, push, number: 0.5 + 0.5 * np.sin(5 * t)}),
        MAPPING,
        "does not follow the stage",
    ),
    "a wrong sign of the force": (
        LAB,
        MAPPING.replace("acts_on: sensor", "acts_on: indenter"),
        r"session\.force\.acts_on",
    ),
    "a wrong sign of the stage": (
        LAB,
        MAPPING.replace("pressing: -z", "pressing: +z"),
        r"correct stage\.pressing$",
    ),
}


@pytest.mark.parametrize(("lab", "mapping", "said"), CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_logs_that_contradict_each_other_are_refused_with_the_key(tmp_path, lab, mapping, said):
    with pytest.raises(ImportingError, match=said):
        imported(tmp_path, lab, mapping)
