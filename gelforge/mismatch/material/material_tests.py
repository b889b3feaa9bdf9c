"""The verdict on a material's tests: what a law fitted to one loading branch leaves out of all others.

The same states, conditions and verdict.json as for a recording. Stresses stand in it as the force on 1 mm^2 of the
undeformed section, N/mm^2 = MPa, along z.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import scipy

import gelforge
from gelforge.csv_table import TableError
from gelforge.files import digest, file_sha256, write_text
from gelforge.materials.readers.material_source import MaterialSource
from gelforge.mismatch.material.contact_readings import ContactTest, pair_readings, press_readings
from gelforge.mismatch.material.material_effects import stress_candidates
from gelforge.mismatch.material.material_evidence import fitted, what_remains
from gelforge.mismatch.material.material_readings import StressTests, stress_tests
from gelforge.mismatch.material.material_search import chosen_steps, on_everything, patterns, with_pieces
from gelforge.mismatch.material.material_words import (
    effect_entries,
    experiment_entries,
    fit_entry,
    group_entry,
    limit_entries,
    noise_entry,
    not_entering,
    pattern_words,
    readings_table,
    sentence_of,
    where_entries,
)
from gelforge.mismatch.result import verdict as v
from gelforge.progress import stage

SEED = 20261121
DRAWS = 2000
LEAST_ODDS = 10.0  # of an effect over what these tests cannot distinguish from it, where one of them is named


@dataclass(frozen=True)
class Judged:
    """One verdict with its table of readings (material_readings.csv)."""

    name: str
    verdict: v.Verdict
    table: pd.DataFrame


def judge_material(source: MaterialSource, seed: int = SEED) -> tuple[list[Judged], list[str]]:
    """Return the verdicts on a material: one on its stress tests, one per indentation and pair; and what was not judged."""
    found, reasons = [], []
    sources = {p.name: file_sha256(p) for p in source.files}
    if source.tests:
        try:
            tests = stress_tests(list(source.tests))
        except ValueError as error:
            reasons.append(f"{source.name}: {error}")
        else:
            found.append(_judged(f"{source.name}", _of_stress(tests), "", sources, source.synthetic, seed))
    contacts = [
        (press.test.sample, partial(press_readings, press.test), "press") for press in source.small.presses
    ]
    contacts += [(pair.sample, partial(pair_readings, pair), "pair") for pair in source.small.force_pairs]
    for sample, read, word in contacts:
        try:
            test = read()
        except ValueError as error:
            reasons.append(f"{sample}: {error}")
            continue
        found.append(_judged(f"{source.name}-{sample}", test, word, sources, source.synthetic, seed))
    return found, reasons


def _of_stress(tests: StressTests) -> ContactTest:
    candidates, cannot = stress_candidates(tests)
    readings = tests.readings
    readings = replace(readings, cannot_know=(*readings.cannot_know, *cannot, _scatter_words(tests)))
    return ContactTest(readings, tuple(candidates), tests.base_words, "stretch")


def _scatter_words(tests: StressTests) -> str:
    return (
        f"specimens made alike are taken to scatter by {tests.sample_scatter:.1%} in stress: a factor of that size between"
        " specimens, and an offset or a gain of a single test's force, cannot be distinguished from it and are no"
        " physics here"
    )


def _judged(name, test: ContactTest, word, sources, synthetic, seed) -> Judged:
    rng = np.random.default_rng(seed)
    readings, held = with_pieces(test.readings, rng)
    everything = np.ones(len(readings.measured), dtype=bool)
    atoms = patterns(readings)
    stage(f"{name}: a constitutive model, and what it leaves")
    base = fitted(readings, (), everything)
    total, where = what_remains(readings, base, atoms, rng, DRAWS)
    differs = min(total.p, where.p) < v.ALARM_P
    train = ~readings.table["piece"].isin(held).to_numpy()
    readings = readings.with_form_error()
    stage(f"{name}: effects, one after the other")
    steps = chosen_steps(readings, test.candidates, train, differs)
    accepted = steps[:-1]
    stage(f"{name}: the chosen effects on all readings, and what they leave")
    final = on_everything(readings, test.candidates, steps[-1].before.model)
    left = what_remains(readings, final, atoms, rng, DRAWS) if final else None
    fit = fit_entry(readings, base, final, steps, train, held)
    groups = [group_entry(readings, s, test.no_signature) for s in accepted]
    stage(f"{name}: detection limits")
    limits = limit_entries(readings, test.candidates)
    effects = effect_entries(readings, test, steps, accepted, final, groups)
    adequacy = None
    if left:
        adequacy = v.Adequacy(p=left[0].p, scan_p=left[1].p, remains=pattern_words(left[1].best))
    further = steps[-1].unconfirmed if accepted else []
    state = _state(differs, groups, effects, fit, adequacy, limits, further)
    answer = [] if state in ("consistent", "inconclusive") else groups
    nothing = steps[0].probabilities(test.no_signature)["null"] if steps[0].tried else 1.0
    after = final.prediction if answer and final else None
    unit = "MPa" if test.at_unit == "stretch" else "N"
    content = v.Verdict(
        title=f"{name}: {word or 'stress tests'} against {test.base_words}",
        synthetic=synthetic,
        state=state,
        sentence=sentence_of(name, test, state, answer, fit, adequacy, where, limits, final, unit, further),
        mismatch=v.Mismatch(chi2=total.chi2, degrees=total.degrees, p=total.p, scan_p=where.p),
        where=where_entries(where) if differs else [],
        answer=answer,
        effects=effects,
        null_probability=nothing,
        fit=fit if answer else fit.model_copy(update={"after": None}),
        adequacy=adequacy if answer else None,
        detection_limits=limits,
        noise=noise_entry(readings),
        next_experiments=experiment_entries(state, answer, limits, further),
        cannot_know=list(readings.cannot_know) + not_entering(test),
        provenance=v.Provenance(
            sessions=sources,
            base=test.base_words + ("; stresses are forces on 1 mm2 of undeformed section" if unit == "MPa" else ""),
            base_sha256=digest([round(float(x), 12) for x in readings.base]),
            seed=seed,
            draws=DRAWS,
            versions={
                "gelforge": gelforge.__version__, "numpy": np.__version__, "scipy": scipy.__version__,
                "python": platform.python_version(),
            },
        ),
    )  # fmt: skip
    return Judged(name, content, readings_table(readings, after, held))


def _state(differs, groups, effects, fit: v.Fit, adequacy, limits, further) -> v.State:
    """Return the state; further: effects with evidence that were not taken, so the answer is not the whole of it."""
    if not differs:
        return "consistent" if any(limit.seen for limit in limits) else "inconclusive"
    if not groups:
        return "unexplained"
    by_name = {e.name: e for e in effects}
    sound = (
        all(g.probability >= v.SURE for g in groups)
        and all(by_name[g.members[0]].in_range for g in groups)
        and adequacy is not None
        and adequacy.passed
        and fit.held_out is not None
        and fit.held_out.gain > v.HELD_OUT_ERRORS * fit.held_out.standard_error
        and not further
    )
    if not sound:
        return "unexplained"
    leading = [g.shares[g.members[0]] for g in groups]
    return "identified" if min(leading) >= LEAST_ODDS / (1 + LEAST_ODDS) else "ambiguous"


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
