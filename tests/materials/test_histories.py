"""Rate, age, relaxation, hysteresis and softening: recovered from tests made with known answers."""

import numpy as np
import pytest
from scipy.special import erf

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.segments import find_segments
from gelforge.materials.covariates.effects import (
    AGE,
    RATE,
    TEMPERATURE,
    TREATMENT,
    effect_of,
    first_loading,
    scatter_between,
)
from gelforge.materials.covariates.hysteresis import (
    fit_ogden_roxburgh,
    loops,
    softening_between,
    softening_sentence,
)
from gelforge.materials.covariates.relaxation import fit_relaxation, relaxation_of

LAM = np.linspace(1.0, 2.0, 80)


def virgin(lam, G=0.05):
    return G * (lam - lam**-2)


def loading(factor=1.0, sample="s", rng=None, **known):
    noise = 1 if rng is None else np.exp(rng.normal(0, 0.02))
    return MaterialTest("uniaxial", sample, LAM, factor * noise * virgin(LAM), **known)


# ------------------------------------------------------------------------------------ rate, age, temperature
def test_rate_effect_per_decade_and_what_cannot_be_compared():
    # Rate effect per decade and its sentence
    rng = np.random.default_rng(0)
    rates = np.repeat([0.001, 0.01, 0.1], 3)
    tests = [loading(1.2 ** np.log10(r / 0.001), rng=rng, rate_per_s=r) for r in rates]
    effect = effect_of(RATE, tests)
    assert effect.slope_interval[0] < 0.2 < effect.slope_interval[1]
    assert effect.slope == pytest.approx(0.2, abs=0.03)  # 2 % scatter of nine tests: 0.8 % of the slope
    assert effect.verdict == "significant stiffening"
    assert "significant stiffening with strain rate" in effect.sentence and "per decade" in effect.sentence

    # Effects refuse what cannot be compared
    with pytest.raises(ValueError, match="two values that differ"):
        effect_of(RATE, [loading(rate_per_s=0.1), loading(rate_per_s=0.1)])
    with pytest.raises(ValueError, match="age_days is not known"):
        effect_of(AGE, [loading(age_days=1), loading()])
    other = MaterialTest("pure_shear", "p", LAM, virgin(LAM), rate_per_s=1.0)
    with pytest.raises(ValueError, match="cannot be compared"):
        effect_of(RATE, [loading(rate_per_s=0.1), other])


@pytest.mark.parametrize(
    ("change", "verdict"),
    [(0.0, "negligible"), (0.5, "significant stiffening"), (-0.3, "significant softening")],
)
def test_ageing_verdicts(change, verdict):
    rng = np.random.default_rng(3)
    tests = [loading(1 + change * (d / 63), rng=rng, age_days=d) for d in [0] * 6 + [63] * 6]
    effect = effect_of(AGE, tests)
    assert effect.verdict == verdict and effect.span == (0, 63)
    assert effect.interval[0] < change < effect.interval[1]


def test_interval_of_an_effect_holds_the_truth_in_95_percent():
    rng = np.random.default_rng(4)
    hits = 0
    for _ in range(400):
        tests = [loading(rng=rng, temperature_C=T) for T in (10, 20, 30, 40, 50)]
        low, high = effect_of(TEMPERATURE, tests).interval
        hits += low <= 0 <= high
    assert 0.92 < hits / 400 < 0.98  # binomial standard deviation 1.1 %


def test_two_tests_decide_only_with_the_scatter_of_repeats():
    tests = [loading(1.0, age_days=0), loading(1.3, age_days=60)]
    assert effect_of(AGE, tests).verdict == "undecided"
    assert "judged without repeats: samples that scatter by 9.5%" in effect_of(AGE, tests).sentence
    rng = np.random.default_rng(5)
    scatter = scatter_between([[loading(rng=rng) for _ in range(6)]])
    assert 0.01 < scatter.deviation < 0.04 and scatter.freedom == 5
    assert effect_of(AGE, tests, scatter).verdict == "significant stiffening"

    # A small but certain change is called small
    tests = [loading(1 + 0.02 * k / 9, dose=k) for k in range(3)]
    effect = effect_of(TREATMENT, tests, scatter_between([[loading(), loading(1.0001)]]))
    assert effect.verdict == "negligible"  # within 5 %, though resolved
    repeats = scatter_between([[loading(), loading(1.0016)]])
    wide = effect_of(TREATMENT, [loading(1, dose=0), loading(1.04, dose=1)], repeats)
    assert wide.verdict in ("small", "negligible") and wide.change == pytest.approx(0.04)


# ------------------------------------------------------------------------------------------------ relaxation
TRUE_G, TRUE_TAU, P0 = np.array([0.25, 0.15]), np.array([2.0, 100.0]), 0.08


def relaxed(t, ramp=0.0):
    reduced = TRUE_TAU / ramp * -np.expm1(-ramp / TRUE_TAU) if ramp else 1.0
    return P0 * (1 - TRUE_G.sum() + (TRUE_G * reduced * np.exp(-t[:, None] / TRUE_TAU)).sum(axis=1))


@pytest.mark.parametrize("ramp", [0.0, 5.0])
def test_prony_series_is_recovered_with_its_ramp_taken_out(ramp):
    t = np.geomspace(0.05, 2000, 900)
    fit = fit_relaxation(t, relaxed(t, ramp), ramp_s=ramp)
    # rows are averaged in bins of 17 % of time, over which the fast term changes by up to 1 %
    assert fit.equilibrium_share == pytest.approx(0.6, abs=0.005)
    assert fit.instantaneous_stress == pytest.approx(P0, rel=0.01)
    assert fit.prony_rms < 0.005 and fit.better == "Prony series"
    assert "significant relaxation" in fit.sentence
    fast = fit.shares[fit.times_s < 15].sum()
    assert fast == pytest.approx(0.25, abs=0.01)
    assert fit.drop_at(50) == pytest.approx(1 - relaxed(np.array([50.0]))[0] / P0, abs=0.02)


def test_relaxations_need_their_ramp_and_take_the_law_that_fits():
    # A relaxation needs its ramp and its rows
    t = np.geomspace(0.05, 2000, 900)
    blind = fit_relaxation(t, relaxed(t, 5.0), ramp_s=0.0)
    assert blind.instantaneous_stress < 0.93 * P0  # of the 2 s term only 37 % are left after a ramp of 5 s

    # Too few rows are refused
    with pytest.raises(ValueError, match="8 at least are needed for a relaxation spectrum"):
        fit_relaxation(np.arange(1.0, 6), np.ones(5))

    # A power law is distinguished from a prony series and noise needs no more terms
    t = np.geomspace(0.1, 1000, 600)
    rng = np.random.default_rng(6)
    power = fit_relaxation(t, 0.1 * t**-0.05 * (1 + rng.normal(0, 0.005, 600)))
    assert power.power_exponent == pytest.approx(0.05, abs=0.002)
    assert power.power_exponent_interval[0] < 0.05 < power.power_exponent_interval[1]
    assert power.better == "power law"
    flat = fit_relaxation(t, 0.1 * (1 + rng.normal(0, 0.002, 600)))
    assert flat.drop_interval[1] < 0.05 and "negligible" in flat.sentence and len(flat.shares) <= 1


def test_the_hold_of_a_test_is_found_and_its_ramp_used():
    t = np.r_[np.linspace(0, 5, 50, endpoint=False), 5 + np.geomspace(0.02, 500, 400)]
    lam = np.interp(t, [0, 5, 600], [1, 1.5, 1.5])
    stress = np.where(t < 5, P0 * t / 5, relaxed(np.maximum(t - 5, 0), 5.0))
    test = MaterialTest(
        "compression", "c", 2 - lam, -stress, t, history="relaxation", segments=find_segments(2 - lam, t)
    )
    fit = relaxation_of(test)
    assert fit.equilibrium_share == pytest.approx(0.6, abs=0.03)
    assert fit.stretch == pytest.approx(0.5)
    with pytest.raises(ValueError, match="no hold 2"):
        relaxation_of(test, 1)


# ------------------------------------------------------------------------------------- hysteresis, softening
R, M, BETA = 1.6, 0.004, 0.15


def energy(lam, G=0.05):
    return G * (lam**2 / 2 + 1 / lam - 1.5)


def damaged(lam, lam_max):
    eta = 1 - erf((energy(lam_max) - energy(lam)) / (M + BETA * energy(lam_max))) / R
    return eta * virgin(lam)


def cyclic(*peaks, factor=1.0):
    """Return cycles to rising or repeated peaks with Ogden and Roxburgh's softening."""
    lam, P, furthest = [np.array([1.0])], [np.array([0.0])], 1.0
    for peak in peaks:
        up = np.linspace(1, peak, 121)[1:]
        P.append(np.where(up >= furthest, virgin(up), damaged(up, furthest)))
        furthest = max(furthest, peak)
        down = np.linspace(peak, 1, 121)[1:]
        P.append(damaged(down, furthest))
        lam += [up, down]
    lam, P = np.concatenate(lam), factor * np.concatenate(P)
    time = np.r_[0, np.cumsum(np.abs(np.diff(lam)))]
    return MaterialTest("uniaxial", "c", lam, P, time, history="cyclic", segments=find_segments(lam, time))


def test_loops_have_their_area_and_the_second_of_damage_loses_nothing():
    t = np.linspace(0, 2, 401)
    lam = np.where(t <= 1, 1 + t, 3 - t)
    P = np.where(t <= 1, lam - 1, 0.7 * (lam - 1))  # loading work 1/2, unloading 0.35
    test = MaterialTest("uniaxial", "x", lam, P, t, history="cyclic", segments=find_segments(lam, t))
    loop = loops(test)[0]
    assert loop.loading_work == pytest.approx(0.5, abs=1e-6)
    assert loop.lost_share == pytest.approx(0.3, abs=2e-3)  # the stress jumps within one of 200 rows
    assert "significant hysteresis" in loop.sentence
    shifted = MaterialTest("uniaxial", "x", lam, P - np.where(t > 1, 0.07, 0), t, segments=test.segments)
    assert loops(shifted)[0].residual_strain == pytest.approx(0.1, abs=1e-6)  # 0.7 e = 0.07

    # The second loop of damage loses nothing
    first, second = loops(cyclic(2.0, 2.0))
    assert first.lost_share > 0.2
    assert abs(second.lost_share) < 0.01 and "negligible" in second.sentence


def test_ogden_roxburgh_parameters_and_softening_between_loadings_are_recovered():
    # Ogden roxburgh parameters are recovered
    fit = fit_ogden_roxburgh([cyclic(1.5, 2.0, 2.0), cyclic(1.8)])
    assert fit.r == pytest.approx(R, rel=0.02)  # W is integrated over 120 rows per loading
    assert fit.m_MPa == pytest.approx(M, rel=0.05)
    assert fit.beta == pytest.approx(BETA, rel=0.05)
    assert fit.rms < 0.003 and fit.determined
    with pytest.raises(ValueError, match="softening needs cycles"):
        fit_ogden_roxburgh([loading()])

    # Softening between loadings and its sentence
    tests = [cyclic(2.0, 2.0, factor=f) for f in (1, 1.1, 0.95)]
    changes = [softening_between(first_loading(test), test.of_kind("load", 2)[0]) for test in tests]
    lam = np.linspace(1.1, 1.55, 50)
    assert changes[0] == pytest.approx(damaged(lam, 2.0).mean() / virgin(lam).mean() - 1, abs=0.01)
    noisy = [c + e for c, e in zip(changes, (-0.01, 0.0, 0.012))]
    assert "significant softening (Mullins effect)" in softening_sentence(noisy)
    assert "negligible" in softening_sentence([0.004, -0.003, 0.001, 0.0])
    assert "do not decide" in softening_sentence([-0.2, 0.1])
    assert "not known" in softening_sentence([-0.2])
