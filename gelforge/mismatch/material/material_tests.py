"""The verdict on a material's tests: what a law fitted to one loading branch leaves out of all others.

The same states, conditions and verdict.json as for a recording. Stresses stand in it as the force on 1 mm^2 of the
undeformed section, N/mm^2 = MPa, along z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.csv_table import TableError
from gelforge.files import digest, file_sha256, write_text
from gelforge.materials.readers.material_source import MaterialSource
from gelforge.mismatch.evidence.alternatives import NOTHING
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.goodness.residual_tests import both_tests
from gelforge.mismatch.inference.answer import Answer, groups_of
from gelforge.mismatch.inference.judge import LIKELY, Judgement
from gelforge.mismatch.inference.proof import after_penalty, proof_of
from gelforge.mismatch.material.contact_readings import pair_readings, press_readings
from gelforge.mismatch.material.held_out import held_pieces, patterns
from gelforge.mismatch.material.material_effects import of_stress
from gelforge.mismatch.material.material_models import fitted, posterior_of, predicted
from gelforge.mismatch.material.material_readings import Change, Readings
from gelforge.mismatch.material.stress_readings import stress_tests
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.readings.observations import COLUMNS, Observations
from gelforge.mismatch.result import verdict as v
from gelforge.mismatch.summary.findings import limits_of, verdict_of
from gelforge.mismatch.terms.holdout import Blocks
from gelforge.mismatch.terms.problem import Problem, never_solved
from gelforge.progress import stage

SEED = 20261121
DRAWS = 2000


@dataclass(frozen=True)
class Judged:
    """One verdict with its table of readings (material_readings.csv)."""

    name: str
    verdict: v.Verdict
    table: pd.DataFrame


@dataclass(frozen=True, eq=False)
class MaterialProblem(Problem):
    """Material tests beside their nominal model: forces along z, one to a row; effects have parameters of their own."""

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
            candidates.append(Candidate(change.name, change.shape, column, prior_sd, sign))
        effects = {change.name: change.effect for change in readings.changes}
        beside = observations, _along_z(base, n), readings.covariance
        return cls(*beside, candidates, effects, never_solved, {}, readings=readings)

    def change_of(self, part: Candidate | Change) -> Change:
        """Return a part's change with the plausible values of its effect, whatever scale of them had most evidence."""
        return next(c for c in self.readings.changes if (c.name, c.shape) == (part.name, part.shape))

    def effect_of(self, part: Candidate) -> Effect:
        """Return the effect of a part with the parameters that it has in this shape."""
        return self.change_of(part).effect

    def with_model_error(self, parts: Sequence[Candidate], amounts: np.ndarray) -> MaterialProblem:
        """Return the problem with the covariance that belongs to what is predicted with parts at amounts (p,)."""
        prediction = predicted(self.readings, [self.change_of(part) for part in parts], amounts)
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
    mismatch = both_tests(problem.residual, readings.covariance, atoms, rng, DRAWS)
    stage(f"{name}: effects, alone and together")
    erring = MaterialProblem.of(readings.with_form_error())
    posterior, fits = posterior_of(erring.readings)
    mode, answer, physical = next(iter(posterior.ranked()), NOTHING), None, True
    state: v.State = "unexplained"
    if mismatch.p >= v.ALARM_P:
        state = "consistent" if any(limit.seen for limit in limits_of(problem)) else "inconclusive"
    elif mode and posterior.probability[NOTHING] < LIKELY:
        stage(f"{name}: the most probable effects at their plausible values, and what they leave")
        found = fitted(erring.readings, [problem.change_of(change) for change in fits[mode].model])
        fit, left, proof = found.refitted, readings.measured - found.prediction, None
        if out.any():
            proof = after_penalty(proof_of(erring, fit, left, blocks), erring, posterior)
        nonzero = found.columns[:, found.judged.amounts != 0]
        answer = Answer(
            posterior=posterior,
            winner=posterior.sets[mode],
            fit=fit,
            refits={effects: one.refitted for effects, one in fits.items()} | {mode: fit},
            groups=groups_of(problem, posterior, fit),
            after=_along_z(found.prediction, len(left)),
            adequacy=both_tests(left, found.covariance, atoms, rng, DRAWS, nonzero),
            proof=proof,
            folds={},
        )
        sure = {group.members[0] for group in answer.sure}
        values = zip(fit.parts, fit.amounts)
        physical = all(problem.effect_of(part).in_range(a) for part, a in values if part.name in sure)
        if physical and answer.adequacy.p > v.LEFT_P:
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
    found, reasons, name = [], [], source.name
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
        found.append(Judged(title, verdict.model_copy(update={"noise": noise}), table))
    return found, reasons


def judge_sources(materials: Sequence[MaterialSource], seed: int = SEED) -> tuple[list[Judged], list[str]]:
    """Return all verdicts, and what was not judged; raises TableError where there is nothing to judge."""
    found, reasons = [], []
    for material in materials:
        judged, said = judge_material(material, seed)
        found += judged
        reasons += said
    if not found:
        raise TableError(f"no test can be judged: {'; '.join(reasons)}")
    return found, reasons


def write_judged(folder: Path, judged: Judged) -> None:
    """Write verdict.json and material_readings.csv (nominal stress [MPa], or force [N] of indentations and pairs)."""
    v.write_verdict(folder, judged.verdict)
    write_text(folder / "material_readings.csv", judged.table.to_csv(index=False, float_format="%.9g"))
