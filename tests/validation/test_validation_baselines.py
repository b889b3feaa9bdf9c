"""Calibration of all effects next to a Gaussian process, against one large normal distribution of all that is unknown."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
from validation.baselines import Table, _calibrated, _discrepancies, kennedy_ohagan

SIGMA = 0.01


def table(change, seed=3, places=5, depths=4):
    """Return a table of readings (R, 3) whose force differs from the base by a change (R, 3) and noise."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(-8, 8, (places, 2)).repeat(depths, axis=0)
    depth = np.tile(np.linspace(0.4, 1.6, depths), places)
    rows = pd.DataFrame({"x_mm": at[:, 0], "y_mm": at[:, 1], "depth_mm": depth})
    base = np.column_stack([0.1 * at, depth**1.5])
    sigma = np.full(base.shape, SIGMA)
    measured = base + change(rows, base) + sigma * rng.normal(size=base.shape)
    train = np.arange(len(rows)) >= depths  # all places but the first
    return Table(rows, base, base + change(rows, base), measured, sigma, train)


def effects(one):
    """Return two effects: a gain of all axes by 10 %, and offsets of 0.05 N."""
    return {
        "force_gain": 0.1 * one.base[:, :, None],
        "force_offset": 0.05 * np.broadcast_to(np.eye(3), (len(one.rows), 3, 3)),
    }


def test_the_posterior_is_normal_and_names_the_effect_that_is_there():
    # Posterior is that of one normal distribution
    one = table(lambda rows, base: 0.07 * base)
    A, on = np.concatenate([*effects(one).values()], axis=2), one.train
    K = _discrepancies(one, (3.0, 0.4, 2.0))
    evidence, mean, spread, after = _calibrated(one, A, K, on)
    flat = A.transpose(1, 0, 2).reshape(-1, A.shape[2])  # axis by axis
    process = np.zeros((len(flat), len(flat)))
    R = len(one.rows)
    for k in range(3):
        process[k * R : (k + 1) * R, k * R : (k + 1) * R] = K[k]
    joint, chosen = flat @ flat.T + process, np.tile(on, 3)
    C = joint[np.ix_(chosen, chosen)] + SIGMA**2 * np.eye(chosen.sum())
    y = (one.measured - one.base).T.ravel()[chosen]
    weights = np.linalg.solve(C, y)
    assert_allclose(mean, flat[chosen].T @ weights, rtol=1e-8, atol=1e-10)
    assert_allclose((after - one.base).T.ravel(), joint[:, chosen] @ weights, rtol=1e-7, atol=1e-9)
    known = np.eye(A.shape[2]) - flat[chosen].T @ np.linalg.solve(C, flat[chosen])
    assert_allclose(spread, known, rtol=1e-7, atol=1e-9)
    assert evidence == pytest.approx(-0.5 * (y @ weights + np.linalg.slogdet(C)[1]))

    # It names the effect that is there and no other
    state, answer, after = kennedy_ohagan(one, effects(one))
    assert state == "identified" and answer[0][0] == ("force_gain",) and answer[0][1] > 0.99
    held_out = ~one.train
    left = [np.abs(force - one.oracle)[held_out].max() for force in (after, one.base)]
    assert left[0] < 0.2 * left[1]

    # It is silent of nothing and reports what no effect is
    nothing = table(lambda rows, base: 0 * base)
    columns = {"clock_offset": 0.1 * np.sin(7 * nothing.base)[:, :, None]}
    assert kennedy_ohagan(nothing, columns)[0] == "consistent"
    wave = table(lambda rows, base: 0.1 * np.sin(rows[["x_mm"]].to_numpy() / 2) * [0, 0, 1.0])
    assert kennedy_ohagan(wave, columns)[:2] == ("unexplained", ())
