"""Recordings that cannot be true are found, and honest ones that resemble them pass without any finding."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from generated_sessions import FORCE, Kind, generate
from numpy.testing import assert_allclose

from gelforge.config import Sensor
from gelforge.dataset.agreement import _measured
from gelforge.mismatch.readings.sessions import observe
from gelforge.recording.features import sample_rows
from gelforge.recording.readings import read_readings, read_recording, write_readings
from gelforge.recording.tables.checks import RecordingError

SENSOR = Sensor.model_validate({"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "m"}]})
NO_OFFSET = {"offset_N": (0.0, 0.0, 0.0), "drift_N_per_s": 0.0}

HONEST = {
    "as usual": {},
    "fast log": {"log_s": 0.005},
    "slow log": {"log_s": 0.2},
    "log of 1 Hz": {"log_s": 1.0, "dwells": (0.5, 1.5, 2.5)},
    "log with a jittery clock": {"log_s": 0.01, "log_jitter": 0.9},
    "relaxes during the wait": {"relaxes": 0.8, "relaxes_s": 0.3, "log_s": 0.02, "dwells": (0.5, 1, 2, 4)},
    "relaxes at once": {"relaxes": 0.8, "relaxes_s": 0.05, "log_s": 0.005},
    "softens by 40 %": {"softens": 0.4},
    "hysteresis on the way up": {"unload_share": 0.3},
    "adhesion, pull-off": {"pull_off_N": 0.1, "log_s": 0.02},
    "pull-off as large as the force": {"pull_off_N": 0.4},
    "a step of 60 mN": {"resolution_N": 0.06, "noise_N": 0.001},
    "steps and noise": {"resolution_N": 0.03, "noise_N": 0.02, **NO_OFFSET},
    "noise below the step": {"resolution_N": 0.01, "noise_N": 0.0005, **NO_OFFSET},
    "central: 0.00 sideways": {
        **{"sites": [(16, 16)], "repeats": 3, "noise_N": 0.0002, "resolution_N": 0.01},
        **NO_OFFSET,
    },
    "depth zero below the surface": {"offset_mm": 0.1},
    "depth zero above the surface": {"offset_mm": -0.08, "touch_mm": 0.02},
    "seven shallow, one deep": {"sites": [(16, 16)], "depths": (0.5,) * 7 + (3.0,), "repeats": 1},
    "left-handed stage": {"handedness": "left"},
    "left-handed stage and force": {
        "handedness": "left",
        "fault": {"force": {"axes": [[1, 0, 0], [0, -1, 0], [0, 0, 1]]}},
    },
    "upside down: lateral axes of determinant -1, a rotation": {
        "acts_on": "sensor",
        "fault": {
            "force": {"axes": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]},
            "table": lambda table, rng: table.assign(fy_N=-table["fy_N"], fz_N=-table["fz_N"]),
        },
    },
    "heavy tails": {"tails": True, "noise_N": 0.006},
    "tared": {"tared": True, "drift_N_per_s": 0.0},
    "tared, heavy tails": {"tared": True, "drift_N_per_s": 0.0, "tails": True, "noise_N": 0.006},
    "drift, not tared": {"drift_N_per_s": 5e-4},
    "one indentation": {"sites": [(16, 16)], "depths": (1.0,)},
    "one depth": {"depths": (1.0,)},
    "no load row": {"load_row": False, "dwells": (1.0,)},
    "stiff": {"stiffness": 10.0, "exponent": 2.2},
    "soft": {"stiffness": 0.02},
    "sites unlike each other": {"site_spread": 0.6},
    "eight depths": {"depths": tuple(np.linspace(0.25, 2, 8))},
    "sideways force": {"lateral": 0.8},
    "fast stage": {"speed": 5.0, "log_s": 0.02},
    "slow stage": {"speed": 0.2, "log_s": 0.01},
    "many readings of a gel that sticks, peaks and recovers": {
        **{"relaxes": 0.8, "relaxes_s": 0.1, "pull_off_N": 0.1, "lateral": 0.8, "unload_share": 0.4},
        **{"unload_rows": (0.9, 0.7, 0.5, 0.3, 0.1), "dwells": (0.2, 0.4, 0.8, 1.6)},
    },
    "no reading during unloading": {"unload_rows": ()},
}


# ------------------------------------------------------------------------------------------ honest sessions
@pytest.mark.parametrize("name", HONEST)
def test_honest_sessions_pass(tmp_path, name):
    assert_nothing_found(generate(tmp_path / "s", Kind(**HONEST[name])))


@pytest.mark.thorough(but_first=1)  # each trait by itself is above
@pytest.mark.parametrize("seed", range(8))
def test_honest_sessions_of_any_mixture_pass(tmp_path, seed):
    rng = np.random.default_rng([seed, 1])
    pick = rng.choice
    kind = Kind(
        stiffness=float(np.exp(rng.uniform(np.log(0.05), np.log(5)))),
        exponent=float(rng.uniform(1.0, 2.2)),
        relaxes=float(pick([0.0, 0.3, 0.7])),
        relaxes_s=float(pick([0.1, 1.0, 10.0])),
        softens=float(pick([0.0, 0.3])),
        unload_share=float(pick([1.0, 0.4])),
        pull_off_N=float(pick([0.0, 0.05])),
        noise_N=float(pick([0.0005, 0.004])),
        tails=bool(pick([False, True])),
        resolution_N=float(pick([0.001, 0.01])),
        drift_N_per_s=float(pick([0.0, 1e-4])),
        offset_mm=float(rng.uniform(-0.05, 0.1)),
        speed=float(pick([0.5, 1.0, 4.0])),
        log_s=pick([None, 0.005, 0.05]),
        acts_on=str(pick(["sensor", "indenter"])),
    )
    assert_nothing_found(generate(tmp_path / "s", kind, seed))


def assert_nothing_found(folder):
    recording = read_recording(folder)
    assert recording.findings.lines() == []
    assert recording.readings[FORCE].notna().all(axis=None)
    assert (recording.readings["excluded"] == "").all()


# --------------------------------------------------------------------------------- sessions that are refused
def shifted(rows):
    return lambda table, rng: table.assign(**{name: np.roll(table[name], rows) for name in FORCE})


def from_press(first, last, value, names=FORCE, noise_N=0.0):
    """Return an edit: from indentation first to last (whole numbers) the axes show one value, None: the one there."""

    def edit(table, rng):
        table = table.copy()
        rows = table["order"].between(first, last)
        for name in names:
            shown = table.loc[rows, name].iloc[0] if value is None else value
            table.loc[rows, name] = (shown + noise_N * rng.normal(size=rows.sum())).round(3)
        return table

    return edit


def without(log, first_s, last_s):
    return log[(log["time_s"] < first_s) | (log["time_s"] > last_s)]


REFUSED = {
    "lag of 0.3 s": (
        {"log_s": 0.02, "fault": {"lag_s": 0.3}},
        r"ft\.csv lags the depth by 0\.\d+ s .*delay_s: 0\.[23]",
    ),
    "lag of 1 s": ({"log_s": 0.02, "fault": {"lag_s": 1.0}}, r"lags the depth by (0\.9|1\.0)\d s"),
    "lag of 5 s": ({"log_s": 0.02, "fault": {"lag_s": 5.0}}, r"lags the depth by (4\.9|5\.0)\d s"),
    "lag, relaxing": (
        {"log_s": 0.02, "relaxes": 0.7, "fault": {"lag_s": 1.0}},
        r"lags the depth by (0\.9|1\.0)\d s",
    ),
    "lead of 1.5 s": ({"log_s": 0.02, "fault": {"lag_s": -1.5}}, r"leads the depth by 1\.[45]\d s"),
    "a row late": ({"fault": {"table": shifted(1)}}, r"force lags the depth by 1 row\(s\)"),
    "a row early": (
        {"fault": {"table": shifted(-1)}, "relaxes": 0.7},
        r"force leads the depth by 1 row\(s\)",
    ),
    "an indentation late": ({"fault": {"table": shifted(8)}}, r"force lags the depth by 8 row\(s\)"),
    "dead from the start": ({"fault": {"table": from_press(0, 99, 0.0)}}, r"does not respond to indentation"),
    "noise alone": (
        {"fault": {"table": from_press(0, 99, 0.0, noise_N=0.002)}},
        r"does not respond to indentation: .* on average",
    ),
    "dead for most of it": (
        {"fault": {"table": from_press(3, 99, 0.0)}},
        r"repeats one value to the last digit from indentation p003 on .*12 indentations in all",
    ),
    "tared once, drifts": (
        {"tared": True, "drift_N_per_s": 5e-4},
        r"in the zero rows of a tared session.*set force\.tared: false",
    ),
    "mirrored axes": (
        {"fault": {"force": {"axes": [[1, 0, 0], [0, -1, 0], [0, 0, 1]]}}},
        r"mirror \(determinant -1.*stage_to_sensor\.handedness: left",
    ),
    "all signs turned by the axes": (
        {"acts_on": "indenter", "fault": {"force": {"axes": (-np.eye(3)).tolist(), "acts_on": "sensor"}}},
        r"mirror \(determinant -1.*force\.acts_on",
    ),
    "z turned alone": (
        {"acts_on": "indenter", "fault": {"force": {"axes": np.diag([1.0, 1, -1]).tolist()}}},
        r"mirror \(determinant -1.*one lateral axis reversed",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_true_is_refused_in_one_line(tmp_path, name):
    traits, message = REFUSED[name]
    folder = generate(tmp_path / "s", Kind(**traits))
    with pytest.raises(RecordingError, match=message) as refused:
        read_recording(folder)
    assert "\n" not in str(refused.value)
    assert "confirmed: [" in str(refused.value)


def test_the_delay_that_a_refusal_names_mends_the_lag(tmp_path):
    kind = Kind(log_s=0.02, fault={"lag_s": 5.0})
    with pytest.raises(RecordingError, match=r"delay_s: (\S+) in") as refused:
        read_recording(generate(tmp_path / "lag", kind))
    delay = float(str(refused.value).split("delay_s: ")[1].split()[0])
    mended = replace(kind, fault={"lag_s": 5.0, "force": {"delay_s": delay}})
    honest = replace(kind, fault={})
    found, wanted = (
        read_recording(generate(tmp_path / name, one)).readings
        for name, one in (("mended", mended), ("true", honest))
    )
    still = (found["phase"] != "unload").to_numpy()
    assert_allclose(
        found.loc[still, FORCE], wanted.loc[still, FORCE], atol=0.05
    )  # 0.04 s at 1 mm/s of 0.6 N/mm


@pytest.mark.parametrize("log_s", [0.005, 0.02])
@pytest.mark.parametrize("lag", [0.4312, -1.2345])
@pytest.mark.parametrize("traits", [{}, {"relaxes": 0.7}, {"speed": 4.0}], ids=str)
def test_the_delay_that_a_refusal_names_is_right_to_a_sample(tmp_path, log_s, lag, traits):
    folder = generate(tmp_path / "s", Kind(log_s=log_s, fault={"lag_s": lag}, **traits))
    with pytest.raises(RecordingError, match=r"delay_s: (\S+) in") as refused:
        read_recording(folder)
    assert abs(float(str(refused.value).split("delay_s: ")[1].split()[0]) - lag) <= log_s


def test_a_confirmed_finding_is_a_note_and_untouched_samples_stay(tmp_path):
    # A confirmed finding is a note
    kind = Kind(tared=True, drift_N_per_s=5e-4, fault={"session": {"confirmed": ["force_before_touch"]}})
    recording = read_recording(generate(tmp_path / "s", kind))
    assert [finding.level for finding in recording.findings] == ["note"]
    assert "confirmed in session.yaml" in recording.findings.lines("note")[0]

    # Untouched samples stay
    untouched = tmp_path / "untouched"
    kind = Kind(fault={"table": from_press(12, 99, 0.0)})
    recording = read_recording(generate(untouched / "s", kind))
    assert set(sample_rows(recording)["press"]) == {f"p{k:03d}" for k in range(15)}


# ------------------------------------------------------------------------------------------- exclusions
def weak(table, rng):
    """Take 95 % of the force from an indentation to the deepest depth."""
    table = table.copy()
    press = table.loc[table["depth_mm"].idxmax(), "press"]
    own = table["press"] == press
    zero = table.loc[own & (table["phase"] == "zero"), FORCE].mean()
    held = own & (table["phase"] != "zero")
    table.loc[held, FORCE] = (zero + 0.05 * (table.loc[held, FORCE] - zero)).round(3)
    return table


def silent(table, rng):
    """Take all force from an indentation to the deepest depth; noise stays."""
    table = table.copy()
    press = table.loc[table["depth_mm"].idxmax(), "press"]
    own = table["press"] == press
    zero = table.loc[own & (table["phase"] == "zero"), FORCE].mean()
    table.loc[own, FORCE] = (zero.to_numpy() + 0.002 * rng.normal(size=(own.sum(), 3))).round(3)
    return table


def touches_early(table, rng):
    table = table.copy()
    own = table["press"] == "p003"
    zero = table.index[own & (table["phase"] == "zero")][-1]
    table.loc[zero, FORCE] = table.loc[own & (table["phase"] == "load"), FORCE].iloc[0]
    return table


def lost_digits(phase, name="fz_N", which=-1):
    """Return an edit: one reading of p004 is a thousandth of what it was before the force's zero is subtracted."""

    def edit(table, rng):
        table = table.copy()
        row = table.index[(table["press"] == "p004") & (table["phase"] == phase)][which]
        table.loc[row, name] /= 1000
        return table

    return edit


EXCLUDED = {
    "lost digits on the way up": (
        {"offset_N": (0.02, -0.01, 0.3), "acts_on": "sensor", "fault": {"table": lost_digits("unload")}},
        {"p004"},
        r"p004 .*force is -0\.3\d* N \(fz\) in phase unload at 0\.\d+ mm, outside the .* and 0 N before and after it",
    ),
    "lost digits in the wait": (
        {
            "offset_N": (0.02, -0.01, 0.3),
            "acts_on": "sensor",
            "fault": {"table": lost_digits("dwell", which=1)},
        },
        {"p004"},
        r"force is -0\.3\d* N \(fz\) in phase dwell",
    ),
    "lost digits sideways, below heavy tails, alone in the session": (
        {
            "offset_N": (0.02, -0.027, 0.3),
            "stiffness": 0.05,
            "fault": {"table": lost_digits("dwell", "fy_N", 1)},
        },
        {"p004"},
        r"force is -?0\.02\d* N \(fy\) in phase dwell",
    ),
    "gap": (
        {"log_s": 0.02, "fault": {"log": lambda log, rng: without(log, 1.5, 6)}},
        {"p000"},
        r"indentation p000 at 2\.\d+ s: force has no sample in ft\.csv for 4\.5\d* s",
    ),
    "gap of all zero rows": (
        {"log_s": 0.02, "fault": {"log": lambda log, rng: without(log, 0.01, 0.8)}},
        {"p000"},
        r"force has no sample in ft\.csv for 0\.8\d* s",
    ),
    "frozen for a while": (
        {"fault": {"table": from_press(4, 8, None)}},
        {"p004", "p005", "p006", "p007", "p008"},
        r"repeats one value to the last digit from indentation p004 on \(.*fz = .*5 indentations in all",
    ),
    "frozen to the end": (
        {"fault": {"table": from_press(12, 99, 0.0)}},
        {"p012", "p013", "p014"},
        r"from indentation p012 on \(.*fz = 0 N\)",
    ),
    "dead, steps of 60 mN": (
        {"resolution_N": 0.06, "noise_N": 0.01, "fault": {"table": from_press(10, 99, 0.0)}},
        {"p010", "p011", "p012", "p013", "p014"},
        r"repeats one value to the last digit",
    ),
    "a lateral axis freezes": (
        {"noise_N": 0.006, "fault": {"table": from_press(10, 99, None, ["fx_N"])}},
        {"p010", "p011", "p012", "p013", "p014"},
        r"repeats one value to the last digit from indentation p010 on \(fx = ",
    ),
    "does not grow": ({"fault": {"table": weak}}, None, r"does not grow with depth: .* of the same site"),
    "no answer": ({"fault": {"table": silent}}, None, r"is -?0\.00\d* N at 1\.2 mm, where 0\.\d+ N is usual"),
    "touches among its zero rows": (
        {"fault": {"table": touches_early}},
        {"p003"},
        r"force changes by .* N .* before contact",
    ),
}


@pytest.mark.parametrize("name", EXCLUDED)
def test_what_cannot_be_true_is_left_out_and_listed(tmp_path, name):
    traits, presses, message = EXCLUDED[name]
    folder = generate(tmp_path / "s", Kind(**traits))
    recording = read_recording(folder)
    if presses is None:
        table = pd.read_csv(folder / "indentations.csv")
        presses = {table.loc[table["depth_mm"].idxmax(), "press"]}
    lost = recording.readings["fz_N"].isna()
    assert set(recording.readings.loc[lost, "press"]) == presses
    assert (lost == (recording.readings["excluded"] != "")).all()
    excluded = recording.findings.of("excluded")
    assert {finding.press for finding in excluded} == presses
    assert any(re.search(message, line) for line in recording.findings.lines("excluded")), (
        recording.findings.lines("excluded")
    )
    for finding in excluded:
        assert np.isfinite(finding.value) and np.isfinite(finding.time_s) and finding.remedy
    # the same rows stay out of what follows
    write_readings(tmp_path / "s.csv", recording)
    assert read_readings(tmp_path / "s.csv")["fz_N"].isna().sum() == lost.sum()
    measured = _measured("s", tmp_path / "s.csv")
    assert measured[["ft_x_N", "ft_y_N", "ft_z_N"]].notna().all(axis=None)
    observed = observe([folder], SENSOR)
    assert np.isfinite(observed.force[:, 2]).all()  # an axis that never changes is left out by itself
    assert any(re.search(message, said) for said in observed.cannot_know)
    whole = lost.groupby(recording.readings["press"]).all()
    assert not set(whole.index[whole]) & set(measured["press"])
    assert not {f"s/{press}" for press in whole.index[whole]} & set(observed.table["press"])


def test_a_gap_takes_its_readings_and_gaps_in_most_indentations_are_refused(tmp_path):
    # A gap takes only the readings inside
    fault = {"log": lambda log, rng: without(log, 1.5, 2.6)}  # p000 arrives at 2.4 mm or later
    kind = Kind(log_s=0.02, depths=(0.4,), fault=fault)
    readings = read_recording(generate(tmp_path / "s", kind)).readings
    lost = readings[readings["fz_N"].isna()]
    assert list(lost["phase"]) == ["load"]
    honest = read_recording(generate(tmp_path / "true", replace(kind, fault={}))).readings
    kept = readings["fz_N"].notna()
    assert_allclose(readings.loc[kept, FORCE], honest.loc[kept, FORCE], atol=1e-12)

    # Gaps in most indentations are an error that can be confirmed
    many = tmp_path / "many"

    def holes(log, rng):
        """The waits of all indentations but the last are missing."""
        return log[
            (log["time_s"] % kind.press_s < 2.0) | (log["time_s"] > log["time_s"].max() - kind.press_s)
        ]

    kind = Kind(log_s=0.02)
    kind = replace(kind, fault={"log": holes})
    folder = generate(many / "s", kind)
    with pytest.raises(
        RecordingError, match=r"no sample in ft\.csv .* indentations in all.*confirmed: \[gap\]"
    ):
        read_recording(folder)
