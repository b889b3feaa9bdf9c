"""A force channel that saturates at the largest signal is found, whatever depths reach it; equal honest readings pass."""

import numpy as np
import pytest
from generated_sessions import FORCE, Kind, generate

from gelforge.recording.readings import read_recording
from gelforge.recording.tables.checks import RecordingError

MANY = [(x, y) for x in (10, 16, 22) for y in (10, 16, 22)]


def clipped(limit_N, axes=FORCE):
    """Return a fault that clips the readings of some axes at +-limit_N, as an amplifier does."""
    return {
        "table": lambda table, rng: table.assign(
            **{name: table[name].clip(-limit_N, limit_N) for name in axes}
        )
    }


def largest(folder):
    """Return the largest force towards the gel of a session, without its fault."""
    return float(-read_recording(folder).readings["fz_N"].min())


@pytest.mark.parametrize("acts_on", ["indenter", "sensor"])
@pytest.mark.parametrize(
    "traits",
    [
        {},
        {"relaxes": 0.3},
        {"dwells": (0.5,), "repeats": 2},  # no neighbours at depth: the sites tell
        {"site_spread": 0.4},
    ],
)
def test_the_deepest_readings_at_one_value_are_left_out(tmp_path, traits, acts_on):
    kind = {"sites": MANY, "acts_on": acts_on, "offset_N": (0.0, 0.0, 0.0), **traits}
    limit = round(0.75 * largest(generate(tmp_path / "whole", Kind(**kind))), 3)
    recording = read_recording(generate(tmp_path / "s", Kind(**kind, fault=clipped(limit, ["fz_N"]))))
    found = [f for f in recording.findings if f.test == "force_saturates"]
    assert found and all(f.value == pytest.approx(limit) and f.press and f.remedy for f in found)
    table = recording.readings
    reached = table["fz_raw_N"].abs() >= limit - 1e-9
    assert reached.any() and table.loc[reached & (table["phase"] != "unload"), "fz_N"].isna().all()
    shallow = table["depth_mm"] < 0.9 * table["depth_mm"].max()
    assert table.loc[shallow, "fz_N"].notna().all()


def test_a_session_saturated_for_the_most_part_is_refused_and_a_saturated_log_is_found(tmp_path):
    # A session that is saturated for the most part is refused. One depth only: the noise tells
    kind = {"sites": MANY, "offset_N": (0.0, 0.0, 0.0), "depths": (1.0,), "repeats": 2}
    limit = round(0.75 * largest(generate(tmp_path / "whole", Kind(**kind))), 3)
    with pytest.raises(
        RecordingError, match=r"p0.*\(fz\) stays at .* saturated sensor.*larger range.*force_saturates"
    ):
        read_recording(generate(tmp_path / "s", Kind(**kind, fault=clipped(limit, ["fz_N"]))))

    # A saturated log is found too
    logged = tmp_path / "logged"
    kind = {"sites": MANY, "log_s": 0.01, "offset_N": (0.0, 0.0, 0.0)}
    limit = round(0.75 * largest(generate(logged / "whole", Kind(**kind))), 3)
    fault = {"log": lambda log, rng: log.assign(fz_N=log["fz_N"].clip(-limit, limit))}
    recording = read_recording(generate(logged / "s", Kind(**kind, fault=fault)))
    assert {f.test for f in recording.findings} == {"force_saturates"}


@pytest.mark.parametrize("sites", [MANY[:1], MANY])
def test_a_force_that_stops_below_proportion_to_depth_is_left_out(tmp_path, sites):
    """Whatever the channel rounds: two depths of one site are enough."""
    kind = {"sites": sites, "offset_N": (0.0, 0.0, 0.0), "resolution_N": 0.02, "noise_N": 0.002}
    limit = round(0.35 * largest(generate(tmp_path / "whole", Kind(**kind))) / 0.02) * 0.02
    with pytest.raises(RecordingError, match=r"\(fz\) stays at .* saturated sensor"):
        read_recording(generate(tmp_path / "s", Kind(**kind, fault=clipped(limit, ["fz_N"]))))


@pytest.mark.parametrize(
    "traits",
    [
        {
            "exponent": 0.5,
            "resolution_N": 0.02,
            "noise_N": 0.002,
            "site_spread": 0.05,
        },  # levels off by itself
        {"noise_N": 0.0, "site_spread": 0.0, "touch_mm": 0.0, "lateral": 0.0},  # all equal, at every depth
        {"noise_N": 0.0, "site_spread": 0.0, "touch_mm": 0.0, "depths": (1.0,), "repeats": 2},
        {"resolution_N": 0.05, "noise_N": 0.004},
        {"resolution_N": 0.05, "noise_N": 0.03, "repeats": 3},
        {"resolution_N": 0.02, "noise_N": 0.002, "touch_mm": 0.0, "site_spread": 0.02, "drift_N_per_s": 0.0},
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_equal_readings_of_an_honest_channel_pass(tmp_path, traits, seed):
    recording = read_recording(generate(tmp_path / "s", Kind(sites=MANY, **traits), seed))
    assert not [f for f in recording.findings if f.test == "force_saturates"]
    assert np.isfinite(recording.readings[FORCE].to_numpy()).all()
