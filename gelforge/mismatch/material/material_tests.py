"""The verdict on a material's tests: what a law fitted to one loading branch leaves out of all others.

The same states, conditions and verdict.json as for a recording. Stresses stand in it as the force on 1 mm^2 of the
undeformed section, N/mm^2 = MPa, along z.

Every change alone is fitted at its most probable values, and is linear from there on: all sets are weighed by these linear
changes. A set is then fitted with its changes as they are, and its evidence is that of the linear model about the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from gelforge.csv_table import TableError
from gelforge.files import digest, file_sha256, write_text
from gelforge.materials.readers.material_source import MaterialSource
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import NOTHING
from gelforge.mismatch.evidence.identifiability import indistinguishable
from gelforge.mismatch.evidence.problem import Problem, never_solved, secant
from gelforge.mismatch.evidence.refit import Refitted
from gelforge.mismatch.evidence.screen import Candidate, Screened, Term, judged_by, terms_of
from gelforge.mismatch.inference.holdout import Blocks, after_penalty, proof_of
from gelforge.mismatch.inference.judge import Answer, Judgement, groups_of
from gelforge.mismatch.inference.linear import Linear
from gelforge.mismatch.inference.posterior import Effects, Posterior, set_tables
from gelforge.mismatch.inference.scan import DRAWS, residual_tests
from gelforge.mismatch.material.contact_readings import pair_readings, press_readings
from gelforge.mismatch.material.material_effects import of_stress
from gelforge.mismatch.material.material_readings import Change, Dense, Readings, held_pieces, patterns
from gelforge.mismatch.material.stress_readings import stress_tests
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.readings.observations import COLUMNS, Observations
from gelforge.mismatch.result import verdict as v
from gelforge.mismatch.summary.findings import limits_of, verdict_of
from gelforge.mismatch.thresholds import ALARM_P, LEFT_P
from gelforge.progress import stage, tracked

# In which effects apply: the material first and the sensor last.
ORDER = (
    *("viscoelastic", "adhesion", "mullins", "ageing", "temperature"),
    *("force_gain", "force_offset", "force_drift", "force_hysteresis", "clock_offset"),
)
SEED = 20261121  # any number: two runs say the same


@dataclass(frozen=True, eq=False)
class Fitted:
    """Changes at their most probable values."""

    model: tuple[Change, ...]  # in the order in which they apply
    prediction: np.ndarray  # (n,)
    covariance: Covariance  # of measured less prediction
    judged: Screened  # the linear model about these values; columns of its parts: the Jacobian (n, p)
    log_evidence: float

    @property
    def columns(self) -> np.ndarray:
        """Return the Jacobian (n, p) of all values."""
        return np.column_stack([part.columns for part in self.judged.parts])

    @property
    def prior_sd(self) -> np.ndarray:
        """Return the standard deviations of the priors (p,) of all values."""
        return np.concatenate([part.prior_sd for part in self.judged.parts])

    @property
    def refitted(self) -> Refitted:
        """Return the same as a fit of the judge."""
        j, theta = self.judged, tuple(a for _, a in self.judged.terms)
        return Refitted(j.parts, theta, self.columns, j.covariance, self.prior_sd, j.log_bayes_factor, True)


def slices(model: Sequence[Change]) -> list[slice]:
    """Return where the values of each change are among those of a model."""
    ends = np.cumsum([0, *(len(change.parameters) for change in model)]).tolist()
    return [slice(a, b) for a, b in zip(ends, ends[1:])]


def predicted(readings: Readings, model: Sequence[Change], theta: np.ndarray) -> np.ndarray:
    """Return the prediction (n,) of a model; all of it acts on the material before the plates let go of it."""
    stress = readings.base
    for change, entries in zip(model, slices(model)):
        stress = change.apply(stress, theta[entries])
    if readings.pushed is None:
        return stress
    return np.where(readings.pushed, np.maximum(stress, np.minimum(readings.base, 0.0)), stress)


def fitted(readings: Readings, changes: Sequence[Change]) -> Fitted:
    """Return changes fitted to all readings."""
    model = tuple(sorted(changes, key=lambda change: ORDER.index(change.name)))
    parameters = [p for change in model for p in change.parameters]
    prior_sd, signs = np.array([p.width for p in parameters]), np.array([p.sign for p in parameters])
    bounds = np.array([p.bounds for p in parameters]).T / prior_sd
    u = np.where(bounds[1] <= 0, -0.1, np.clip(0.1, *bounds))  # values in units of their widths
    # First every row by its own deviation, then with the correlations that belong to the prediction so far.
    C: Covariance = Dense(np.diag(readings.covariance.variance))
    for _ in range(3):
        u = _most_probable(readings, model, C, u, prior_sd, bounds)
        prediction = predicted(readings, model, u * prior_sd)
        C = readings.covariance_of(prediction)
    steps = 1e-4 * np.diag(prior_sd)
    moved = [predicted(readings, model, u * prior_sd + step) - prediction for step in steps]
    J = np.column_stack(moved) / steps.sum(axis=0)
    left = readings.measured - prediction + J @ (u * prior_sd)
    white = C.whiten(np.column_stack([left, J]))
    parts = [
        Candidate(c.name, c.hyperparameters, J[:, s], prior_sd[s], signs[s])
        for c, s in zip(model, slices(model))
    ]
    judged = judged_by(white[:, 0], parts, [white[:, 1:][:, s] for s in slices(model)])
    evidence = C.log_density_of_white(white[:, 0]) + judged.log_bayes_factor
    at_fit = replace(judged, theta=u * prior_sd, change=prediction - readings.base)
    return Fitted(model, prediction, C, at_fit, evidence)


def _most_probable(readings, model, covariance, start, prior_sd, bounds) -> np.ndarray:
    """Return the values (p,) in units of their widths, so that no unit decides where the search ends."""

    def residual(u):
        return np.r_[covariance.whiten(readings.measured - predicted(readings, model, u * prior_sd)), u]

    low, high = bounds
    inside = np.clip(start, low + 1e-6, high - 1e-6)
    u = least_squares(residual, inside, bounds=bounds, xtol=1e-8, ftol=1e-8, gtol=1e-8, max_nfev=100).x
    # nearer to 0 a signed value counts as absent
    return np.where((np.abs(u) < 1e-3) & ((low == 0) | (high == 0)), 0.0, u)


def posterior_of(readings: Readings) -> tuple[Posterior, dict[Effects, Fitted]]:
    """Return how probable sets of effects are by all readings, and each set as it was fitted."""
    changes = readings.changes
    if not changes:
        return Posterior({}, {}, {}, {}, 0, {}), {}
    residual, covariance = readings.measured - readings.base, readings.covariance
    nothing = covariance.log_density(residual)
    alone = [
        fitted(readings, (change,)) for change in tracked(changes, "effects and their hyperparameters fitted")
    ]
    linear = Linear.of(residual, covariance, [_through(fit).parts[0] for fit in alone])
    fits: dict[Effects, Fitted] = {}
    sets: dict[Effects, Screened] = {}
    for one in tracked(set_tables(linear), "sets of effects fitted"):
        fit = fitted(readings, [changes[k].scaled(s) for k, s in zip(one.number, one.scale)])
        best = linear.log_bayes_factors(one.number[None], one.scale[None])[0]
        # Other hyperparameters and scales are taken to gain what the best ones gain by the fit.
        gained = fit.log_evidence - nothing - best
        fits[one.effects] = fit
        sets[one.effects] = replace(_through(fit), log_bayes_factor=float(one.average + gained))
    singles = {name: one for (name, *others), one in sets.items() if not others}
    evidence = {effects: one.log_bayes_factor for effects, one in sets.items()}
    return Posterior(sets, singles, evidence, {}, len(singles), indistinguishable(covariance, singles)), fits


def _through(fit: Fitted) -> Screened:
    """Return what was fitted as a linear change that meets the fit."""
    judged, theta = fit.judged, fit.judged.theta
    if not theta.any():
        return judged
    columns = secant(fit.columns, judged.change - fit.columns @ theta, theta, fit.prior_sd)
    by_part = terms_of(judged.parts, columns.T)
    return replace(judged, parts=tuple(replace(part, columns=own.T) for part, own in by_part))


@dataclass(frozen=True)
class Judged:
    """One verdict with its table of readings (material_readings.csv)."""

    name: str
    verdict: v.Verdict
    table: pd.DataFrame


@dataclass(frozen=True, eq=False)
class MaterialProblem(Problem):
    """Material tests next to their nominal model: forces along z, one to a row; effects have parameters of their own."""

    readings: Readings = field(kw_only=True)

    @classmethod
    def of(cls, readings: Readings) -> MaterialProblem:
        """Return the problem of readings, in which changes are linear in their first parameter."""
        table, n = readings.table, len(readings.table)
        rows = pd.DataFrame(dict.fromkeys(COLUMNS, np.nan), index=range(n)).assign(
            session=table["sample"], press=table["part"].astype(str), phase=table["branch"], site=0
        )
        observations = Observations(
            rows,
            _along_z(readings.measured, n),
            np.zeros((1, 2)),
            _along_z(readings.noise, n),
            _along_z(readings.zero, n),
            np.zeros(n),
            np.zeros(n),
            cannot_know=readings.cannot_know,
        )
        candidates, base = [], readings.base
        for change in readings.changes:
            first = change.parameters[0]
            step = 0.1 * first.width * np.eye(len(change.parameters))[0]
            column = (change.apply(base, step) - base)[:, None] / step[0]
            prior_sd, sign = np.array([first.width]), np.array([first.sign])
            candidates.append(Candidate(change.name, change.hyperparameters, column, prior_sd, sign))
        effects = {change.name: change.effect for change in readings.changes}
        forces, covariance = _along_z(base, n), readings.covariance
        return cls(observations, forces, covariance, candidates, effects, never_solved, {}, readings=readings)

    def change_of(self, part: Candidate | Change) -> Change:
        """Return a part's change with the plausible values of its effect, whatever scale of them had most evidence."""
        wanted = part.name, part.hyperparameters
        return next(c for c in self.readings.changes if (c.name, c.hyperparameters) == wanted)

    def effect_of(self, part: Candidate) -> Effect:
        """Return the effect of a part with the parameters that it has at these hyperparameters."""
        return self.change_of(part).effect

    def with_model_error(self, terms: Sequence[Term]) -> MaterialProblem:
        """Return the problem with the covariance that belongs to what is predicted with effects at their values."""
        model, theta = [self.change_of(part) for part, _ in terms], [a for _, a in terms]
        prediction = predicted(self.readings, model, np.concatenate(theta))
        return replace(self, covariance=self.readings.covariance_of(prediction))


def _along_z(values: np.ndarray | float, n: int) -> np.ndarray:
    return np.where([False, False, True], np.broadcast_to(values, n)[:, None], np.nan)


def judge_tests(name: str, readings: Readings, seed: int) -> tuple[MaterialProblem, Judgement, pd.DataFrame]:
    """Return material tests as a problem, the judgement on it, and the rows of material_readings.csv."""
    rng, problem = np.random.default_rng(seed), MaterialProblem.of(readings)
    held, atoms = held_pieces(readings.table, rng), patterns(readings)
    out = (held != "no").to_numpy()
    blocks = Blocks(~out, {f"held out: {', '.join(pd.unique(held[out]))}": out})
    stage(f"{name}: what the nominal model leaves")
    mismatch = residual_tests(problem, problem.residual, DRAWS, rng, atoms=atoms)
    stage(f"{name}: effects, alone and together")
    erring = MaterialProblem.of(readings.with_form_error())
    posterior, fits = posterior_of(erring.readings)
    mode, answer, physical = next(iter(posterior.ranked()), NOTHING), None, True
    state: v.State = "unexplained"
    if mismatch.p >= ALARM_P:
        state = "consistent" if any(limit.seen for limit in limits_of(problem)) else "inconclusive"
    elif mode and posterior.probability[NOTHING] < 0.5:
        stage(f"{name}: the most probable effects at their plausible values, and what they leave")
        fit_of_mode = fitted(erring.readings, [problem.change_of(change) for change in fits[mode].model])
        fit, left, proof = fit_of_mode.refitted, readings.measured - fit_of_mode.prediction, None
        if out.any():
            proof = after_penalty(proof_of(erring, fit, left, blocks), erring, posterior, blocks.train)
        nonzero = fit_of_mode.columns[:, fit_of_mode.judged.theta != 0]
        uncertain = replace(problem, covariance=fit_of_mode.covariance)
        answer = Answer(
            fit=fit,
            refits={effects: one.refitted for effects, one in fits.items()} | {mode: fit},
            groups=groups_of(problem, posterior, fit),
            after=_along_z(fit_of_mode.prediction, len(left)),
            adequacy=residual_tests(uncertain, left, DRAWS, rng, nonzero, atoms),
            proof=proof,
            folds=(),
        )
        sure = {group.members[0] for group in answer.sure}
        physical = all(problem.effect_of(part).in_range(a) for part, a in fit.terms if part.name in sure)
        if physical and answer.adequacy.p > LEFT_P:
            state = "identified" if sure else "ambiguous"
    table = readings.table[["sample", "test", "part", "branch", "at", "time_s"]].assign(
        measured=readings.measured,
        base=readings.base,
        after=np.nan if answer is None else answer.after[:, 2],
        sigma=readings.covariance.standard_deviation,
        held_out=held,
    )
    return problem, Judgement(state, blocks, mismatch, posterior, answer, None, (), not physical), table


def judge_material(source: MaterialSource, seed: int = SEED) -> tuple[list[Judged], list[str]]:
    """Return the verdicts on a material: one on its stress tests, one per indentation and pair; and what was not judged."""
    verdicts, reasons, name = [], [], source.name
    tests = list(source.tests)
    tried = [(name, "stress tests", name, lambda: of_stress(stress_tests(tests)))] if tests else []
    for press in source.small.presses:
        sample = press.test.sample
        tried.append((f"{name}-{sample}", "press", sample, partial(press_readings, press.test)))
    for pair in source.small.force_pairs:
        tried.append((f"{name}-{pair.sample}", "pair", pair.sample, partial(pair_readings, pair)))
    sources = {p.name: file_sha256(p) for p in source.files}
    for title, kind, sample, read in tried:
        try:
            readings = read()
        except ValueError as error:
            reasons.append(f"{sample}: {error}")
            continue
        problem, judgement, table = judge_tests(title, readings, seed)
        provenance = v.Provenance(
            sessions=sources,
            base=readings.words,
            base_sha256=digest([round(float(x), 12) for x in readings.base]),
            seed=seed,
            draws=DRAWS,
            versions=v.versions(),
        )
        against = f"{title}: {kind} against {readings.words.partition(';')[0]}"
        verdict = verdict_of(problem, judgement, against, source.synthetic, None, provenance)
        law_N = [None, None, float(np.sqrt(np.mean(readings.law**2)))]
        noise = verdict.noise.model_copy(update={"law_N": law_N})
        verdicts.append(Judged(title, verdict.model_copy(update={"noise": noise}), table))
    return verdicts, reasons


def judge_sources(materials: Sequence[MaterialSource], seed: int = SEED) -> tuple[list[Judged], list[str]]:
    """Return all verdicts, and what was not judged.

    Parameters
    ----------
    materials : sequence of MaterialSource
        Their tests.
    seed : int
        Of random draws.

    Returns
    -------
    list of Judged
        At least one.
    list of str
        What was not judged, and why.

    Raises
    ------
    TableError
        Where there is nothing to judge.
    """
    verdicts, reasons = [], []
    for material in materials:
        judged, said = judge_material(material, seed)
        verdicts += judged
        reasons += said
    if not verdicts:
        raise TableError(f"no test can be judged: {'; '.join(reasons)}")
    return verdicts, reasons


def write_judged(folder: Path, judged: Judged) -> None:
    """Write verdict.json and material_readings.csv (nominal stress [MPa], or force [N] of indentations and pairs).

    Parameters
    ----------
    folder : Path
        Receives both files.
    judged : Judged
        As of `judge_sources`.
    """
    v.write_verdict(folder, judged.verdict)
    write_text(folder / "material_readings.csv", judged.table.to_csv(index=False, float_format="%.9g"))
