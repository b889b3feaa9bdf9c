"""Loads, unloads, holds and cycles found in noisy paths of stretch."""

import numpy as np
import pytest

from gelforge.materials.basis.segments import find_segments, first_reversal


def path(*corners, dt=0.1):
    """Return (time, stretch) through corners (time, stretch), sampled every dt."""
    t, s = zip(*corners)
    time = np.arange(t[0], t[-1] + dt / 2, dt)
    return time, np.interp(time, t, s)


STAIRS = path((0, 1), (5, 1.5), (50, 1.5), (55, 2), (100, 2), (105, 1.5), (150, 1.5), (155, 1))
CYCLES = path((0, 1), (10, 2), (20, 1.1), (30, 2), (40, 1.1), (50, 2.5), (65, 1))


@pytest.mark.parametrize("noise", [0, 1e-3, 3e-3], ids=str)  # of stretch; the range is 1 to 1.5
@pytest.mark.parametrize("sign", [1, -1], ids=["tension", "compression"])
def test_stairs(noise, sign):
    time, s = STAIRS
    s = 1 + sign * 0.5 * (s - 1) + np.random.default_rng(1).normal(0, 0.5 * noise, len(s))
    found = find_segments(s, time)
    assert [g.kind for g in found] == ["load", "hold", "load", "hold", "unload", "hold", "unload"]
    starts = [time[g.start] for g in found]
    # a corner is placed within the time in which the ramp (0.1 per second) passes a few tolerances
    np.testing.assert_allclose(starts, [0, 5, 50, 55, 100, 105, 150], atol=0.4)
    assert {g.cycle for g in found} == {1}


@pytest.mark.parametrize("timed", [True, False])
def test_cycles_are_counted(timed):
    time, s = CYCLES
    s = s + np.random.default_rng(2).normal(0, 3e-3, len(s))
    found = find_segments(s, time if timed else None)
    assert [(g.kind, g.cycle) for g in found] == [
        ("load", 1), ("unload", 1), ("load", 2), ("unload", 2), ("load", 3), ("unload", 3)
    ]  # fmt: skip


def test_segments_cover_all_rows_and_noise_is_no_reversal():
    # Segments cover all rows
    found = find_segments(*reversed(STAIRS))
    assert found[0].start == 0 and found[-1].stop == len(STAIRS[0])
    assert all(a.stop == b.start + 1 for a, b in zip(found, found[1:]))

    # A test that never moves is one hold
    assert [g.kind for g in find_segments(np.full(20, 1.5), np.arange(20.0))] == ["hold"]

    # Shear starts at zero
    time, s = path((0, 0), (10, 5), (20, 0))
    assert [g.kind for g in find_segments(s, time, at_rest=0.0)] == ["load", "unload"]

    # Noise is no reversal
    time, s = path((0, 1), (10, 2), (12, 2), (20, 1))
    s[30:34] = s[33] + 0.02  # 0.4 s ahead, then back by 2 % of the range
    assert [g.kind for g in find_segments(s, time)] == ["load", "hold", "unload"]

    # First reversal is beyond the tolerance only
    lam = np.linspace(1, 2, 101)
    assert first_reversal(lam) is None and first_reversal(lam[::-1]) is None
    noisy = lam.copy()
    noisy[50] -= 0.015  # back by 0.5 % of the range
    assert first_reversal(noisy) is None
    noisy[50] -= 0.02
    assert first_reversal(noisy) == 50
