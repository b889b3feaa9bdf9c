"""Laws compared on the same curves: by information criterion and by predicting a test that was left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from gelforge.materials.fitting.curves import MeanCurve
from gelforge.materials.fitting.fit import FitError, LawFit, Problem, Undetermined, effective_points, fit_law
from gelforge.materials.fitting.identifiability import PredictionWidth, prediction_widths
from gelforge.mechanics.laws.models import FAMILIES

SAME_ERROR = 1.1  # ratio of errors of prediction that are called equal
NO_SUPPORT = (
    10.0  # difference in AICc beyond which a model has no support (Burnham & Anderson 2002, sec. 2.6)
)
# Of the nominal stress: residuals of 14 % of the curve's spread, several times the scatter of samples. Treloar's (1944)
# rubber reaches 0.9967 and more, no model reaches 0.9 of a foam (docs/results/material-fits.md).
POOR_R2 = 0.98


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
    def parameters(self) -> int:
        """Return the number of parameters."""
        return len(FAMILIES[self.name].parameters)

    @property
    def held_out_error(self) -> float:
        """Return the root mean square over the tests of the relative error of their prediction."""
        errors = list(self.held_out.values())
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")

    @property
    def describes(self) -> bool:
        """Return whether the law describes every kind of test, whatever its number of parameters."""
        return self.fit is not None and _describes(self.fit)

    @property
    def usable(self) -> bool:
        """Return whether the law is determined by the tests and Drucker-stable in their range."""
        return self.fit is not None and self.fit.unstable_from is None


@dataclass(frozen=True)
class Comparison:
    """All laws that were tried, the one chosen, and how far it is determined where nothing was tested."""

    candidates: list[Candidate]
    chosen: Candidate
    chosen_by: str  # "aicc", "held_out" or "first"
    widths: list[PredictionWidth]
    fallback: tuple[str, ...] = ()  # which models were replaced by simpler ones, and why

    @property
    def warnings(self) -> list[str]:
        """Return what a person must know of the chosen law before using it."""
        return [*self.fallback, *self.misfit, *self.identifiability, *self.chosen.fitted.notes]

    @property
    def misfit(self) -> list[str]:
        """Return which tests the chosen law does not describe."""
        poor = {kind: r2 for kind, r2 in self.chosen.fitted.r2_nominal.items() if r2 < POOR_R2}
        if not poor:
            return []
        listed = ", ".join(f"{kind} {r2:.3f}" for kind, r2 in poor.items())
        unstable = [c for c in self.candidates if c.describes and not c.usable]
        closest = min((c.fitted for c in unstable), key=lambda fit: fit.misfit, default=None)
        rejected = ""
        if closest:
            reached = ", ".join(f"{r2:.3f}" for r2 in closest.r2_nominal.values())
            rejected = f" {closest.family.title} comes closer (R2 {reached})"
            rejected += f" but is Drucker-stable only to {closest.unstable_from:.0%} of the range."
        return [
            f"DOES NOT DESCRIBE THE TESTS: R2 of the nominal stress {listed}; {POOR_R2:g} at least is expected."
            f"{rejected} All constitutive models here are elastic, isotropic and incompressible: look for samples that"
            " differ, an offset or a toe, a foam, or rates and ages in one fit, or try other models"
        ]

    @property
    def identifiability(self) -> list[str]:
        """Return where the chosen law is not determined by the tests, with the width of its prediction there."""
        tested = self.chosen.fitted.samples
        poor = [
            w for w in self.widths if len(tested) == 1 or not w.determined
        ]  # one load case never shows the others
        head = f"NOT IDENTIFIABLE from {' and '.join(tested)} alone; add the missing tests"
        return [head, *(w.text for w in poor)] if poor else []

    @property
    def reason(self) -> str:
        """Return in a sentence why the law was chosen, and whether the two criteria agree."""
        title, usable = self.chosen.fitted.family.title, [c for c in self.candidates if c.usable]
        predicted = [c for c in usable if np.isfinite(c.held_out_error)]
        lowest = min(usable, key=lambda c: c.aicc, default=self.chosen)
        best = min(predicted, key=lambda c: c.held_out_error, default=None)
        asked = " as asked" if self.chosen_by == "held_out" else ""
        held_out = f"one kind of test only, so none could be held out{asked}"
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
            elif lowest.fitted.at_bound and self.chosen.parameters < lowest.parameters:
                criterion += f", whose {', '.join(lowest.fitted.at_bound)} is 0, at its bound: the simpler model is taken"
        how = {"aicc": "", "held_out": "chosen by tests left out; ", "first": "chosen as the first named; "}
        return f"{title}: {how[self.chosen_by]}{criterion}; {held_out}"

    def table(self) -> pd.DataFrame:
        """Return one row per law."""
        lowest = min(c.aicc for c in self.candidates if c.usable)
        kinds = list(dict.fromkeys(k for c in self.candidates for k in c.held_out))
        rows = []
        for c in self.candidates:
            row = {"law": c.name, "parameters": c.parameters, "chosen": c is self.chosen}
            row["AICc difference"] = c.aicc - lowest if c.fit else np.nan
            row["misfit"] = c.fitted.misfit if c.fit else np.nan
            row |= {f"R2 {kind}": r2 for kind, r2 in (c.fit.r2_nominal.items() if c.fit else ())}
            row |= {f"error held out {kind}": c.held_out.get(kind, np.nan) for kind in kinds}
            row["error held out"] = c.held_out_error
            row["Drucker stable"] = "yes" if c.usable else f"to {c.fit.unstable_from:.0%}" if c.fit else ""
            row["remark"] = c.refused or "; ".join(c.fitted.notes)
            rows.append(row)
        return pd.DataFrame(rows)


def compare_laws(
    curves: list[MeanCurve], names: list[str], loss: str = "linear", choose: str = "aicc"
) -> Comparison:
    """Return the comparison of constitutive models by name, and which is chosen.

    A model with a parameter at its bound gives way to a simpler one that is as good, within NO_SUPPORT of AICc or
    SAME_ERROR. Where no model is determined, simpler ones of their families that describe the tests are fitted in their
    place.

    AICc = n ln(misfit^2) + 2 q + 2 q (q + 1) / (n - q - 1) with q = parameters + 1 (Hurvich & Tsai 1989), n the number of
    points that the correlated residuals of the closest model are worth.

    Parameters
    ----------
    curves : list of MeanCurve
        As `mean_curves` returns them.
    names : list of str
        Keys of FAMILIES.
    loss : str
        "linear" for least squares, "soft_l1" against outliers.
    choose : str
        "aicc": the lowest among the models that describe the tests, where any does. "held_out": the least error of
        tests left out, or AICc where there is one kind of test. "first": the first name, which must be determined.

    Returns
    -------
    Comparison
        All candidates, the chosen one, and how far it is determined where nothing was tested.

    Raises
    ------
    FitError
        Where no model is determined and stable.
    """
    if not names:
        raise FitError(f"no constitutive model is named; give some of {', '.join(FAMILIES)}")
    fits = {name: _fit_or_reason(curves, name, loss) for name in dict.fromkeys(names)}
    fallback = _simpler_fits(curves, fits, loss, choose)
    fitted = {name: fit for name, fit in fits.items() if isinstance(fit, LawFit)}
    n = _independent_points(curves, list(fitted.values())) if fitted else float("nan")
    candidates = []
    for name, fit in fits.items():
        refused = str(fit) if isinstance(fit, FitError) else ""
        aicc = float("nan") if isinstance(fit, FitError) else _aicc(n, fit)
        candidates.append(Candidate(name, fitted.get(name), refused, aicc, held_out_errors(curves, name)))
    usable = [c for c in candidates if c.usable]
    if not usable:
        reasons = "; ".join(c.refused or f"{c.name}: {', '.join(c.fitted.notes)}" for c in candidates)
        raise FitError(f"no constitutive model of {', '.join(fits)} is determined and stable: {reasons}")
    chosen = _chosen(candidates, choose, fallback)
    said = tuple(f"{new} IS FITTED IN PLACE OF {name}. {fits[name]}" for name, new in fallback.items())
    return Comparison(candidates, chosen, choose, prediction_widths(curves, chosen.fitted), said)


def _fit_or_reason(curves: list[MeanCurve], name: str, loss: str) -> LawFit | FitError:
    """Return the fit of a model, or why there is none. Raises FitError for an unknown name."""
    try:
        return fit_law(curves, name, loss)
    except FitError as error:
        if name not in FAMILIES:
            raise
        return error


def _simpler_fits(
    curves: list[MeanCurve], fits: dict[str, LawFit | FitError], loss: str, choose: str
) -> dict[str, str]:
    """Add to the fits the simpler models that stand in for undetermined ones; return their names by those replaced.

    Models are replaced where none could be chosen otherwise: the first for "first", else all where no other is determined.
    A simpler model that does not describe the tests replaces none.
    """
    names = list(fits)[:1] if choose == "first" else list(fits)
    if any(isinstance(fits[name], LawFit) for name in names):
        return {}
    replaced = {}
    for name in names:
        simpler = FAMILIES[name].simpler if isinstance(fits[name], Undetermined) else None
        while simpler is not None:
            fit = fits[simpler] if simpler in fits else _fit_or_reason(curves, simpler, loss)
            if isinstance(fit, LawFit):
                if _describes(fit):
                    fits[simpler], replaced[name] = fit, simpler
                break
            simpler = FAMILIES[simpler].simpler
    return replaced


def _chosen(candidates: list[Candidate], choose: str, fallback: dict[str, str]) -> Candidate:
    """Return the model that is taken. Raises FitError for "first" where the first is not determined and stable."""
    usable = [c for c in candidates if c.usable]
    if choose == "first":
        first = fallback.get(candidates[0].name, candidates[0].name)
        chosen = next(c for c in candidates if c.name == first)
        if not chosen.usable:
            reason = chosen.refused or ", ".join(chosen.fitted.notes)
            raise FitError(
                f"choose: first takes {chosen.name}, which is not determined and stable ({reason});"
                " name another model first, or set choose: aicc"
            )
        return chosen
    predicted = [c for c in usable if np.isfinite(c.held_out_error)]
    if choose == "held_out" and predicted:
        best = min(predicted, key=lambda c: c.held_out_error)
        limit = SAME_ERROR * best.held_out_error
        return _without_idle(best, [c for c in predicted if c.held_out_error <= limit], "held_out_error")
    described = [c for c in usable if c.describes] or usable
    best = min(described, key=lambda c: c.aicc)
    return _without_idle(best, [c for c in described if c.aicc <= best.aicc + NO_SUPPORT], "aicc")


def _without_idle(best: Candidate, similar: list[Candidate], criterion: str) -> Candidate:
    """Return the best model, or where it has parameters at their bounds the best simpler one of similar ones."""
    if not best.fitted.at_bound:
        return best
    simpler = [c for c in similar if c.parameters < best.parameters and not c.fitted.at_bound]
    return min(simpler, key=lambda c: getattr(c, criterion), default=best)


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


def _describes(fit: LawFit) -> bool:
    return min(fit.r2_nominal.values()) >= POOR_R2


def _independent_points(curves: list[MeanCurve], fits: list[LawFit]) -> float:
    closest = min(fits, key=lambda f: f.misfit)
    problem = Problem.of(curves)
    residual = problem.weight * (problem.mean - problem.points.measured_stress(closest.law))
    most = max(len(f.theta) for f in fits)
    return max(effective_points(residual, problem.curve_sizes), most + 3.0)  # AICc needs n > parameters + 2


def _aicc(n: float, fit: LawFit) -> float:
    q = len(fit.theta) + 1
    return n * np.log(max(fit.misfit, 1e-12) ** 2) + 2 * q + 2 * q * (q + 1) / (n - q - 1)
