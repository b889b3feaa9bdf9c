"""What a session's own repeats say of its noise: its size, its tails, and steps wider than it."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from gelforge.mismatch.sessions import reading_noise

FORCE = ["fx_N", "fy_N", "fz_N"]
SIGMA = np.array([0.002, 0.003, 0.006])


def recording(noise, resolution_N: float = 0.0005, presses: int = 400, repeatability_N=None):
    """Return a recording whose presses have three zero rows and three dwell rows that drift in a straight line."""
    phase = np.tile(["zero"] * 3 + ["dwell"] * 3, presses)
    press = np.repeat([f"p{k}" for k in range(presses)], 6)
    time = np.tile([0.0, 0.1, 0.2, 5.0, 6.0, 9.0], presses)
    dwell = np.where(phase == "dwell", -0.4 + 0.01 * time, 0.0)[:, None]
    force = np.rint((dwell + noise * SIGMA) / resolution_N) * resolution_N
    readings = pd.DataFrame({"press": press, "phase": phase, "time_s": time, **dict(zip(FORCE, force.T))})
    session = SimpleNamespace(
        session="s", force=SimpleNamespace(resolution_N=[resolution_N] * 3, repeatability_N=repeatability_N)
    )
    return SimpleNamespace(readings=readings, session=session)


def drawn(tails: bool, count: int = 400 * 6) -> np.ndarray:
    rng = np.random.default_rng(3)
    return rng.standard_t(5, (count, 3)) * np.sqrt(3 / 5) if tails else rng.standard_normal((count, 3))


def test_size_and_tails_are_those_of_the_repeats():
    # 1200 degrees of freedom: the size is known to 2 %, of heavy tails to 4 %; a squared draw of Student's t with 5 varies
    # four times as much as a normal one's, but its fourth moment comes slowly
    for tails, low, high in ((False, 1.0, 1.15), (True, 2.0, 8.0)):
        noise, rounding, (freedom, found), said = reading_noise(recording(drawn(tails)))
        assert noise == pytest.approx(SIGMA, rel=0.1)
        assert not rounding.any() and not said
        assert freedom == 400 * (2 + 1)
        assert low <= found <= high


def test_steps_wider_than_the_noise_are_an_error_of_their_own():
    noise, rounding, _, _ = reading_noise(recording(drawn(False), resolution_N=0.02))
    assert rounding == pytest.approx(np.full(3, 0.02 / np.sqrt(12)))  # in all axes: half a step is 0.010
    assert (noise < 0.01).all()


def test_a_stated_noise_is_taken_as_it_is():
    noise, _, (freedom, tails), said = reading_noise(
        recording(drawn(False)[:12], presses=2, repeatability_N=0.004)
    )
    assert (noise == 0.004).all() and freedom == np.inf and tails == 1.0
    assert "6 repeated readings" in said[0]
