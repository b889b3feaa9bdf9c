"""The covariance of readings: against a dense matrix written entry by entry, and against its own draws."""

from dataclasses import replace

import numpy as np
import pytest
from artificial_readings import covariance_of, draws_of, flat_base, grid, law_directions, readings
from numpy.testing import assert_allclose
from scipy.stats import chi2, multivariate_normal

from gelforge.mismatch.evidence.covariance import Covariance, Draws, readings_covariance

CASES = {
    "presses": dict(sites=grid(2)),
    "unloading": dict(sites=grid(2), unload=True),
    "sessions": dict(sites=grid(2), sessions=2, zero_by="session"),
    "one axis": dict(sites=grid(2), blind=(0, 1)),
    "one site": dict(sites=grid(1)),
    "rounded": dict(sites=grid(2), dwell=2, rounding=0.003),
    "stage and contact point": dict(sites=grid(2), sessions=2, zero_by="both"),
    "one zero row each": dict(sites=grid(2), sessions=2, zero_by="both", drift=0.002, trend=0.001),
}


def dense(context, law, floor) -> np.ndarray:
    """Return C (n, n) from what each pair of entries shares, which is the same from either side."""
    o, slope = context.observations, context.slope()
    labels = o.labels()
    steady = floor * context.force / (np.hypot(context.force, floor) + 1e-300)
    turn = np.pi / 2 / o.table["depth_mm"].max()
    C = np.zeros((len(labels), len(labels)))
    for i, a in enumerate(labels.itertuples()):
        for j, b in enumerate(labels.head(i + 1).itertuples()):
            at_a, at_b = (a.reading, a.axis), (b.reading, b.axis)
            c = law[at_a] @ law[at_b]
            alike = ((a.axis == 2) == (b.axis == 2)) * np.cos(turn * (a.depth_mm - b.depth_mm))
            c += 0.5 * steady[at_a] * steady[at_b] * alike * (1 + (a.site == b.site))
            held = (a.press, a.phase, a.depth_mm, a.axis) == (b.press, b.phase, b.depth_mm, b.axis)
            c += held * o.rounding_N[at_a] * o.rounding_N[at_b]
            c += o.zero_N[at_a] * o.zero_N[at_b] * (a.press == b.press and a.axis == b.axis)
            c += o.drift_N[at_a] * o.drift_N[at_b] * (a.press == b.press and a.axis == b.axis)
            c += o.trend_N[at_a] * o.trend_N[at_b] * (a.session == b.session and a.axis == b.axis)
            for off, shared in (
                (o.press_depth_mm, a.press == b.press),
                (o.session_depth_mm, a.session == b.session),
            ):
                c += shared * off[a.reading] * slope[at_a] * off[b.reading] * slope[at_b]
            C[i, j] = C[j, i] = c + (i == j) * o.noise_N[at_a] ** 2
    return C


@pytest.fixture(params=CASES, scope="module")
def case(request):
    context = readings(**CASES[request.param])
    return covariance_of(context), dense(context, law_directions(context), 0.01 * context.force)


def test_whitening_density_and_further_directions_are_those_of_the_whole_matrix(case):
    # Whitening is exact for any columns
    covariance, C = case
    W = covariance.whiten(np.eye(len(C)))
    # Rounding: the condition number of C, some 1e4 here, times 1e-16, with room.
    assert_allclose(W @ C @ W.T, np.eye(len(C)), atol=1e-10)
    assert_allclose(covariance.whiten(C[:, 0]), W @ C[:, 0], atol=1e-12)

    # No columns are whitened to none
    assert covariance.whiten(np.zeros((len(C), 0))).shape == (len(C), 0)

    # Density is that of a dense cholesky
    r = np.random.default_rng(0).normal(0, 0.05, len(C))
    assert_allclose(covariance.log_det, np.linalg.slogdet(C)[1], rtol=1e-10)
    assert_allclose(covariance.log_density(r), multivariate_normal.logpdf(r, cov=C), rtol=1e-9)
    assert_allclose(covariance.standard_deviation, np.sqrt(np.diag(C)), rtol=1e-12)

    # Parts and further directions have their matrix
    mask = np.random.default_rng(1).random(len(C)) < 0.6
    W = covariance.restricted(mask).whiten(np.eye(mask.sum()))
    assert_allclose(W @ C[np.ix_(mask, mask)] @ W.T, np.eye(mask.sum()), atol=1e-10)
    assert len(covariance.restricted(np.zeros(len(C), bool)).whiten(np.zeros((0, 2)))) == 0

    # Further directions add their outer product
    U = np.random.default_rng(2).normal(0, 0.1, (len(C), 3))
    W = covariance.extended(U).whiten(np.eye(len(C)))
    assert_allclose(W @ (C + U @ U.T) @ W.T, np.eye(len(C)), atol=1e-9)

    # Draws have the covariance
    count = 4000
    draws = draws_of(covariance, np.random.default_rng(3), count)
    found = draws @ draws.T / count
    error = np.sqrt((np.outer(np.diag(C), np.diag(C)) + C**2) / count)
    # Each entry's sampling error is normal with this deviation: 5.5 is passed by none of 1e5 correlated ones.
    assert np.abs((found - C) / error).max() < 5.5
    total = float(np.sum(covariance.whiten(draws) ** 2))
    assert 1e-4 < chi2.cdf(total, count * len(C)) < 1 - 1e-4


def test_errors_of_a_change_are_half_common_and_half_of_readings_alike(case):
    covariance, C = case
    U = np.random.default_rng(2).normal(0, 0.05, (len(C), 2))
    alike = covariance.levels[-2].group
    wanted = C + 0.5 * (U @ U.T) * (1 + (alike[:, None] == alike))
    W = covariance.erring(U).whiten(np.eye(len(C)))
    assert_allclose(W @ wanted @ W.T, np.eye(len(C)), atol=1e-10)

    # Steps that it has taken over from another covariance are not those of a further variance, or
    # of fewer entries.
    rng = np.random.default_rng(2)
    U, own = rng.normal(0, 0.05, (len(C), 2)), rng.uniform(0, 0.01, len(C))
    alike, mask = covariance.levels[-2].group, rng.random(len(C)) < 0.6
    wanted = C + 0.5 * (U @ U.T) * (1 + (alike[:, None] == alike))
    wide = covariance.erring(U)
    assert wide.taken
    for one, dense in (
        (wide.scattering(own), wanted + np.diag(own)),
        (covariance.scattering(own).erring(U), wanted + np.diag(own)),
        (wide.extended(U), wanted + U @ U.T),
        (wide.restricted(mask), wanted[np.ix_(mask, mask)]),
    ):
        W = one.whiten(np.eye(len(dense)))
        assert_allclose(W @ dense @ W.T, np.eye(len(dense)), atol=1e-9)


def test_mirror_images_err_alike_and_strong_nuisances_keep_the_whitening_exact():
    # Mirror images of one solution err alike
    context = readings(grid(2))
    law, floor = np.zeros((len(context.force), 3, 0)), 0.01 * context.force
    labels = context.observations.labels()
    own, shared = (
        draws_of(readings_covariance(context, law, floor, alike), np.random.default_rng(0), 20000)
        for alike in (None, np.zeros(len(context.force), int))
    )
    z = (labels["axis"] == 2) & (labels["depth_mm"] == 2.0)
    a, b = (np.flatnonzero(z & (labels["site"] == site))[0] for site in (0, 3))
    error = 0.02 * np.sqrt(
        np.mean(own[a] ** 2) * np.mean(own[b] ** 2)
    )  # 2.8 standard deviations of 20000 draws
    force = context.observations.flat(context.force)
    of_floor = 0.01**2 * force[a] * force[b]  # all of it where both sites are one press, else half
    assert abs(np.mean(shared[a] * shared[b]) - of_floor) < error + 1e-3 * of_floor
    assert abs(np.mean(own[a] * own[b]) - 0.5 * of_floor) < error + 1e-3 * of_floor

    # Strong nuisances keep the whitening exact. An error of the contact point a thousand times the noise: the
    # correction is nearly a projection
    o = context.observations
    context = replace(context, observations=replace(o, press_depth_mm=o.press_depth_mm * 1000))
    law, floor = law_directions(context), 0.01 * context.force
    C = dense(context, law, floor)
    r = np.random.default_rng(4).normal(0, 0.01, len(C))
    white = readings_covariance(context, law, floor).whiten(r)
    # The dense solution itself is only known to the condition number, 1e9, times 1e-16.
    assert_allclose(white @ white, r @ np.linalg.solve(C, r), rtol=1e-6)


def test_forty_thousand_readings_are_whitened_and_noise_and_one_site_per_press_must_be_given():
    # Forty thousand readings. A dense matrix of their 120 000 entries would take 115 GB
    depths = np.linspace(0.1, 2.0, 800)
    context = readings(grid(5), depths=depths)
    covariance = covariance_of(context)
    n = len(covariance)
    assert n == 120_000
    white = covariance.whiten(draws_of(covariance, np.random.default_rng(5), 1)[:, 0])
    assert abs(white @ white - n) < 5 * np.sqrt(2 * n)  # five standard deviations of its law
    relative = covariance.whiten(0.02 * flat_base(context))
    # 2 % everywhere is one standard deviation of the law's scale, so it is nowhere near what the noise alone would show.
    assert np.linalg.norm(relative) < 1 < np.linalg.norm(0.02 * flat_base(context)) / 0.010

    # Noise and one site per press must be given
    with pytest.raises(ValueError, match="resolution"):
        Covariance(np.array([1.0, 0.0]))

    # A press has one site
    levels = (Draws(np.array([0, 0]), np.ones((2, 1))), Draws(np.array([0, 1]), np.ones((2, 1))))
    with pytest.raises(ValueError, match="one site"):
        Covariance(np.ones(2), levels)
