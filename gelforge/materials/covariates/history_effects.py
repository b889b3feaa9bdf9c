"""Holds, cycles and lateral stretches of a material's tests as measured effects."""

from __future__ import annotations

import numpy as np

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.measured_effects import MeasuredEffect
from gelforge.materials.basis.statistics import LEAST_SAMPLES, mean_of
from gelforge.materials.covariates.circumstances import (
    alike_groups,
    alike_holds,
    common_hold,
    relaxation_by_circumstance,
)
from gelforge.materials.covariates.effects import NEGLIGIBLE, first_loading
from gelforge.materials.covariates.hysteresis import (
    Loop,
    fit_ogden_roxburgh,
    loops,
    softening_between,
    softening_interval,
    softening_sentence,
    softening_verdict,
)
from gelforge.materials.covariates.relaxation import ENDINGS, Relaxation, relaxation_of, relaxation_verdict

BETWEEN_SAMPLES = "Student's t, scatter between specimens"
LEAST_LATERAL_STRAIN = 0.05  # of ln lam_1: below it noise decides the ratio

Found = tuple[list[MeasuredEffect], list[tuple[str, str]]]


def relaxation_effects(tests: list[MaterialTest]) -> Found:
    """Return the first hold of each test, the mean of tests made in the same way, and what circumstances do to it."""
    effects, not_judged, held = [], [], []
    for test in tests:
        if test.time_s is None or not any(s.kind == "hold" for s in test.segments):
            continue
        try:
            fit = relaxation_of(test, _first_hold(test))
        except ValueError as error:
            not_judged.append(("relaxation", str(error)))
            continue
        held.append((test, fit))
        effects.append(_relaxation(test, fit))
    for group in alike_holds(held):
        if len(group) >= LEAST_SAMPLES:
            effects.append(_mean_relaxation(group[0][0].test, group))
    if held:
        effects += relaxation_by_circumstance([t for t, _ in held], [f for _, f in held])
    elif not not_judged:
        not_judged.append(("relaxation", "no hold with a time; test one"))
    return effects, not_judged


def _first_hold(test: MaterialTest) -> int:
    """Return the number of the first hold that follows a loading; 0 where the whole test is a hold."""
    holds = [i for i, s in enumerate(test.segments) if s.kind == "hold"]
    return next((k for k, i in enumerate(holds) if i and test.segments[i - 1].kind == "load"), 0)


def _relaxation(test: MaterialTest, fit: Relaxation) -> MeasuredEffect:
    source = "bootstrap of the hold's residuals (one sample)"
    parameters = {
        "stretch": fit.stretch,
        "drop_of_every_hold": _drops(test),
        "hold_s": list(fit.hold_s),
        "prony_shares": fit.shares.tolist(),
        "prony_times_s": fit.times_s.tolist(),
        "equilibrium_share": fit.equilibrium_share,
        "equilibrium_share_interval_95": list(fit.equilibrium_interval),
        "instantaneous_stress_kPa": fit.instantaneous_stress * 1e3,
        "prony_rms": fit.prony_rms,
        "power_exponent": fit.power_exponent,
        "power_exponent_interval_95": list(fit.power_exponent_interval),
        "power_rms": fit.power_rms,
        "better": fit.better,
    }
    sentence = f"{test.sample}: {fit.sentence}"
    return MeasuredEffect(
        effect="relaxation",
        test=test.test,
        quantity="share of stress lost during the hold",
        value=fit.drop,
        interval=fit.drop_interval,
        interval_from=source,
        unit="1",
        verdict=fit.verdict,
        sentence=sentence,
        samples=(test.sample,),
        parameters=parameters,
    )


def _drops(test: MaterialTest) -> list[float]:
    """Return 1 - last over first stress of every hold, as measured; a rise on the way back is negative."""
    holds = [test.nominal_stress[s.rows] for s in test.segments if s.kind == "hold"]
    return [float(1 - P[-1] / P[0]) for P in holds if P[0] != 0]


def _mean_relaxation(kind: str, held: list[tuple[MaterialTest, Relaxation]]) -> MeasuredEffect:
    begin, end = common_hold([fit for _, fit in held])
    mean = mean_of([fit.drop_between(begin, end) for _, fit in held])
    step = mean_of([fit.drop_at(end) for _, fit in held])
    low, high = mean.interval
    verdict = relaxation_verdict(mean.interval)
    sentence = (
        f"From {begin:.3g} to {end:.3g} s of the hold {len(held)} samples lose {mean.value:.1%} of their stress (95 %"
        f" interval {low:.1%} to {high:.1%}): {ENDINGS.get(verdict, verdict)}."
    )
    parameters = {
        "time_s": [begin, end],
        "deviation": mean.deviation,
        "drop_of_an_ideal_step": step.value,  # reaches back to the step by the Prony series
        "drop_of_an_ideal_step_interval_95": list(step.interval),
    }
    return MeasuredEffect(
        effect="relaxation",
        test=kind,
        quantity="share of stress lost within the time that all holds share, mean of samples",
        value=mean.value,
        interval=mean.interval,
        interval_from=BETWEEN_SAMPLES,
        unit="1",
        verdict=verdict,
        sentence=sentence,
        samples=tuple(t.sample for t, _ in held),
        parameters=parameters,
    )


def cycle_effects(tests: list[MaterialTest]) -> Found:
    """Return hysteresis of the first cycle, softening of the second and Ogden-Roxburgh's parameters, by kind of test."""
    effects, not_judged = [], []
    for group in alike_groups([t for t in tests if any(s.kind == "unload" for s in t.segments)]):
        firsts = [(test, cycles[0]) for test in group if (cycles := loops(test))]
        closed = [(test, loop) for test, loop in firsts if loop.loading_work > 0]
        together = [closed] if len(closed) >= LEAST_SAMPLES else [[one] for one in closed]
        effects += [_hysteresis(group[0].test, first) for first in together]
    for kind in dict.fromkeys(t.test for t in tests):
        of_kind = [t for t in tests if t.test == kind]
        cycled = [t for t in of_kind if any(s.kind == "unload" for s in t.segments)]
        changes, names, left_out = _softenings(of_kind, cycled)
        not_judged += [("softening", reason) for reason in left_out]
        if changes:
            effects.append(_softening(kind, changes, names))
        if cycled and changes:  # one loop alone cannot distinguish damage from viscosity
            effects.append(_ogden_roxburgh(kind, cycled))
    reasons = {"hysteresis": "no unloading in the tests", "softening": "no second loading of a sample"}
    judged = {e.effect for e in effects} | {effect for effect, _ in not_judged}
    return effects, not_judged + [(effect, why) for effect, why in reasons.items() if effect not in judged]


def _hysteresis(kind: str, first: list[tuple[MaterialTest, Loop]]) -> MeasuredEffect:
    shares = [loop.lost_share for _, loop in first]
    names = tuple(t.sample for t, _ in first)
    residual = [loop.residual_strain for _, loop in first if loop.residual_strain is not None]
    parameters = {
        "lost_share_by_sample": dict(zip(names, shares)),
        "largest_stretch_by_sample": {t.sample: loop.largest_stretch for t, loop in first},
        "residual_strain_mean": float(np.mean(residual)) if residual else None,
    }
    if len(first) == 1:
        loop = first[0][1]
        value, error, source = loop.lost_share, loop.quadrature_error, "spacing of the rows (one sample)"
        interval = (value - error, value + error)
        verdict = "negligible" if abs(value) + error < NEGLIGIBLE else "significant hysteresis"
        sentence = f"{names[0]}: {loop.sentence}"
    else:
        mean = mean_of(shares)
        value, interval, source = mean.value, mean.interval, BETWEEN_SAMPLES
        low, high = interval
        verdict = "negligible" if high < NEGLIGIBLE else "significant hysteresis" if low > 0 else "undecided"
        ending = {
            "negligible": f"hysteresis is negligible (below {NEGLIGIBLE:.0%})",
            "undecided": "whether hysteresis matters is not decided",
        }.get(verdict, verdict)
        sentence = (
            f"The first cycle loses {value:.1%} of the loading work (95 % interval {low:.1%} to {high:.1%},"
            f" {mean.count} samples): {ending}."
        )
    return MeasuredEffect(
        effect="hysteresis",
        test=kind,
        quantity="share of the first cycle's loading work that is lost",
        value=value,
        interval=interval,
        interval_from=source,
        unit="1",
        verdict=verdict,
        sentence=sentence,
        samples=names,
        parameters=parameters,
    )


def _softenings(of_kind: list[MaterialTest], cycled: list[MaterialTest]):
    """Return the change from the first to the second loading of each sample, its name, and what could not be compared.

    The two loadings are in one test, or in two files of one sample whose cycles are stated.
    """
    both = [test for test in cycled if test.of_kind("load", 1) and test.of_kind("load", 2)]
    pairs = [(test, test.of_kind("load", 2)[0]) for test in both]
    monotonic = [t for t in of_kind if t.history == "monotonic"]
    first = {t.sample: t for t in monotonic if t.cycle == 1}
    pairs += [(first[t.sample], t) for t in monotonic if t.cycle == 2 and t.sample in first]
    changes, names, reasons = [], [], []
    for once, twice in pairs:
        try:
            changes.append(softening_between(first_loading(once), first_loading(twice)))
            names.append(twice.sample)
        except ValueError as error:
            reasons.append(str(error))
    return changes, tuple(names), reasons


def _softening(kind: str, changes: list[float], names: tuple[str, ...]) -> MeasuredEffect:
    source = BETWEEN_SAMPLES if len(changes) > 1 else "none: one sample"
    verdict, sentence = softening_verdict(changes), softening_sentence(changes)
    return MeasuredEffect(
        effect="softening",
        test=kind,
        quantity="relative change of the stress from the first to the second loading",
        value=float(np.mean(changes)),
        interval=softening_interval(changes),
        interval_from=source,
        unit="1",
        verdict=verdict,
        sentence=sentence,
        samples=names,
        parameters={"change_by_sample": dict(zip(names, changes))},
    )


def _ogden_roxburgh(kind: str, cycled: list[MaterialTest]) -> MeasuredEffect:
    fit = fit_ogden_roxburgh(cycled)
    error = float(fit.standard_error[0])
    parameters = {
        "r": fit.r,
        "m_kPa": fit.m_MPa * 1e3,
        "beta": fit.beta,
        "standard_error": [error, float(fit.standard_error[1]) * 1e3, float(fit.standard_error[2])],
        "rms": fit.rms,
    }
    verdict = "determined" if fit.determined else "not determined"
    return MeasuredEffect(
        effect="ogden_roxburgh",
        test=kind,
        quantity="Ogden and Roxburgh's r",
        value=fit.r,
        interval=(fit.r - 1.96 * error, fit.r + 1.96 * error),
        interval_from="1.96 standard errors of the fit",
        unit="1",
        verdict=verdict,
        sentence=fit.sentence,
        samples=tuple(t.sample for t in cycled),
        parameters=parameters,
    )


def lateral_effects(tests: list[MaterialTest]) -> Found:
    """Return ln lam_2 / ln lam_1 of tests whose lateral stretch was tracked, next to that of constant volume."""
    effects, constant_volume = [], {"uniaxial": -0.5, "pure_shear": 0.0, "equibiaxial": 1.0}
    for kind, expected in constant_volume.items():
        slopes = {}
        for test in tests:
            if test.test != kind or test.stretch_2 is None:
                continue
            e1, e2 = np.log(test.stretch), np.log(test.stretch_2)
            rows = np.isfinite(e2) & (np.abs(e1) > LEAST_LATERAL_STRAIN)
            if rows.sum() > 2:
                slopes[test.sample] = float(e1[rows] @ e2[rows] / (e1[rows] @ e1[rows]))
        if len(slopes) >= LEAST_SAMPLES:
            effects.append(_lateral(kind, slopes, expected))
    return effects, [] if effects else [
        ("lateral_contraction", f"stretch_2 is tracked in fewer than {LEAST_SAMPLES} samples")
    ]


def _lateral(kind: str, slopes: dict[str, float], expected: float) -> MeasuredEffect:
    mean = mean_of(list(slopes.values()))
    low, high = mean.interval
    verdict = "negligible" if max(abs(low - expected), abs(high - expected)) < NEGLIGIBLE else "undecided"
    if not low <= expected <= high and verdict == "undecided":
        verdict = "significant departure"
    ending = {
        "negligible": f"the departure from {expected:g} of constant volume is negligible (within {NEGLIGIBLE:g})",
        "undecided": f"it is not decided whether it departs from {expected:g} of constant volume",
    }.get(verdict, f"significant departure from {expected:g}: volume changes, or the test is not {kind}")
    sentence = (
        f"The tracked lateral stretch follows ln lam_2 = {mean.value:.3f} ln lam_1 (95 % interval {low:.3f} to"
        f" {high:.3f}, {mean.count} samples): {ending}."
    )
    parameters = {"constant_volume": expected, "slope_by_sample": slopes}
    return MeasuredEffect(
        effect="lateral_contraction",
        test=kind,
        quantity="tracked ln stretch_2 over ln stretch_1",
        value=mean.value,
        interval=mean.interval,
        interval_from=BETWEEN_SAMPLES,
        unit="1",
        verdict=verdict,
        sentence=sentence,
        samples=tuple(slopes),
        parameters=parameters,
    )
