"""Laws compared on the same curves: by information criterion and by predicting a test that was left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from gelforge.materials.fitting.curves import MeanCurve
from gelforge.materials.fitting.fit import FitError, LawFit, Problem, effective_points, fit_law
from gelforge.materials.fitting.identifiability import PredictionWidth, prediction_widths
from gelforge.mechanics.laws.models import FAMILIES

SAME_ERROR = 1.1  # ratio of errors of prediction that are called equal
POOR_R2 = 0.98  # of the nominal stress: residuals of 14 % of the curve's spread, several times the scatter of samples


@dataclass(frozen=True)
class Candidate:
    """One law: its fit, or why there is none; AICc; relative error of each test predicted from the others."""

    name: str
    fit: LawFit | None
    refused: str
    aicc: float
    held_out: dict[str, float]

    @property
    def fitted(self) -> LawFit:
        """The fit, of a law that has one. Raises FitError for a refused law, with the reason."""
        if self.fit is None:
            raise FitError(f"{self.name}: {self.refused}")
        return self.fit

    @property
    def held_out_error(self) -> float:
        """Return the root mean square over the tests of the relative error of their prediction."""
        return (
            float(np.sqrt(np.mean(np.square(list(self.held_out.values())))))
            if self.held_out
            else float("nan")
        )

    @property
    def describes(self) -> bool:
        """Return whether the law describes every kind of test, whatever its number of parameters."""
        return self.fit is not None and min(self.fit.r2_nominal.values()) >= POOR_R2

    @property
    def usable(self) -> bool:
        """Return whether the law is determined by the tests and Drucker-stable in their range."""
        return self.fit is not None and self.fit.unstable_from is None


@dataclass(frozen=True)
class Comparison:
    """All laws that were tried, the one chosen, and how far it is determined where nothing was tested."""

    candidates: list[Candidate]
    chosen: Candidate
    effective_points: float
    chosen_by: str  # "aicc", "held_out" or "first"
    widths: list[PredictionWidth]

    @property
    def warnings(self) -> list[str]:
        """Return what a person must know of the chosen law before using it."""
        return self.misfit + self.identifiability + list(self.chosen.fitted.notes)

    @property
    def misfit(self) -> list[str]:
        """Return which tests the chosen law does not describe."""
        poor = {kind: r2 for kind, r2 in self.chosen.fitted.r2_nominal.items() if r2 < POOR_R2}
        if not poor:
            return []
        listed = ", ".join(f"{kind} {r2:.3f}" for kind, r2 in poor.items())
        unstable = [c for c in self.candidates if c.describes and not c.usable]
        closest = min((c.fitted for c in unstable), key=lambda fit: fit.misfit, default=None)
        rejected = (
            f" {closest.family.title} comes closer (R2 {', '.join(f'{v:.3f}' for v in closest.r2_nominal.values())})"
            f" but is Drucker-stable only to {closest.unstable_from:.0%} of the range."
            if closest
            else ""
        )
        return [
            f"DOES NOT DESCRIBE THE TESTS: R2 of the nominal stress {listed}; {POOR_R2:g} at least is expected."
            f"{rejected} All constitutive models here are elastic, isotropic and incompressible: look for samples that"
            " differ, an offset or a toe, a foam, or rates and ages in one fit, or try other models"
        ]

    @property
    def identifiability(self) -> list[str]:
        """Return where the chosen law is not determined by the tests, with the width of its prediction there."""
        fit, found = self.chosen.fitted, []
        poor = [w for w in self.widths if not w.determined]
        poor = self.widths if len(fit.samples) == 1 else poor  # one load case never shows the others
        if poor:
            found.append(
                "NOT IDENTIFIABLE from " + " and ".join(fit.samples) + " alone; add the missing tests"
            )
            found += [w.text for w in poor]
        return found

    @property
    def reason(self) -> str:
        """Return in a sentence why the law was chosen, and whether the two criteria agree."""
        title, usable = self.chosen.fitted.family.title, [c for c in self.candidates if c.usable]
        predicted = [c for c in usable if np.isfinite(c.held_out_error)]
        lowest = min(usable, key=lambda c: c.aicc, default=self.chosen)
        best = min(predicted, key=lambda c: c.held_out_error, default=None)
        held_out = (
            f"one kind of test only, so none could be held out{' as asked' * (self.chosen_by == 'held_out')}"
        )
        if best and self.chosen.held_out_error <= SAME_ERROR * best.held_out_error:
            held_out = f"none predicts a test left out better ({self.chosen.held_out_error:.1%})"
        elif best:
            held_out = (
                f"a test left out is predicted better by {best.fitted.family.title} ({best.held_out_error:.1%} against"
                f" {self.chosen.held_out_error:.1%}): trust the chosen model only where it was tested"
            )
        criterion = f"the lowest AICc of {len(usable)} determined and stable models"
        if self.chosen is not lowest:
            difference = self.chosen.aicc - lowest.aicc
            criterion = f"its AICc is {difference:.3g} above that of {lowest.fitted.family.title}"
            if self.chosen.describes and not lowest.describes:
                worst = min(lowest.fitted.r2_nominal.values())
                criterion += f", which has fewer parameters but does not describe the tests (R2 {worst:.3f})"
        how = {"aicc": "", "held_out": "chosen by tests left out; ", "first": "chosen as the first named; "}
        return f"{title}: {how[self.chosen_by]}{criterion}; {held_out}"

    def table(self) -> pd.DataFrame:
        """Return one row per law."""
        lowest = min(c.aicc for c in self.candidates if c.usable)
        kinds = list(dict.fromkeys(k for c in self.candidates for k in c.held_out))
        rows = []
        for c in self.candidates:
            row = {"law": c.name, "parameters": len(FAMILIES[c.name].parameters), "chosen": c is self.chosen}
            row["AICc difference"] = c.aicc - lowest if c.fit else np.nan
            row["misfit"] = c.fitted.misfit if c.fit else np.nan
            row |= {f"R2 {kind}": r2 for kind, r2 in (c.fit.r2_nominal.items() if c.fit else ())}
            row |= {f"error held out {kind}": c.held_out.get(kind, np.nan) for kind in kinds}
            row["error held out"] = c.held_out_error
            row["Drucker stable"] = (
                "" if c.fit is None else "yes" if c.usable else f"to {c.fitted.unstable_from:.0%}"
            )
            row["remark"] = c.refused or "; ".join(c.fitted.notes)
            rows.append(row)
        return pd.DataFrame(rows)


def compare_laws(
    curves: list[MeanCurve], names: list[str], loss: str = "linear", choose: str = "aicc"
) -> Comparison:
    """Return the comparison of laws by name; raise FitError where none is determined and stable.

    choose: "aicc" (lowest among the laws that describe the tests, where any does: the few points that a smooth
    misfit is worth would let a straight line win over a curve), "held_out" (least error of tests left out; AICc where
    there is one kind of test only), or "first" (the first name, which must be determined).

    AICc = n ln(misfit^2) + 2 q + 2 q (q + 1) / (n - q - 1) with q = parameters + 1 (Hurvich & Tsai 1989), n the number
    of points that the correlated residuals of the closest law are worth.
    """
    if not names:
        raise FitError(f"no constitutive model is named; give some of {', '.join(FAMILIES)}")
    fits: dict[str, LawFit | FitError] = {}
    for name in dict.fromkeys(names):
        try:
            fits[name] = fit_law(curves, name, loss)
        except FitError as error:
            if name not in FAMILIES:
                raise
            fits[name] = error
    found = {name: fit for name, fit in fits.items() if isinstance(fit, LawFit)}
    n = _independent_points(curves, list(found.values())) if found else float("nan")
    candidates = []
    for name, fit in fits.items():
        refused = str(fit) if isinstance(fit, FitError) else ""
        aicc = float("nan") if isinstance(fit, FitError) else _aicc(n, fit)
        candidates.append(Candidate(name, found.get(name), refused, aicc, held_out_errors(curves, name)))
    usable = [c for c in candidates if c.usable]
    if not usable:
        reasons = "; ".join(c.refused or f"{c.name}: {', '.join(c.fitted.notes)}" for c in candidates)
        raise FitError(f"no constitutive model of {', '.join(fits)} is determined and stable: {reasons}")
    chosen = min([c for c in usable if c.describes] or usable, key=lambda c: c.aicc)
    predicted = [c for c in usable if np.isfinite(c.held_out_error)]
    if choose == "held_out" and predicted:
        chosen = min(predicted, key=lambda c: c.held_out_error)
    if choose == "first":
        chosen = candidates[0]
        if not chosen.usable:
            reason = chosen.refused or ", ".join(chosen.fitted.notes)
            raise FitError(
                f"{chosen.name} is the first constitutive model named, but it is not determined and stable: {reason}"
            )
    return Comparison(candidates, chosen, n, choose, prediction_widths(curves, chosen.fitted))


def held_out_errors(curves: list[MeanCurve], name: str) -> dict[str, float]:
    """Return by kind of test the error of its nominal stress predicted from the others, relative to its rms.

    Infinite where the law has no stress at a state of the test.
    """
    kinds, errors = list(dict.fromkeys(c.test for c in curves)), {}
    for kind in kinds if len(kinds) > 1 else ():
        problem = Problem.of([c for c in curves if c.test != kind])
        law = FAMILIES[name].law(problem.solve(FAMILIES[name]))
        held = [c for c in curves if c.test == kind]
        model = np.concatenate([c.points.measured_stress(law) for c in held])
        measured = np.concatenate([c.nominal_stress for c in held])
        error = np.sqrt(((model - measured) ** 2).sum() / (measured**2).sum())
        errors[kind] = float(error) if np.isfinite(error) else float("inf")
    return errors


def _independent_points(curves: list[MeanCurve], fits: list[LawFit]) -> float:
    closest = min(fits, key=lambda f: f.misfit)
    problem = Problem.of(curves)
    residual = problem.weight * (problem.mean - problem.points.measured_stress(closest.law))
    most = max(len(f.theta) for f in fits)
    return max(effective_points(residual, problem.curve_sizes), most + 3.0)  # AICc needs n > parameters + 2


def _aicc(n: float, fit: LawFit) -> float:
    q = len(fit.theta) + 1
    return n * np.log(max(fit.misfit, 1e-12) ** 2) + 2 * q + 2 * q * (q + 1) / (n - q - 1)
