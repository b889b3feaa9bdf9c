"""Zeros are exact, light touches stay, and intervals hold what they promise on rows that they were not made from."""

import numpy as np
import pytest

from gelforge.learning.models.reliability import Labels, Zero, centre_of_pressure, find_intervals, find_zero

GRID = (6, 6, np.array([32.0, 32.0]))
PLACE = (np.stack([np.arange(36) % 6, np.arange(36) // 6], axis=-1) + 0.5) * 32 / 6


def rows(count, seed, noise=1e-4):
    """Return predicted and true distributions (n, 36, 3) [N] and which rows nothing touches: errors grow with the force."""
    rng = np.random.default_rng(seed)
    where, size = rng.uniform(6, 26, (count, 2)), rng.uniform(0.02, 1.0, count)
    untouched = rng.random(count) < 0.2
    bump = np.exp(-((PLACE - where[:, None]) ** 2).sum(axis=-1) / 20)
    bump[bump < 0.05] = 0
    true = -(np.where(untouched, 0, size)[:, None] * bump)[..., None] * [0.1, -0.1, 1.0]
    predicted = true * (1 + 0.05 * rng.normal(size=true.shape)) + noise * rng.normal(size=true.shape)
    return predicted, true, untouched


def test_untouched_images_are_zero_and_light_touches_stay():
    # Untouched images are zero and the centre of pressure nearer
    zero = find_zero(*rows(600, 1), GRID)
    predicted, true, untouched = rows(600, 2)
    found = zero.applied(predicted)
    assert (found[untouched] == 0).mean() > 0.995
    observable = -true[..., 2].sum(axis=1) >= 0.02
    assert (np.abs(found[observable]).max(axis=(1, 2)) > 0).mean() > 0.99

    # The centre of pressure is nearer than without a threshold
    zero = find_zero(*rows(600, 1, noise=1e-3), GRID)
    predicted, true, untouched = rows(600, 2, noise=1e-3)
    known = centre_of_pressure(true[~untouched], *GRID)
    off = [
        np.nanmedian(np.hypot(*(centre_of_pressure(force[~untouched], *GRID) - known).T))
        for force in (predicted, zero.applied(predicted))
    ]
    assert off[1] < 0.8 * off[0]

    # A light touch stays however much the others smear. A smear far away in proportion to the force asks for a high
    # threshold of bins: it is no threshold of a touch
    predicted, true, untouched = rows(800, 3)
    light = ~untouched & (np.random.default_rng(4).random(800) < 0.08)
    predicted[light], true[light] = 0.03 * predicted[light], 0.03 * true[light]
    predicted += 0.02 * np.abs(true).max(axis=(1, 2), keepdims=True) * [0, 0, -1]
    zero = find_zero(predicted, true, untouched, GRID)
    seen = np.abs(zero.applied(predicted)).max(axis=(1, 2)) > 0
    observable = np.linalg.norm(predicted, axis=-1).max(axis=1) >= zero.contact_N
    assert light.sum() > 30
    assert (seen == observable).all()


@pytest.mark.parametrize("untouched", [True, False])
def test_without_untouched_rows_or_touches_nothing_is_cut(untouched):
    predicted, true, _ = rows(50, 1)
    assert find_zero(predicted, true, np.full(50, untouched), GRID) == Zero()


def test_intervals_hold_nine_in_ten_of_other_rows_at_every_size():
    zero = find_zero(*rows(3000, 1), GRID)
    intervals = found(zero.applied(rows(3000, 1)[0]), labels_of(rows(3000, 1)[1]))
    predicted, true, untouched = rows(3000, 2)
    predicted, carries = zero.applied(predicted), (true != 0).any(axis=-1)
    inside = np.abs(predicted - true) <= intervals.of_bins(predicted)
    size = np.linalg.norm(predicted, axis=-1)
    for low, high in ((0.0, 0.05), (0.05, 0.2), (0.2, np.inf)):  # 3 %: of some thousand bins in each
        chosen = carries & (size >= low) & (size < high)
        assert inside[chosen].mean() == pytest.approx(0.9, abs=0.03)
    total = np.abs((predicted - true).sum(axis=1))[~untouched] <= intervals.of_totals(predicted)[~untouched]
    assert total.mean(axis=0) == pytest.approx([0.9] * 3, abs=0.03)


def found(predicted, labels, groups=10):
    return find_intervals(predicted, labels, np.arange(len(predicted)) % groups)


def labels_of(true, sigma=0.0):
    return Labels(true, np.full_like(true, sigma), np.full_like(true[:, 0], sigma))


def test_intervals_of_the_true_force_need_rows_and_labels_with_bars():
    # Intervals of the true force hold it where labels are off. Labels off by a normal error as large as the
    # network's: their own standard deviation widens the interval
    (predicted, true, _), rng = rows(3000, 1), np.random.default_rng(3)
    sigma = 0.03
    off = np.where(true != 0, sigma * rng.standard_normal(true.shape), 0.0)
    intervals = found(predicted + off, labels_of(true + off, sigma))
    carries = (true != 0).any(axis=-1)
    half, wider = intervals.of_bins(predicted + off), intervals.of_true_bins(predicted + off)
    np.testing.assert_allclose(wider[carries], np.hypot(half, 1.645 * sigma)[carries], rtol=1e-9)
    assert (np.abs(predicted + off - true) <= wider)[carries].mean() == pytest.approx(0.9, abs=0.05)

    # Intervals need rows and only labels with bars widen them
    predicted, true, _ = rows(300, 1)
    intervals = found(predicted, labels_of(true, np.nan))
    np.testing.assert_array_equal(intervals.of_true_totals(predicted), intervals.of_totals(predicted))

    # Too few rows give no interval
    predicted, true, _ = rows(20, 1)
    assert found(predicted, labels_of(true)) is None

    # Where simulated rows, which have none, stand next to recorded ones.
    predicted, true, _ = rows(300, 1)
    labels = labels_of(true, 0.1)
    labels.bin_sigma[30:] = np.nan
    labels.total_sigma[30:] = np.nan
    intervals = found(predicted, labels)
    known = intervals.bin_sigma_N[intervals.bin_sigma_N > 0]
    np.testing.assert_allclose(known, 0.1, rtol=1e-12)
    assert len(known)


def test_a_few_groups_whose_errors_differ_give_wide_enough_intervals():
    """Of three orbits with errors of their own sizes: pooled, their intervals hold 88.5 % of another's, on average."""
    rng = np.random.default_rng(5)
    held = []
    for _ in range(200):
        scale = np.exp(0.4 * rng.standard_normal(40))  # three to learn from, the rest to judge by
        error = 1e-6 * scale[:, None, None, None] * rng.standard_normal((40, 100, 1, 3))
        true = np.broadcast_to(-rng.uniform(0.5, 1.5, (40, 100, 1, 1)), error.shape)
        learnt, judged = ((true[part] + error[part]).reshape(-1, 1, 3) for part in (slice(3), slice(3, None)))
        labels = labels_of(true[:3].reshape(-1, 1, 3))
        half = find_intervals(learnt, labels, np.repeat(np.arange(3), 100)).of_bins(judged)
        held.append((np.abs(error[3:].reshape(-1, 1, 3)) <= half).mean())
    assert np.mean(held) == pytest.approx(0.908, abs=0.012)  # its standard deviation is 0.005
