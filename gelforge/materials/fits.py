"""What the tests of a material determine: fitted laws and sizes of effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.config import Fitting
from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.measured_effects import MeasuredEffects
from gelforge.materials.basis.statistics import grouped
from gelforge.materials.covariates.circumstances import circumstance_effects
from gelforge.materials.covariates.effects import CIRCUMSTANCES
from gelforge.materials.covariates.history_effects import cycle_effects, lateral_effects, relaxation_effects
from gelforge.materials.fitting.choice import Comparison, compare_laws
from gelforge.materials.fitting.curves import MeanCurve, mean_curves, monotonic_loading
from gelforge.materials.fitting.fit import FitError
from gelforge.materials.fitting.sample_scatter import scatter
from gelforge.materials.readers.material_source import MaterialSource
from gelforge.materials.small_tests.small_effects import small_effects

CIRCUMSTANCE_NAMES = {c.effect for c in CIRCUMSTANCES}
FITTED_SHARE = 0.8  # of the largest strain of any sample; a range fitted below that is worth a note


@dataclass(frozen=True)
class Fits:
    """What the tests of a material determine: fitted laws side by side, and sizes of effects."""

    tests: list[MaterialTest]  # their loading
    curves: list[MeanCurve]
    comparison: Comparison | None  # None: no test that a law can be fitted to
    effects: MeasuredEffects
    notes: tuple[str, ...]


def fits_of(source: MaterialSource, fitting: Fitting, law_needed: bool = True) -> Fits:
    """Return the fits of a material and what its tests measure; nothing is written.

    Parameters
    ----------
    source, fitting
        As of `characterise_source`.
    law_needed : bool
        Refuse tests to which no law can be fitted; otherwise the comparison is None then.

    Returns
    -------
    Fits
        Loadings, mean curves, comparison of the laws, effects and notes.

    Raises
    ------
    FitError
        Where a law is needed and no test can be fitted, or a fit fails.
    """
    tests, notes = monotonic_loading(list(source.tests))
    notes = _gathered(
        [*notes, *(f"{t.test} {t.sample}: {text}" for t in source.tests for text in t.findings)]
        + [f"{t.sample}: {text}" for t in source.small.contacts for text in t.findings]
    )
    if not tests and law_needed:
        raise FitError(
            f"{source.name}: no loading to fit a constitutive model to; {'; '.join(notes) or 'add samples.csv'}"
        )
    curves, comparison = mean_curves(tests), None
    if tests:
        try:
            comparison = compare_laws(curves, fitting.laws, fitting.loss, fitting.choose)
        except FitError as error:
            raise FitError(f"{source.name}: {error}") from None
        notes += [text for curve in curves for text in scatter(curve, comparison.chosen.fitted.law)]
    effects = measured_effects(source)
    notes += _cut_short(tests, curves)
    notes += _averaged(tests, effects)
    return Fits(tests, curves, comparison, effects, tuple(notes))


def measured_effects(source: MaterialSource) -> MeasuredEffects:
    """Return what the tests of a material say about each effect, and why others could not be judged."""
    tests, measured, not_judged = list(source.tests), [], []
    of_tests = (circumstance_effects, relaxation_effects, cycle_effects, lateral_effects)
    judged = [judge(tests) for judge in of_tests] if tests else []
    for effects, reasons in [*judged, small_effects(source.small)]:
        measured += effects
        not_judged += reasons
    return MeasuredEffects(source.name, tuple(measured), tuple(dict.fromkeys(not_judged)))


def _gathered(notes: list[str]) -> list[str]:
    """Return notes ("test sample: text") with those of one text made into one."""
    parts = (note.partition(": ") for note in notes)
    return [f"{', '.join(names)}: {text}" for text, names in grouped((p[2], p[0]) for p in parts).items()]


def _cut_short(tests: list[MaterialTest], curves: list[MeanCurve]) -> list[str]:
    """Return where samples went much further than the range that all of them reached, which alone is fitted."""
    said = []
    for curve in (c for c in curves if c.component == "1" and c.test != "biaxial"):
        same_test = [t for t in tests if t.test == curve.test]
        rest = same_test[0].at_rest
        reached = max(np.abs(t.stretch - rest).max() for t in same_test)
        fitted = np.abs(curve.stretch - rest).max()
        if fitted < FITTED_SHARE * reached:
            low, high = curve.stretch[[0, -1]]
            said.append(
                f"{curve.test}: fitted between {same_test[0].abscissa} {low:.3g} and {high:.3g}, where all {len(same_test)}"
                f" samples were measured; single ones reach a strain of {reached:.3g}: give samples of other ranges a"
                " material of their own to use the rest"
            )
    return said


def _averaged(tests: list[MaterialTest], effects: MeasuredEffects) -> list[str]:
    """Return which significant influences the fitted law averages over."""
    kinds = {t.test for t in tests}
    return [
        f"the constitutive model averages over the tests' {e.effect.replace('_', ' ')}, whose influence is significant:"
        f" {e.sentence}"
        for e in effects.effects
        if e.effect in CIRCUMSTANCE_NAMES and e.verdict.startswith("significant s") and e.test in kinds
    ]
