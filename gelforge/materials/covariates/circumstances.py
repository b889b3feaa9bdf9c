"""Which tests of a material may be compared: equal in all circumstances but one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.measured_effects import MeasuredEffect
from gelforge.materials.basis.statistics import CONFIDENCE, grouped
from gelforge.materials.covariates.effects import (
    CIRCUMSTANCES,
    Circumstance,
    Effect,
    Scatter,
    effect_of,
    line_effect,
    scatter_between,
)
from gelforge.materials.covariates.relaxation import Relaxation

ALIKE_STRAIN = 0.1  # relative: strains of holds that are closer count as one


def circumstance_effects(tests: list[MaterialTest]) -> tuple[list[MeasuredEffect], list[tuple[str, str]]]:
    """Return the effects of rate, age, temperature and treatment on the first loading, and what could not be judged.

    Compared are tests of one kind that differ in one circumstance only. Ramps to a hold are not compared with
    loadings to the end: their rates are those of a few rows.
    """
    effects, not_judged = [], []
    for kind in dict.fromkeys(t.test for t in tests):
        first_loadings = [t for t in tests if t.test == kind and t.cycle in (None, 1) and _loads(t)]
        for ramps in (False, True):
            group = [t for t in first_loadings if (t.history == "relaxation") == ramps]
            keys, repeats = _keys(group), _repeats(group)
            for number, circumstance in enumerate(CIRCUMSTANCES):
                new, reasons = _judged(group, keys, number, circumstance, repeats)
                effects += new
                not_judged += [(circumstance.effect, reason) for reason in reasons]
    judged = {e.effect for e in effects} | {effect for effect, _ in not_judged}
    for circumstance in CIRCUMSTANCES[:3]:
        if circumstance.effect not in judged:
            not_judged.append((circumstance.effect, _why_not(circumstance, tests)))
    return effects, not_judged


def relaxation_by_circumstance(tests: list[MaterialTest], fits: list[Relaxation]) -> list[MeasuredEffect]:
    """Return what age, temperature and treatment do to the share of stress that is left after a common hold.

    The share is that of the stress where the hold begins, as measured: compared are holds after ramps of one rate.
    """
    effects = []
    for kind in dict.fromkeys(t.test for t in tests):
        of_kind = [(test, fit) for test, fit in zip(tests, fits) if test.test == kind]
        held_levels = _held_levels([fit for _, fit in of_kind])
        keys = [(*key, level) for key, level in zip(_keys([test for test, _ in of_kind]), held_levels)]
        for number, circumstance in enumerate(CIRCUMSTANCES[1:], start=1):
            for members in _groups(keys, number):
                group, held = zip(*(of_kind[i] for i in members))
                begin, end = common_hold(held)
                y = np.log([1 - fit.drop_between(begin, end) for fit in held])
                values = np.array([circumstance.of(test) for test in group])
                level = float(np.median([fit.stretch for fit in held]))
                share_left = f"share of stress left from {begin:.3g} to {end:.3g} s of hold"
                stretch, abscissa = (level, level), group[0].abscissa
                effect = line_effect(circumstance, values, y, stretch, abscissa, quantity=share_left)
                effects.append(_measured(circumstance.effect, kind, effect, group))
    return effects


def common_hold(held: Sequence[Relaxation]) -> tuple[float, float]:
    """Return the times [s] since the hold began that all holds contain."""
    return max(fit.hold_s[0] for fit in held), min(fit.hold_s[1] for fit in held)


def alike_groups(tests: list[MaterialTest]) -> list[list[MaterialTest]]:
    """Return the tests of one kind in groups that are equal in every circumstance, as far as it is known.

    Parameters
    ----------
    tests : list of MaterialTest
        Of any kinds.

    Returns
    -------
    list of list of MaterialTest
        Every test is in one group.
    """
    return list(grouped(((test.test, *key), test) for test, key in zip(tests, _keys(tests))).values())


def alike_holds(held: list[tuple[MaterialTest, Relaxation]]) -> list[list[tuple[MaterialTest, Relaxation]]]:
    """Return the holds of one kind of test in groups that are equal in every circumstance and in the held strain."""
    keys, levels = _keys([test for test, _ in held]), _held_levels([fit for _, fit in held])
    of_each = (((one[0].test, *key, level), one) for one, key, level in zip(held, keys, levels))
    return list(grouped(of_each).values())


def _held_levels(held: list[Relaxation]) -> list[int]:
    """Return for each hold the number of its cluster of equal strains: relaxation of a soft solid depends on strain."""
    strains = [fit.stretch - (fit.abscissa == "stretch") for fit in held]
    levels = [(np.sign(e), np.log(max(abs(e), 1e-6))) for e in strains]
    known = sorted(set(levels))
    edges = [0, *(int(b[0] != a[0] or b[1] - a[1] > ALIKE_STRAIN) for a, b in zip(known, known[1:]))]
    cluster = dict(zip(known, np.cumsum(edges).tolist()))
    return [cluster[level] for level in levels]


def _loads(test: MaterialTest) -> bool:
    if test.cauchy_difference is not None or test.test == "biaxial":
        return False
    return not test.segments or any(s.kind == "load" for s in test.segments)


def _keys(tests: list[MaterialTest]) -> list[tuple]:
    """Return for each test the numbers of its clusters of equal values, one per circumstance; None is unknown."""
    columns = []
    for circumstance in CIRCUMSTANCES:
        values = [getattr(t, circumstance.attribute) for t in tests]
        known = sorted({circumstance.scale(v) for v in values if v is not None})
        edges = [0, *(int(d > circumstance.alike) for d in np.diff(known))]
        cluster = dict(zip(known, np.cumsum(edges).tolist()))
        columns.append([None if v is None else cluster[circumstance.scale(v)] for v in values])
    return list(zip(*columns))


def _groups(keys: list[tuple], number: int) -> list[list[int]]:
    """Return the tests that are equal but in circumstance `number`, where it takes two values at least."""
    known = ((i, key) for i, key in enumerate(keys) if key[number] is not None)
    groups = grouped(((*key[:number], *key[number + 1 :]), i) for i, key in known)
    return [members for members in groups.values() if len({keys[i][number] for i in members}) > 1]


def _repeats(tests: list[MaterialTest]) -> Scatter | None:
    try:
        return scatter_between([group for group in alike_groups(tests) if len(group) > 1])
    except ValueError:
        return None


def _judged(tests, keys, number, circumstance, repeats) -> tuple[list[MeasuredEffect], list[str]]:
    effects, reasons = [], []
    for members in _groups(keys, number):
        group = [tests[i] for i in members]
        try:
            effect = effect_of(circumstance, group, repeats)
        except ValueError as error:
            reasons.append(str(error))
        else:
            effects.append(_measured(circumstance.effect, group[0].test, effect, group))
    if not effects and not reasons and len({key[number] for key in keys} - {None}) > 1:
        reasons.append(f"{circumstance.word} changes only together with other covariates; test one at a time")
    return effects, reasons


def _measured(name: str, kind: str, effect: Effect, tests: Sequence[MaterialTest]) -> MeasuredEffect:
    by_scatter = f"Student's t, {CONFIDENCE:.0%}, scatter between specimens"
    source = by_scatter if effect.interval else "none: no repeats"
    parameters = {
        "span": list(effect.span),
        "span_unit": effect.circumstance.unit,
        "slope": effect.slope,
        "slope_per": effect.circumstance.per,
        "slope_interval_95": effect.slope_interval and list(effect.slope_interval),
        "stretch": list(effect.stretch),
        "change_at_smallest_and_largest_strain": effect.at_ends and list(effect.at_ends),
        "scatter_to_explain": effect.scatter_to_explain,
    }
    quantity, samples = f"relative change of the {effect.quantity}", tuple(t.sample for t in tests)
    size = effect.change, effect.interval, source, "1"
    return MeasuredEffect(name, kind, quantity, *size, effect.verdict, effect.sentence, samples, parameters)


def _why_not(circumstance: Circumstance, tests: list[MaterialTest]) -> str:
    values = sorted({v for t in tests if (v := getattr(t, circumstance.attribute)) is not None})
    if not values:
        return f"{circumstance.word} is stated for no test"
    if len(values) == 1:
        return f"all tests at {values[0]:.3g} {circumstance.unit}; two values at least are needed"
    return (
        f"{circumstance.word} of tests that may be compared is alike (all between {values[0]:.3g} and {values[-1]:.3g}"
        f" {circumstance.unit})"
    )
