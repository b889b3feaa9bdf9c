"""One zero row per press: all of them together show the noise and the drift of the force sensor's zero."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from artificial_readings import grid, readings

from gelforge.config import ForceSensor, Sensor
from gelforge.mismatch.evidence.covariance import readings_covariance
from gelforge.mismatch.inference.scan import global_test
from gelforge.mismatch.readings.errors import LEAST_FREEDOM, reading_noise, zeros_together
from gelforge.mismatch.readings.observations import Observations
from gelforge.mismatch.readings.sessions import observe
from gelforge.recording.readings import FORCE, RAW

SIGMA, APART_S = 0.005, 20.0
SENSOR = Sensor(
    width_x_mm=30, width_y_mm=30, layers=[{"name": "g", "thickness_mm": 6, "material": "m"}], wall_mm=0
)


def recording(
    rng, presses=60, zeros=1, trend=0.0, wander=0.0, tails=False, tared=False, step=1e-4, stated=SIGMA
):
    """Return a recording of presses on nothing: zero rows, then two loads of no force, 4 and 8 s later."""
    at = [0.1 * k for k in range(zeros)] + [4.0, 8.0]
    time = (APART_S * np.arange(presses)[:, None] + at).ravel()
    walk = np.cumsum(rng.normal(size=(len(time), 3)) * np.sqrt(np.r_[0, np.diff(time)])[:, None], axis=0)
    size = (len(time), 3)
    noise = rng.standard_t(5, size) * np.sqrt(3 / 5) if tails else rng.normal(size=size)
    raw = 0.3 + trend * time[:, None] + wander * walk + SIGMA * noise
    raw = np.rint(raw / step) * step
    press = np.repeat([f"p{k:03d}" for k in range(presses)], len(at))
    table = pd.DataFrame(
        {"press": press, "phase": np.tile(["zero"] * zeros + ["load"] * 2, presses), "time_s": time}
    )
    table = table.assign(depth_mm=np.tile([-1.0] * zeros + [0.5, 1.0], presses), x_mm=10.0, y_mm=12.0)
    table[RAW] = raw
    mean = table[table["phase"] == "zero"].groupby("press")[RAW].mean().loc[press].to_numpy()
    table[FORCE] = raw if tared else raw - mean
    force = ForceSensor(resolution_N=[step] * 3, tared=tared, repeatability_N=stated)
    return SimpleNamespace(readings=table, session=SimpleNamespace(session="s", force=force))


@pytest.mark.parametrize(
    ("drift", "presses"), [({}, 60), ({"trend": 2e-5}, 60), ({"trend": 2e-5, "wander": 5e-4}, 150)]
)
def test_zero_rows_of_all_presses_show_noise_and_drift(drift, presses):
    """40 to 130 degrees of freedom know a standard deviation to 11 and 6 %; three axes of four recordings are taken."""
    found = [zeros_together(recording(np.random.default_rng(k), presses, **drift)) for k in range(4)]
    variance = np.mean([one.repeats.scatter**2 for one in found])
    assert np.sqrt(variance) == pytest.approx(SIGMA, rel=0.1)
    assert all(25 < one.repeats.freedom < presses for one in found)
    assert np.mean([one.wander for one in found]) == pytest.approx(drift.get("wander", 0.0), abs=2e-4)
    walked = drift.get("wander", 0.0) / np.sqrt(APART_S * presses)  # a walk has a slope of its own
    trend = drift.get("trend", 0.0)
    assert trend - 1e-5 - 2 * walked < np.mean([one.trend for one in found]) < trend + 1e-5 + 3 * walked


def test_estimates_have_their_degrees_of_freedom_and_few_zeros_keep_the_stated_noise():
    # The degrees of freedom are those of the estimate. A variance known with f degrees of freedom scatters by
    # sqrt(2 / f) of itself; 300 of them know it to 8 %
    found = [zeros_together(recording(np.random.default_rng(k), 40, wander=2e-4)) for k in range(100)]
    variance = np.array([one.repeats.scatter**2 for one in found]) / SIGMA**2
    freedom = np.mean([one.repeats.freedom for one in found])
    assert variance.mean() == pytest.approx(1.0, abs=0.05)
    assert 2 / variance.var() == pytest.approx(freedom, rel=0.35)

    # Heavy tails are seen in them. A squared draw of Student's t with 5 varies four times as much as a normal
    # one's; the fourth moment comes slowly
    for tails, low, high in ((False, 1.0, 1.3), (True, 1.5, 9.0)):
        one = recording(np.random.default_rng(5), 800, tails=tails)
        noise, rounding, (freedom, found), said = reading_noise(one, zeros_together(one).repeats)
        assert noise == pytest.approx([SIGMA] * 3, rel=0.12) and not rounding.any()
        assert low <= found <= high and freedom > 400
        assert len(said) == 1 and "all indentations together" in said[0]

    # Few own or constant zero rows leave the noise to what is stated
    for zeros, together in ((1, True), (2, False), (3, False)):
        assert (zeros_together(recording(np.random.default_rng(0), zeros=zeros)) is not None) == together
    assert zeros_together(recording(np.random.default_rng(0), presses=LEAST_FREEDOM - 1)) is None

    # Few zero rows leave the noise to what is stated
    one = recording(np.random.default_rng(0), presses=11, wander=0.01, stated=0.05)
    noise, _, (freedom, _), said = reading_noise(one, zeros_together(one).repeats)
    assert (noise == 0.05).all() and freedom == np.inf and "stated repeatability" in said[0]

    # A force sensor that never changes has no noise of its own
    one = recording(np.random.default_rng(0), step=1.0)
    noise, rounding, _, _ = reading_noise(one, zeros_together(one).repeats)
    assert noise == pytest.approx([0.1] * 3) and rounding == pytest.approx([1 / np.sqrt(12)] * 3)


# ------------------------------------------------------------------------------------------------- in the covariance
def chances(drift, allow: bool, number=80, presses=40) -> np.ndarray:
    """Return the p of nulls whose zero drifts, by the noise and the drift that each shows itself (or by none of it)."""
    found = readings(grid(1))
    p = []
    for k in range(number):
        one = recording(np.random.default_rng([9, k]), presses, **drift)
        together = zeros_together(one)
        noise, _, (repeats, tails), _ = reading_noise(one, together.repeats)
        walk, trend = together.drift(one.readings)
        table, loads = one.readings, (one.readings["phase"] == "load").to_numpy()
        R = int(loads.sum())
        seen = Observations(
            table[loads].assign(session="s", site=0, deepest_mm=1.0).reset_index(drop=True),
            table.loc[loads, FORCE].to_numpy(),
            found.observations.sites,
            np.broadcast_to(noise, (R, 3)),
            np.broadcast_to(noise, (R, 3)),
            np.zeros(R),
            np.zeros(R),
            drift_N=allow * walk[loads],
            trend_N=allow * trend[loads],
            repeats=repeats,
            tails=tails,
        )
        context = SimpleNamespace(
            observations=seen, force=np.zeros((R, 3)), slope=lambda R=R: np.zeros((R, 3))
        )
        covariance = readings_covariance(context, np.zeros((R, 3, 0)), np.zeros((R, 3)))
        p.append(global_test(seen.flat(seen.force), covariance).p)
    return np.array(p)


@pytest.mark.thorough(but_first=1)
@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("drift", [{"trend": 2e-3, "wander": 1e-3}, {}, {"wander": 4e-4}])
def test_nulls_with_one_zero_row_each_are_calibrated(drift):
    """80 nulls: at most 4 below 0.01 by a chance of 0.999."""
    p = chances(drift, allow=True)
    assert (p < 0.01).sum() <= 4 and np.mean(p < 0.05) < 0.13 and 0.3 < np.median(p) < 0.75


def test_a_drift_that_is_not_allowed_for_is_an_alarm():
    assert np.mean(chances({"trend": 2e-3, "wander": 1e-3}, allow=False, number=20) < 0.01) > 0.2


# ------------------------------------------------------------------------------------------------------ from a folder
@pytest.mark.parametrize("tared", [False, True])
@pytest.mark.parametrize("zeros", [1, 3])
def test_a_session_folder_with_one_zero_row_each_tells_its_noise_and_drift(tmp_path, zeros, tared):
    drift = {} if tared else {"trend": 2e-5, "wander": 5e-4}  # of a tared one it would be refused
    one = recording(np.random.default_rng(3), zeros=zeros, tared=tared, **drift)
    raw = one.readings[RAW].to_numpy() - 0.3 * tared
    raw[:, 2] -= np.where(one.readings["phase"] == "load", one.readings["depth_mm"], 0.0)
    table = one.readings[["press", "time_s", "phase", "x_mm", "y_mm", "depth_mm"]].assign(
        cell="", order=pd.factorize(one.readings["press"])[0], speed_mm_per_s=1.0, dwell_s=np.nan, image=""
    )
    table[FORCE] = raw
    folder = tmp_path / "s1"
    folder.mkdir()
    table.to_csv(folder / "indentations.csv", index=False)
    (folder / "session.yaml").write_text(
        f"session: s1\nforce: {{tared: {str(tared).lower()}, resolution_N: [0.0001, 0.0001, 0.0001]}}\n"
    )
    found = observe([folder], SENSOR)
    assert found.noise_N[0] == pytest.approx([SIGMA] * 3, rel=0.4)
    told = any("all indentations together" in said for said in found.cannot_know)
    assert told == (zeros == 1)
    drifts = zeros == 1 and not tared  # that of a tared session is not subtracted: force_drift stands for it
    assert found.drift_N.any() == drifts and found.trend_N.any() == drifts
