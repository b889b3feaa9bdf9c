"""The global test and the scan: calibrated without a mismatch, right about where with one."""

from dataclasses import replace

import numpy as np
import pytest
from artificial_readings import covariance_of, draws_of, flat_base, grid, readings
from scipy.stats import binom, chi2, kstest

from gelforge.mismatch.evidence.covariance import Covariance, Estimated
from gelforge.mismatch.inference.patterns import dictionary
from gelforge.mismatch.inference.scan import global_test, scan, whitened

NULLS = 200


@pytest.fixture(scope="module")
def recording():
    context = readings(grid(4), unload=True)
    labels, base = context.observations.labels(), flat_base(context)
    covariance = covariance_of(context)
    return labels, base, covariance, whitened(dictionary(labels, base), covariance)


@pytest.fixture(scope="module")
def nulls(recording):
    covariance = recording[2]
    return draws_of(covariance, np.random.default_rng(11), NULLS)


def test_global_p_is_uniform_without_a_mismatch_as_a_bootstrap_finds(recording, nulls):
    tests = [global_test(r, recording[2]) for r in nulls.T]
    assert kstest([one.p for one in tests], "uniform").pvalue > 1e-3  # seeded: wrong degrees give 1e-50
    for one in tests:  # a law of another width passes the test of uniformity
        assert one.p == pytest.approx(chi2.sf(one.chi2, one.degrees), rel=1e-9)

    # The nuisances are part of the covariance, so draws of it have the chi-square law itself.
    covariance = recording[2]
    r = draws_of(covariance, np.random.default_rng(12), 1)[:, 0] * 1.03
    tested = global_test(r, covariance)
    bootstrap = np.mean([global_test(null, covariance).chi2 >= tested.chi2 for null in nulls.T])
    assert abs(bootstrap - tested.p) < 4 * np.sqrt(tested.p * (1 - tested.p) / NULLS)  # binomial error
    assert 0.02 < tested.p < 0.98  # else the two would agree at an end of the range whatever they do


def test_scan_is_calibrated_and_what_was_fitted_neither_helps_nor_harms(recording, nulls):
    # Scan is calibrated without a mismatch
    _, _, covariance, atoms = recording
    white = covariance.whiten(nulls)
    p = [scan(r, atoms, np.random.default_rng(k), draws=300).p for k, r in enumerate(white.T)]
    assert kstest(p, "uniform").pvalue > 1e-3
    alarms = np.sum(np.array(p) < 0.025)
    assert alarms <= binom.ppf(0.999, NULLS, 0.025)

    # What was fitted neither helps nor harms. Adequacy of a model with fitted amounts: uniform p again, of the
    # global test and of the scan
    labels, base, covariance, _ = recording
    time = (labels["time_s"] / labels["time_s"].max()).to_numpy()
    J = np.column_stack([base, base * time, *[time * (labels["axis"] == k) for k in range(3)]])
    left = whitened(dictionary(labels, base), covariance, J)
    W = covariance.whiten(J)
    tests, scans = [], []
    for k, null in enumerate(nulls.T):
        r = null + J @ [0.3, -0.2, 0.05, 0.02, 0.1]
        r = r - J @ np.linalg.lstsq(W, covariance.whiten(r))[0]
        tests.append(global_test(r, covariance, J).p)
        scans.append(scan(covariance.whiten(r), left, np.random.default_rng(k), draws=300).p)
    assert kstest(tests, "uniform").pvalue > 1e-3
    assert kstest(scans, "uniform").pvalue > 1e-3
    assert global_test(r, covariance, np.column_stack([J, J])).degrees == len(r) - 5


REPEATS, RECORDINGS = 60, 60


def test_noise_that_was_estimated_and_heavy_tails_do_not_raise_the_global_test(recording):
    # Noise that was estimated is not taken as known. Variances estimated from 60 repeats err by 18 %: taken as
    # known they give two to ten times the alarms
    labels, _, known, _ = recording
    rng, axis = np.random.default_rng(13), labels["axis"].to_numpy()
    base = recording[1]
    found = {"estimated": [], "taken as known": []}
    for k in range(RECORDINGS):
        share = rng.chisquare(REPEATS, 3) / REPEATS
        estimated = Estimated(axis, np.full(3, float(REPEATS)), np.ones(3))
        covariance = replace(known, variance=known.variance * share[axis], estimated=estimated)
        white = covariance.whiten(draws_of(known, rng, 1))[:, 0]
        atoms = whitened(dictionary(labels, base), covariance)
        for name, of in (("estimated", covariance), ("taken as known", replace(covariance, estimated=None))):
            found[name].append(
                [
                    global_test(draws_of(known, rng, 1)[:, 0], of).p,
                    scan(white, atoms, np.random.default_rng(k), draws=300, estimated=of.estimated).p,
                ]
            )
    alarms = {name: np.mean(np.array(p) < 0.05, axis=0) for name, p in found.items()}
    assert np.all(alarms["estimated"] <= binom.ppf(0.999, RECORDINGS, 0.05) / RECORDINGS)
    assert np.all(alarms["taken as known"] > alarms["estimated"])

    # Heavy tails do not raise the global test. Student's t with 5 degrees: squares vary four times as much as a
    # normal draw's, 1 + 6 / 2
    n, rng = 1200, np.random.default_rng(14)
    group = np.zeros(n, int)
    drawn = rng.standard_t(5, (400, n)) * np.sqrt(3 / 5)
    p = {
        tails: [
            global_test(
                r, Covariance(np.ones(n), (), Estimated(group, np.array([np.inf]), np.array([tails])))
            ).p
            for r in drawn
        ]
        for tails in (1.0, 4.0)
    }
    assert np.mean(np.array(p[4.0]) < 0.05) < 0.08  # 400 draws: two and a half standard errors
    assert np.mean(np.array(p[1.0]) < 0.05) > 0.12  # taken as normal


def bump(labels, base, x, y):
    return (
        0.25
        * base
        * np.exp(-((labels["x_mm"] - x) ** 2 + (labels["y_mm"] - y) ** 2) / (2 * 3.5**2)).to_numpy()
    )


PLANTED = {
    "position": lambda labels, base: bump(labels, base, 13.5, 18.5),
    "depth": lambda labels, base: 0.2 * base * (labels["depth_mm"] > 1.5).to_numpy(),
    "time": lambda labels, base: (
        0.03 * (labels["axis"] == 0).to_numpy() * (labels["time_s"] > 700).to_numpy()
    ),
    "phase": lambda labels, base: -0.15 * base * (labels["phase"] == "unload").to_numpy(),
    "axis": lambda labels, base: 0.02 * (labels["axis"] == 1).to_numpy(),
}


@pytest.mark.parametrize("kind", PLANTED)
def test_what_is_planted_is_found(recording, kind):
    labels, base, covariance, atoms = recording
    r = PLANTED[kind](labels, base) + draws_of(covariance, np.random.default_rng(13), 1)[:, 0]
    found = scan(covariance.whiten(r), atoms, np.random.default_rng(0))
    assert found.p < 0.005
    assert found.best.kind == kind
    assert found.best.snr > 5


def test_bumps_steps_and_patterns_are_placed_and_named_once(recording):
    # Bumps and steps are placed where they are
    labels, base, covariance, atoms = recording
    r = bump(labels, base, 13.5, 18.5) + draws_of(covariance, np.random.default_rng(14), 1)[:, 0]
    best = scan(covariance.whiten(r), atoms, np.random.default_rng(0)).best
    assert np.hypot(best.region["x_mm"] - 13.5, best.region["y_mm"] - 18.5) < 3  # mm: the goal for a defect

    # Steps tell when
    r = PLANTED["time"](labels, base) + draws_of(covariance, np.random.default_rng(15), 1)[:, 0]
    best = scan(covariance.whiten(r), atoms, np.random.default_rng(0)).best
    length = labels["time_s"].max()
    assert abs(best.region["time_s"][0] - 700) < length / 8  # steps are tried at eighths
    assert best.region["axis"] == "x"

    # Patterns are named once and need a stated order
    labels, base, _, _ = recording
    atoms = dictionary(labels, base)
    names = [one.name for one in atoms.patterns]
    assert len(set(names)) == len(names) == atoms.values.shape[1]
    assert np.all(np.abs(atoms.values).max(axis=0) > 0)
    shares = [k for k, name in enumerate(names) if "share" in name]
    doubled = dictionary(labels, 2 * base).values
    np.testing.assert_allclose(doubled[:, shares], 2 * atoms.values[:, shares], rtol=1e-15)

    # Presses whose order nobody stated have no presses before
    labels = readings(grid(2)).observations.labels()
    base = flat_base(readings(grid(2)))
    told = [one.name for one in dictionary(labels, base).patterns if "indentations before" in one.name]
    assert told and not [
        one for one in dictionary(labels.assign(order=0), base).patterns if "indentations before" in one.name
    ]


def test_several_sessions_are_told_apart_and_of_one_site_nothing_is_said():
    # Several sessions are distinguished
    context = readings(grid(3), sessions=2)
    labels, base = context.observations.labels(), flat_base(context)
    covariance = covariance_of(context)
    atoms = whitened(dictionary(labels, base), covariance)
    r = (
        0.1 * base * (labels["session"] == "s1").to_numpy()
        + draws_of(covariance, np.random.default_rng(16), 1)[:, 0]
    )
    assert scan(covariance.whiten(r), atoms, np.random.default_rng(0)).best.kind in {
        "session",
        "history",
    }  # age goes with it

    # One site can be scanned and nothing is said
    context = readings(grid(1), depths=(1.0,))
    labels, base = context.observations.labels(), flat_base(context)
    covariance = covariance_of(context)
    found = scan(
        covariance.whiten(0 * base),
        whitened(dictionary(labels, base), covariance),
        np.random.default_rng(0),
        100,
    )
    assert found.p == 1.0

    # Nothing to scan is said
    context = readings(grid(1))
    labels, base = context.observations.labels(), flat_base(context)
    atoms = dictionary(labels, base)
    with pytest.raises(ValueError, match="no pattern"):
        scan(
            base,
            replace(atoms, values=0 * atoms.values),
            np.random.default_rng(0),
        )
