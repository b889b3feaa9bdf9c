"""The screen: evidence against brute-force integration, calibrated probabilities and intervals, signs, switches, pairs."""

import numpy as np
import pytest
from artificial_readings import covariance_of, draws_of, flat_base, grid, readings
from numpy.testing import assert_allclose
from scipy.stats import binom

from gelforge.mismatch.evidence.gaussian import log_prior, normalised
from gelforge.mismatch.evidence.screen import (
    Candidate,
    evidence,
    judged_by,
    judged_under,
    log_evidence,
    screened,
)
from gelforge.mismatch.thresholds import SCALES

RNG = np.random.default_rng
AS_STATED = (1.0,)  # scales of plausible amounts: drawn as the priors say


def by_grid(r, J, prior_sd, signs):
    """Return log Bayes factor, mean and covariance by a sum over a grid of amounts around the mode, and half lines."""
    p = J.shape[1]
    A = J.T @ J + np.diag(1 / prior_sd**2)
    mode, sd = np.linalg.solve(A, J.T @ r), np.sqrt(np.diag(np.linalg.inv(A)))
    axes = []
    for k in range(p):
        lo, hi = mode[k] - 9 * sd[k], mode[k] + 9 * sd[k]
        if signs[k] > 0:
            lo, hi = 0.0, max(hi, sd[k])
        if signs[k] < 0:
            lo, hi = min(lo, -sd[k]), 0.0
        step = (hi - lo) / 1500
        axes.append(lo + step * (np.arange(1500) + 0.5))
    a = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, p)
    log_p = (
        a @ (J.T @ r)
        - 0.5 * np.einsum("ai,ij,aj->a", a, J.T @ J, a)
        - 0.5 * ((a / prior_sd) ** 2).sum(axis=1)
    )
    log_p -= np.log(prior_sd * np.sqrt(2 * np.pi)).sum() - np.log(2) * np.count_nonzero(signs)
    cell = np.prod([axis[1] - axis[0] for axis in axes])
    top = log_p.max()
    w = np.exp(log_p - top)
    mean = w @ a / w.sum()
    return top + np.log(w.sum() * cell), mean, (a - mean).T * w @ (a - mean) / w.sum()


# True amounts in widths; the last ones are far on the forbidden side, where only the tail is allowed.
ONE = [(0, 0.0), (0, 2.0), (1, 1.5), (1, 0.0), (1, -2.0), (-1, 1.0), (-1, -1.0)]


@pytest.mark.parametrize(("sign", "amount"), ONE)
def test_evidence_of_one_amount(sign, amount):
    J = RNG(1).normal(0, 0.5, (40, 1))
    r = J[:, 0] * amount * 0.7 + RNG(2).normal(size=40)
    args = r, J, np.array([0.7]), np.array([sign])
    found, wanted = evidence(*args), by_grid(*args)
    for a, b in zip(found, wanted):
        assert_allclose(a, b, rtol=1e-4, atol=1e-5)  # the grid's midpoints: 1500 over 18 deviations


# With two signs the orthant is approximate: a factor exp(0.1) in odds decides nothing.
TWO = [((0, 0), 1e-4), ((1, 0), 1e-4), ((0, -1), 1e-4), ((1, 1), 0.1), ((1, -1), 0.1)]


@pytest.mark.parametrize(("signs", "tolerance"), TWO)
@pytest.mark.parametrize("amounts", [(0.0, 0.0), (1.0, -1.0), (1.0, 0.3), (-0.7, 0.4)])
def test_evidence_of_two_amounts(signs, tolerance, amounts):
    J = RNG(3).normal(0, 0.5, (30, 2))
    J[:, 1] += 0.5 * J[:, 0]  # correlated
    r = J @ amounts + RNG(4).normal(size=30)
    args = r, J, np.array([0.8, 1.2]), np.array(signs)
    (found, mean, cov), (wanted, mean_0, cov_0) = evidence(*args), by_grid(*args)
    assert abs(found - wanted) < tolerance
    sd = np.sqrt(np.diag(cov_0))
    assert np.all(np.abs(mean - mean_0) < 2 * tolerance * sd)
    assert_allclose(np.sqrt(np.diag(cov)), sd, rtol=2 * tolerance)


def test_the_forbidden_side_far_out():
    """40 and 4000 standard deviations on the wrong side: next to nothing is left, and nothing overflows."""
    for amount in (-4.0, -400.0):
        J = np.full((100, 1), 1.0)
        log_factor, mean, cov = evidence(amount * J[:, 0], J, np.array([1.0]), np.array([1]))
        # The integral of exp(-100 |a| x) over the half line, twice the prior's density at 0.
        assert_allclose(log_factor, np.log(2 / np.sqrt(2 * np.pi) / (100 * abs(amount))), atol=2e-3)
        assert_allclose(mean[0], 1 / (100 * abs(amount)), rtol=2e-3)
        assert 0 < cov[0, 0] < 1.01 * mean[0] ** 2


def make(context, sign=0):
    """Return candidates: stiffness, offset of the depth, gain of x, drift, bumps, and a switch."""
    labels, base = context.observations.labels(), flat_base(context)
    axis = labels["axis"].to_numpy()
    slope = context.observations.flat(context.slope())
    time = (labels["time_s"] / labels["time_s"].max()).to_numpy()

    def candidate(name, columns, prior_sd, signs=None, binary=False, shape=None):
        columns = np.column_stack(columns)
        signs = np.zeros(columns.shape[1], int) if signs is None else np.array(signs)
        return Candidate(name, shape or {}, columns, np.array(prior_sd), signs, binary)

    bumps = [
        candidate(
            "inclusion",
            [base * np.exp(-((labels["x_mm"] - x) ** 2 + (labels["y_mm"] - y) ** 2) / 30).to_numpy()],
            [0.5],
            [1],
            shape={"x_mm": x, "y_mm": y},
        )
        for x, y in context.observations.sites
    ]
    return [
        candidate("gel_stiffness", [base], [0.1]),
        candidate("contact_zero", [slope], [0.05]),
        candidate("frame_compliance", [-slope * base], [0.05], [1]),
        candidate("gain_x", [base * (axis == 0)], [0.05]),
        candidate("force_drift", [time * (axis == k) for k in range(3)], [0.03] * 3),
        candidate("late", [base * (time > 0.5)], [0.1], [sign]),
        *bumps,
        candidate("hardening", [0.3 * base * (labels["depth_mm"] > 0.6).to_numpy()], [1.0], binary=True),
    ]


@pytest.fixture(scope="module")
def world():
    context = readings(grid(3), depths=(0.5, 1.0, 1.5))
    return covariance_of(context), make(context)


def drawn(rng, covariance, candidate):
    """Return a residual with amounts of the candidate from its prior, and the amounts."""
    amounts = candidate.prior_sd * rng.normal(size=len(candidate.prior_sd))
    amounts = np.where(candidate.signs != 0, candidate.signs * np.abs(amounts), amounts)
    amounts = np.ones(1) if candidate.binary else amounts
    return candidate.columns @ amounts + draws_of(covariance, rng, 1)[:, 0], amounts


def test_probabilities_are_calibrated(world):
    """Cases drawn as the priors say: the right answer's probabilities are as often right as they say."""
    covariance, candidates = world
    rng = RNG(5)
    names = list(dict.fromkeys(c.name for c in candidates))
    told, right, null_told, null_true = [], [], [], []
    for _ in range(300):
        truth = "null" if rng.random() < 0.5 else rng.choice(names)
        if truth == "null":
            r = draws_of(covariance, rng, 1)[:, 0]
        else:
            shapes = [c for c in candidates if c.name == truth]
            r = drawn(rng, covariance, shapes[rng.integers(len(shapes))])[0]
        single = screened(r, covariance, candidates, scales=AS_STATED)
        weights = {one.name: one.log_bayes_factor + log_prior(1, len(single)) for one in single}
        p = normalised({"null": log_prior(0, len(single))} | weights)
        assert sum(p.values()) == pytest.approx(1)
        best = max(p, key=p.get)
        told.append(p[best])
        right.append(best == truth)
        null_told.append(p["null"])
        null_true.append(truth == "null")
    for said, true in ((told, right), (null_told, null_true)):
        said, true = np.array(said), np.array(true)
        error = np.sqrt(np.sum(said * (1 - said)))  # of the number right, if what is said is so
        assert abs(true.sum() - said.sum()) < 3.5 * error
        confident = said > 0.9
        wrong = np.sum(~true & confident)
        assert wrong <= max(3, 3 * np.sum(1 - said[confident]))


def test_intervals_cover(world):
    covariance, candidates = world
    rng, inside, count = RNG(6), 0, 0
    for _ in range(60):
        for candidate in candidates[:6]:
            r, amounts = drawn(rng, covariance, candidate)
            judged = screened(r, covariance, [candidate], scales=AS_STATED)[0]
            sd = np.sqrt(np.diag(judged.covariance))
            inside += np.sum(np.abs(judged.amounts - amounts) < 1.6449 * sd)
            count += len(amounts)
    assert binom.ppf(0.001, count, 0.9) <= inside <= binom.ppf(0.999, count, 0.9)


def test_shapes_and_scales_are_averaged_and_the_best_is_kept(world):
    # Shapes are averaged and the best is kept
    covariance, candidates = world
    bumps = [c for c in candidates if c.name == "inclusion"]
    rng = RNG(7)
    r = 0.6 * bumps[4].columns[:, 0] + draws_of(covariance, rng, 1)[:, 0]
    judged = screened(r, covariance, bumps, scales=AS_STATED)[0]
    single = [screened(r, covariance, [bump], scales=AS_STATED)[0].log_bayes_factor for bump in bumps]
    assert judged.parts[0].shape == bumps[int(np.argmax(single))].shape == bumps[4].shape
    assert judged.log_bayes_factor == pytest.approx(np.log(np.mean(np.exp(np.array(single)))))
    assert judged.best_log_bayes_factor == pytest.approx(max(single))

    # Scales of plausible amounts are averaged. A small amount is met by a small scale, and one effect is no
    # likelier for having several
    drift = candidates[4]
    r = drift.columns @ (0.02 * np.ones(3)) + draws_of(covariance, RNG(16), 1)[:, 0]
    judged = screened(r, covariance, [drift])[0]
    alone = [screened(r, covariance, [drift], scales=(scale,))[0] for scale in SCALES]
    factors = np.array([one.log_bayes_factor for one in alone])
    assert judged.log_bayes_factor == pytest.approx(
        np.log(np.mean(np.exp(factors - factors.max()))) + factors.max()
    )
    assert_allclose(judged.amounts, alone[int(factors.argmax())].amounts)
    assert judged.plausible_snr == pytest.approx(alone[0].plausible_snr)


def test_a_wrong_sign_names_nothing_and_no_change_neither_proves_nor_refutes(world):
    # The wrong sign names nothing. A spring with negative compliance would explain the residual; it is unphysical
    # and falls behind no effect
    covariance, candidates = world
    spring = next(c for c in candidates if c.name == "frame_compliance")
    r = -0.3 * spring.columns[:, 0] + draws_of(covariance, RNG(11), 1)[:, 0]
    free = Candidate("free", {}, spring.columns, spring.prior_sd, np.zeros(1, int))
    found = {judged.name: judged for judged in screened(r, covariance, [spring, free])}
    assert found["free"].log_bayes_factor > 5 and found["free"].amounts[0] < 0
    assert found["frame_compliance"].log_bayes_factor < 0 and found["frame_compliance"].amounts[0] >= 0

    # An effect that changes nothing is neither proved nor refuted
    covariance, _ = world
    nothing = Candidate("nothing", {}, np.zeros((len(covariance), 1)), np.ones(1), np.zeros(1, int))
    assert screened(draws_of(covariance, RNG(14), 1)[:, 0], covariance, [nothing])[0].log_bayes_factor == 0

    # A switch is one or absent and snr is that of the change
    covariance, candidates = world
    binary = candidates[-1]
    d = binary.columns[:, 0]
    r = d + draws_of(covariance, RNG(8), 1)[:, 0]
    judged = screened(r, covariance, [binary], scales=AS_STATED)[0]
    assert judged.log_bayes_factor == pytest.approx(covariance.log_density(r - d) - covariance.log_density(r))
    assert judged.amounts == [1] and judged.covariance == [[0]]
    assert judged.snr == judged.plausible_snr == pytest.approx(np.linalg.norm(covariance.whiten(d)))

    # Snr is that of the change
    r = drawn(RNG(9), covariance, candidates[4])[0]
    judged = screened(r, covariance, [candidates[4]], scales=AS_STATED)[0]
    assert_allclose(judged.change, candidates[4].columns @ judged.amounts)
    assert judged.snr == pytest.approx(np.linalg.norm(covariance.whiten(judged.change)))
    random = candidates[4].columns @ (0.03 * RNG(10).normal(size=(3, 4000)))
    # A root mean square over 4000 draws of the prior has an error of 1 %.
    assert judged.plausible_snr == pytest.approx(
        np.sqrt(np.mean(np.sum(covariance.whiten(random) ** 2, axis=0))), rel=0.05
    )


def together(r, covariance, *parts):
    """Return effects judged together."""
    return judged_by(covariance.whiten(r), parts, [covariance.whiten(part.columns) for part in parts])


def test_two_effects_are_taken_for_two_and_one_for_one(world):
    covariance, candidates = world
    by_name = {c.name: c for c in candidates}
    drift, late = by_name["force_drift"], by_name["late"]
    r = (
        drift.columns @ [0.05, -0.05, 0.05]
        + 0.25 * late.columns[:, 0]
        + draws_of(covariance, RNG(12), 1)[:, 0]
    )
    single = screened(r, covariance, candidates, scales=AS_STATED)
    pair = together(r, covariance, drift, late)
    dearer = log_prior(1, len(single)) - log_prior(2, len(single))
    assert pair.log_bayes_factor > single[0].log_bayes_factor + dearer + 3
    joint = evidence(
        covariance.whiten(r),
        covariance.whiten(np.column_stack([drift.columns, late.columns])),
        np.concatenate([drift.prior_sd, late.prior_sd]),
        np.concatenate([drift.signs, late.signs]),
    )
    assert pair.log_bayes_factor == pytest.approx(joint[0])

    # One effect is not taken for two
    drift = next(c for c in candidates if c.name == "force_drift")
    r = drift.columns @ [0.06, -0.06, 0.06] + draws_of(covariance, RNG(13), 1)[:, 0]
    single = screened(r, covariance, candidates, scales=AS_STATED)
    for other in candidates:
        if other.name != "force_drift":
            pair = together(r, covariance, drift, other)
            assert pair.log_bayes_factor < single[0].log_bayes_factor + dearer


def test_errors_of_a_change_and_switches_are_judged_together(world):
    """ln N(r; 0, C + E E' + J W^2 J')."""
    covariance, candidates = world
    drift = candidates[4]
    r = drift.columns @ [0.04, 0.0, -0.05] + draws_of(covariance, RNG(17), 1)[:, 0]
    judged = screened(r, covariance, [drift], scales=AS_STATED)[0]
    wider = covariance.extended(0.2 * judged.change[:, None])
    wanted = wider.extended(drift.columns * drift.prior_sd).log_density(r)
    assert log_evidence(wider, r, judged.parts) == pytest.approx(wanted)
    again = judged_under(wider, r, judged.parts)
    assert np.all(np.diag(again.covariance) >= np.diag(judged.covariance))

    # The amount is fitted to what the switch leaves: ln N(r; d, C + J W^2 J') - ln N(r; 0, C).
    binary, drift = candidates[-1], candidates[4]
    d = binary.columns[:, 0]
    r = d + drift.columns @ [0.04, 0.0, -0.05] + draws_of(covariance, RNG(15), 1)[:, 0]
    wanted = covariance.extended(drift.columns * drift.prior_sd).log_density(r - d) - covariance.log_density(
        r
    )
    for first, second in ((binary, drift), (drift, binary)):
        judged = together(r, covariance, first, second)
        assert judged.log_bayes_factor == pytest.approx(wanted)
        on = judged.amounts[0 if first is binary else 3]
        assert on == 1
        assert_allclose(judged.change, sum(p.columns @ a for p, a in zip(judged.parts, _split(judged))))


def _split(judged):
    return np.split(judged.amounts, np.cumsum([part.columns.shape[1] for part in judged.parts])[:-1])
