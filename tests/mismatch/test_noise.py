"""What a session's own repeats say of its noise: its size, its tails, and steps wider than it."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from gelforge.config import ForceSensor
from gelforge.mismatch.readings.errors import reading_noise, steps_of, with_contact_point
from gelforge.mismatch.readings.observations import Observations
from gelforge.mismatch.readings.sessions import _table

FORCE = ["fx_N", "fy_N", "fz_N"]
RAW = ["fx_raw_N", "fy_raw_N", "fz_raw_N"]
SIGMA = np.array([0.002, 0.003, 0.006])


def recording(noise, step_N: float = 0.0005, presses: int = 400, repeatability_N=None, resolution_N=0.0005):
    """Return a recording whose presses have three zero rows and three dwell rows that drift in a straight line."""
    phase = np.tile(["zero"] * 3 + ["dwell"] * 3, presses)
    press = np.repeat([f"p{k}" for k in range(presses)], 6)
    time = np.tile([0.0, 0.1, 0.2, 5.0, 6.0, 9.0], presses)
    dwell = np.where(phase == "dwell", -0.4 + 0.01 * time, 0.0)[:, None]
    force = dwell + noise * SIGMA
    force = np.rint(force / step_N) * step_N if step_N else force
    readings = pd.DataFrame({"press": press, "phase": phase, "time_s": time, **dict(zip(FORCE, force.T))})
    readings[RAW] = readings[FORCE]
    sensor = ForceSensor(resolution_N=[resolution_N] * 3, repeatability_N=repeatability_N)
    return SimpleNamespace(readings=readings, session=SimpleNamespace(session="s", force=sensor))


def drawn(tails: bool, count: int = 400 * 6) -> np.ndarray:
    rng = np.random.default_rng(3)
    return rng.standard_t(5, (count, 3)) * np.sqrt(3 / 5) if tails else rng.standard_normal((count, 3))


def test_size_and_tails_are_those_of_the_repeats_and_wide_steps_are_taken_as_they_are():
    # Size and tails are those of the repeats
    # 1200 degrees of freedom: the size is known to 2 %, of heavy tails to 4 %; a squared draw of Student's t with 5 varies
    # four times as much as a normal one's, but its fourth moment comes slowly
    for tails, low, high in ((False, 1.0, 1.15), (True, 2.0, 8.0)):
        noise, rounding, (freedom, found), said = reading_noise(recording(drawn(tails)))
        assert noise == pytest.approx(SIGMA, rel=0.1)
        assert not rounding.any() and not said
        assert freedom == 400 * (2 + 1)
        assert low <= found <= high

    # Wide steps and a stated noise are taken as they are
    noise, rounding, _, _ = reading_noise(recording(drawn(False), step_N=0.02))
    assert rounding == pytest.approx(np.full(3, 0.02 / np.sqrt(12)))  # in all axes: half a step is 0.010
    assert (noise < 0.01).all()

    # A stated noise is taken as it is
    noise, _, (freedom, tails), said = reading_noise(
        recording(drawn(False)[:12], presses=2, repeatability_N=0.004)
    )
    assert (noise == 0.004).all() and freedom == np.inf and tails == 1.0
    assert "6 repeated readings" in said[0]


@pytest.mark.parametrize("repeatability_N", [None, 0.004])
def test_the_step_is_that_of_the_file_and_not_of_the_data_sheet(repeatability_N):
    noise, rounding, _, _ = reading_noise(recording(drawn(False), 0.001, 400, repeatability_N, 0.03))
    assert not rounding.any() and noise == pytest.approx(np.hypot(SIGMA, 0.001 / np.sqrt(12)), rel=0.1)


def test_steps_are_found_beneath_the_digits_and_a_resolution_counts_if_none_are():
    # Steps are found beneath the digits and turn with the axes. 3 / 1024 N with five digits, as ADCs have them;
    # five digits of anything; all digits; one number
    rng = np.random.default_rng(11)
    counts, any_number = rng.integers(-200, 200, 500), rng.normal(0, 0.3, 500)
    columns = [np.round(counts * 3 / 1024, 5), np.round(any_number, 5), any_number, np.full(500, 0.3)]
    found = steps_of(np.column_stack(columns))
    assert found[0] == pytest.approx(3 / 1024, rel=1e-4)
    assert found[1] == pytest.approx(1e-5) and np.isnan(found[2:]).all()

    # Steps turn with the axes of the force sensor
    one = recording(drawn(False), step_N=0.02)
    one.readings[RAW[0]] = np.round(np.random.default_rng(1).normal(size=2400), 4)  # its steps: 1e-4
    one.session.force = ForceSensor(axes=[[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    rounding = reading_noise(one)[1]
    assert rounding == pytest.approx([0.02 / np.sqrt(12), 0.02 / np.sqrt(12), 0.0])

    # A resolution counts where neither steps nor repeatability are known. As of readings between the samples of a
    # log, which have all digits
    for repeatability_N, step in ((None, 0.03), (0.004, 0.0)):
        noise, rounding, _, _ = reading_noise(recording(drawn(False), 0.0, 400, repeatability_N, 0.03))
        assert rounding == pytest.approx(np.full(3, step / np.sqrt(12)))
        assert noise == pytest.approx(np.maximum(SIGMA, 0.1 * step), rel=0.1)


# ------------------------------------------------------------------------------------------------------- relaxation
def relaxing(sigma=0.005, share=0.15, tau=5.0, presses=50):
    """Return a recording of presses to one depth that are read at once and 1 to 60 s later while they relax."""
    rng = np.random.default_rng(5)
    rows = []
    for k in range(presses):
        force = -1.5 * rng.uniform(0.3, 1.0)
        rows += [(f"p{k}", "zero", 0.1 * j, 0.0, 0.0) for j in range(4)]
        rows += [(f"p{k}", "load", 5.0, 1.0, force)]
        rows += [
            (f"p{k}", "dwell", 5.0 + t, 1.0, force * (1 - share * (1 - np.exp(-t / tau))))
            for t in (1.0, 3.0, 10.0, 30.0, 60.0)
        ]
    readings = pd.DataFrame(rows, columns=["press", "phase", "time_s", "depth_mm", "fz_N"])
    readings["fz_N"] += rng.normal(0, sigma, len(readings))
    readings = readings.assign(
        fx_N=rng.normal(0, sigma, len(readings)), fy_N=rng.normal(0, sigma, len(readings))
    )
    readings[RAW] = readings[FORCE]
    sensor = ForceSensor(resolution_N=[0.0005] * 3)
    return SimpleNamespace(readings=readings, session=SimpleNamespace(session="s", force=sensor))


def test_relaxation_is_no_noise_and_contact_scatter_is_seen_in_repeats():
    # Relaxation is no noise. Pooled with dwells that bend, Fz would seem to scatter by 20 mN in place of 5; 150
    # zero readings know it to 6 %
    noise, _, (freedom, _), said = reading_noise(relaxing())
    assert noise == pytest.approx([0.005] * 3, rel=0.2)
    assert freedom == 50 * 3 and "Fz bends during dwells" in said[0]
    _, _, (freedom, _), said = reading_noise(relaxing(share=0.0))
    assert freedom == 50 * (3 + 3) and not said

    # The scatter of the contact point is seen in repeats that found it. 400 presses of 4 places know a scatter to 4
    # %; the slope is a difference over 0.1 mm
    off = np.random.default_rng(8).normal(0, 0.02, 400)
    found = with_contact_point(pressed("press", off, (0.5, 0.6, 0.7, 0.8), 0.002, sites=4))
    assert found.press_depth_mm == pytest.approx(np.full(1600, 0.02), rel=0.12) and not found.cannot_know
    none = with_contact_point(pressed("press", 0 * off, (0.5, 0.6, 0.7, 0.8), 0.002, sites=4))
    assert (none.press_depth_mm < 0.001).all()

    # One zero for all presses is not seen in repeats
    found = with_contact_point(pressed("session", np.full(40, 0.05)))
    assert (found.session_depth_mm == 0.02).all() and not found.press_depth_mm.any()
    assert "0.02 mm is assumed" in found.cannot_know[0]

    # Two presses are one repeat however many depths they have
    found = with_contact_point(pressed("press", [0.0, 0.01], np.linspace(0.2, 1.0, 12)))
    assert (found.press_depth_mm == 0.02).all() and "assumed" in found.cannot_know[0]

    # Touch is where its row its speed or else the study says
    slow = [np.nan, np.nan, 0.1, 0.0]  # 10 s for the way down; at rest in a dwell
    untouched = ["zero", "none", "load", "dwell"]
    for columns, since, words in (
        ({}, 12.0, ""),
        ({"speed_mm_per_s": slow}, 12.0, ""),
        ({"speed_mm_per_s": slow, "phase": untouched}, 10.0, ""),
        ({"phase": untouched}, 2.0, "1 indentations have neither a touch row nor a speed"),
    ):
        found, told = timed(**columns)
        assert found == pytest.approx([since, since + 5.0])
        assert words in "".join(told) and bool(told) == bool(words)


# ------------------------------------------------------------------------------------------------------- depth zero
def pressed(by, off, depths=(0.5, 1.0), sigma=0.0, sites=1):
    """Return observations of presses that found depth zero off (P,) [mm], of a force of 1 N per mm^1.5."""
    rng = np.random.default_rng(7)
    rows = [(f"p{k}", k % sites, "load", d, -((d + o) ** 1.5)) for k, o in enumerate(off) for d in depths]
    table = pd.DataFrame(rows, columns=["press", "site", "phase", "depth_mm", "fz"])
    n = len(table)
    force = np.zeros((n, 3))
    force[:, 2] = table.pop("fz") + rng.normal(0, sigma, n)
    return Observations(
        table,
        force,
        np.zeros((sites, 2)),
        np.full((n, 3), sigma),
        np.zeros((n, 3)),
        *(np.full(n, np.nan if by == own else 0.0) for own in ("press", "session")),
    )


# ------------------------------------------------------------------------------------------------------- time of touch
def timed(**columns):
    """Return the time since touch of a press that is read 1 mm deep 20 s after its zero, and what is not known of it."""
    rows = [("zero", 0.0, 0.0), ("touch", 8.0, 0.0), ("load", 20.0, 1.0), ("dwell", 25.0, 1.0)]
    readings = pd.DataFrame(rows, columns=["phase", "time_s", "depth_mm"]).assign(
        press="p0", order=0, x_mm=0.0, y_mm=0.0, speed_mm_per_s=np.nan
    )
    readings = readings.assign(**columns)
    readings = readings[readings["phase"] != "none"].reset_index(drop=True)
    session = SimpleNamespace(session="s", sensor_age_days=None, temperature_C=None)
    told = []
    return _table(session, readings, 0.5, told)["press_time_s"].to_numpy()[-2:], told
