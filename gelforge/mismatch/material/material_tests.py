"""The verdict on a material's tests: what a law fitted to one loading branch leaves out of all others.

The same states, conditions and verdict.json as for a recording. Stresses stand in it as the force on 1 mm^2 of the
undeformed section, N/mm^2 = MPa, along z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.csv_table import TableError
from gelforge.files import digest, file_sha256, write_text
from gelforge.materials.readers.material_source import MaterialSource
from gelforge.mismatch.evidence.alternatives import NOTHING
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.goodness.scan import Atoms, GlobalTest, Scan, global_test, scan
from gelforge.mismatch.material import material_words as words
from gelforge.mismatch.material.contact_readings import pair_readings, press_readings
from gelforge.mismatch.material.held_out import held_out_entry, patterns, pieces_of
from gelforge.mismatch.material.material_effects import of_stress
from gelforge.mismatch.material.material_models import Fitted, Tests, fitted, posterior_of
from gelforge.mismatch.material.stress_readings import stress_tests
from gelforge.mismatch.result import verdict as v
from gelforge.progress import stage

SEED = 20261121
DRAWS = 2000
LIKELY = 0.5


@dataclass(frozen=True)
class Judged:
    """One verdict with its table of readings (material_readings.csv)."""

    name: str
    verdict: v.Verdict
    table: pd.DataFrame


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
            read_tests = read()
        except ValueError as error:
            reasons.append(f"{sample}: {error}")
            continue
        found.append(_judged(title, read_tests, kind, sources, source.synthetic, seed))
    return found, reasons


def _judged(name: str, tests: Tests, kind: str, sources, synthetic: bool, seed: int) -> Judged:
    rng, readings = np.random.default_rng(seed), tests.readings
    pieces, atoms = pieces_of(readings.table, rng), patterns(readings)
    stage(f"{name}: what the nominal model leaves")
    residual, covariance = readings.measured - readings.base, readings.covariance
    total, where = _tests_of(residual, covariance, atoms, rng)
    differs = min(total.p, where.p) < v.ALARM_P
    stage(f"{name}: effects, alone and together")
    erring = readings.with_form_error()
    posterior, fits = posterior_of(erring, tests.changes)
    mode = next(iter(posterior.ranked()), NOTHING)
    answer, adequacy, after, held_out = None, None, None, None
    if differs and mode and posterior.probability[NOTHING] < LIKELY:
        stage(f"{name}: the most probable effects at their plausible values, and what they leave")
        answer = fitted(erring, [_own(tests, change) for change in fits[mode].model])
        left = readings.measured - answer.prediction
        test, remains = _tests_of(left, answer.covariance, atoms, rng, answer)
        adequacy = v.Adequacy(p=test.p, scan_p=remains.p, remains=words.pattern_words(remains.best))
        after = _score(left, answer.covariance)
        if len(pieces.held) >= 2:
            held_out = held_out_entry(erring, answer, [*fits.values()], pieces)
    groups = words.group_entries(posterior, mode) if answer else []
    effects = words.effect_entries(tests, posterior, fits, mode, answer)
    limits = words.limit_entries(tests)
    state = _state(differs, groups, {e.name: e.in_range for e in effects}, adequacy, limits)
    base = tests.base_words + "; stresses are forces on 1 mm2 of undeformed section" * (tests.unit == "MPa")
    verdict = v.Verdict(
        title=f"{name}: {kind} against {tests.base_words}",
        synthetic=synthetic,
        state=state,
        sentence="-",
        mismatch=v.Mismatch(chi2=total.chi2, degrees=total.degrees, p=total.p, scan_p=where.p),
        where=_where(where) if differs else [],
        answer=groups,
        effects=effects,
        null_probability=posterior.probability[NOTHING],
        fit=v.Fit(before=_score(residual, covariance), after=after, held_out=held_out),
        adequacy=adequacy,
        detection_limits=limits,
        noise=words.noise_entry(readings),
        next_experiments=words.experiment_entries(state, groups, limits),
        cannot_know=list(readings.cannot_know),
        provenance=v.Provenance(
            sessions=sources,
            base=base,
            base_sha256=digest([round(float(x), 12) for x in readings.base]),
            seed=seed,
            draws=DRAWS,
            versions=v.versions(),
        ),
    )
    sentence = words.sentence_of(name, tests, verdict, where.best.name)
    table = words.readings_table(readings, answer.prediction if answer else None, pieces.of_row, pieces.held)
    return Judged(name, verdict.model_copy(update={"sentence": sentence}), table)


def _own(tests: Tests, change):
    """Return a change with the plausible values that its effect has, whatever scale of them had most evidence."""
    return next(one for one in tests.changes if (one.name, one.shape) == (change.name, change.shape))


def _tests_of(
    left: np.ndarray,
    covariance: Covariance,
    atoms: Atoms,
    rng: np.random.Generator,
    fit: Fitted | None = None,
) -> tuple[GlobalTest, Scan]:
    """Return the global test of what is left (n,), and the scan over atoms, what was fitted taken out."""
    columns = None if fit is None else fit.columns[:, fit.judged.amounts != 0]
    found = scan(covariance.whiten(left), atoms.whitened(covariance, columns), rng, DRAWS)
    return global_test(left, covariance, columns), found


def _score(left: np.ndarray, covariance: Covariance) -> v.Score:
    axis = pd.DataFrame({"axis": np.full(len(left), 2)})
    return v.score(axis, left, np.ones(len(left), bool), covariance.log_density(left))


def _where(found: Scan) -> list[v.Where]:
    """Return the three strongest patterns of a scan."""
    return [
        v.Where(
            words=words.pattern_words(one),
            channel="nominal stress or force",
            snr=one.snr,
            p=None if k else found.p,
        )
        for k, one in enumerate(found.ranked[:3])
    ]


def _state(differs: bool, groups, in_range, adequacy, limits) -> v.State:
    if not differs:
        return "consistent" if any(limit.seen for limit in limits) else "inconclusive"
    sure = [group for group in groups if group.probability >= v.SURE]
    if adequacy is None or not adequacy.passed or not all(in_range[group.members[0]] for group in sure):
        return "unexplained"
    return "identified" if sure else "ambiguous"


def write_judged(folder: Path, judged: Judged) -> None:
    """Write verdict.json and material_readings.csv (nominal stress [MPa], or force [N] of indentations and pairs)."""
    v.write_verdict(folder, judged.verdict)
    write_text(folder / "material_readings.csv", judged.table.to_csv(index=False, float_format="%.9g"))


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
