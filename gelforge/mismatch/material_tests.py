"""The verdict on a material's tests: what a law fitted to one loading branch leaves out of all others.

The same states, conditions and verdict.json as for a recording. Stresses stand in it as the force on 1 mm^2 of the
undeformed section, N/mm^2 = MPa, along z.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import scipy
from scipy.special import logsumexp
from scipy.stats import norm

import gelforge
from gelforge.characterisation.material_source import MaterialSource
from gelforge.csv_table import TableError
from gelforge.files import digest, file_sha256, write_text
from gelforge.mismatch import verdict as v
from gelforge.mismatch.alternatives import NULL_PRIOR, normalised
from gelforge.mismatch.contact_readings import ContactTest, pair_readings, press_readings
from gelforge.mismatch.material_effects import DECIDED_BY, FAMILY_OF, WORDS, stress_candidates
from gelforge.mismatch.material_evidence import (
    Candidate,
    Fitted,
    Model,
    Readings,
    combined,
    cosine,
    fitted,
    held_out_scores,
    signal_to_noise,
    what_remains,
)
from gelforge.mismatch.material_readings import StressTests, stress_tests
from gelforge.mismatch.scan import Atoms, Finding

SEED = 20261121
DRAWS = 2000
EVIDENCE = 5.0  # log Bayes factor that an effect needs; also how near a rival must be to be one
SAME_CHANGE = 0.95  # |cos| of whitened changes that these readings cannot tell apart
MOST_EFFECTS = 3
DETECTED = 4.0  # signal to noise at which a change is seen against all errors in nine of ten cases
LEAST_PIECES = 4  # samples, for whole ones to be set aside
SHARE_HELD = 0.25
PARTS_OF_SEGMENT = 4  # one of which is set aside of each
MANY_SEGMENTS = 12  # for whole branches to be set aside
BANDS = ((0.0, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1.1))
ROW_COLUMNS = [
    "sample",
    "test",
    "part",
    "branch",
    "at",
    "time_s",
    "measured",
    "base",
    "after",
    "sigma",
    "held_out",
]


@dataclass(frozen=True)
class Judged:
    """One verdict with its table of readings (material_readings.csv)."""

    name: str
    verdict: v.Verdict
    table: pd.DataFrame


@dataclass(frozen=True)
class Step:
    """One effect added to what was there: all that were tried, and the winner."""

    tried: dict[str, float]  # log Bayes factor over the model before, averaged over shapes
    best: dict[
        str, tuple[float, Candidate, Fitted]
    ]  # of each effect its best shape, fitted to the training rows
    before: Fitted
    winner: str = ""  # nothing: none was accepted
    refused: tuple[str, ...] = ()  # evidence for them, but no gain on what was set aside

    @property
    def unconfirmed(self) -> list[str]:
        """Return the effects that are not taken though there is evidence for them, the strongest first."""
        found = [name for name, z in self.tried.items() if z > EVIDENCE and name != self.winner]
        return sorted(found, key=lambda name: -self.tried[name])

    def probabilities(self, no_signature: Sequence[str] = ()) -> dict[str, float]:
        """Return the probability of each effect and of "null", that none is added."""
        all_tried = self.tried | {name: 0.0 for name in no_signature if name not in self.tried}
        all_tried |= {name: min(self.tried[name], 0.0) for name in self.refused}
        weights = {name: np.log((1 - NULL_PRIOR) / len(all_tried)) + z for name, z in all_tried.items()}
        return normalised({"null": np.log(NULL_PRIOR)} | weights)


def judge_material(source: MaterialSource, seed: int = SEED) -> tuple[list[Judged], list[str]]:
    """Return the verdicts on a material: one on its stress tests, one per press and per pair; and what was not judged."""
    found, reasons = [], []
    sources = {p.name: file_sha256(p) for p in source.files}
    if source.tests:
        try:
            tests = stress_tests(list(source.tests))
        except ValueError as error:
            reasons.append(f"{source.name}: {error}")
        else:
            found.append(_judged(f"{source.name}", _of_stress(tests), "", sources, source.synthetic, seed))
    for contact, read, word in (
        *((press.test, press_readings, "press") for press in source.small.presses),
        *((pair, pair_readings, "pair") for pair in source.small.force_pairs),
    ):
        try:
            test = read(contact)
        except ValueError as error:
            reasons.append(f"{contact.sample}: {error}")
            continue
        name = f"{source.name}-{contact.sample}"
        found.append(_judged(name, test, word, sources, source.synthetic, seed))
    return found, reasons


def _of_stress(tests: StressTests) -> ContactTest:
    candidates, cannot = stress_candidates(tests)
    readings = tests.readings
    readings = replace(readings, cannot_know=(*readings.cannot_know, *cannot, _scatter_words(tests)))
    return ContactTest(readings, tuple(candidates), tests.base_words, "stretch")


def _scatter_words(tests: StressTests) -> str:
    return (
        f"samples made alike are taken to scatter by {tests.sample_scatter:.1%} in stress: a factor of that size between"
        " samples, and an offset or a gain of a single test's force, cannot be told from it and are no physics here"
    )


# ------------------------------------------------------------------------------------------------- set aside


def with_pieces(readings: Readings, rng: np.random.Generator) -> tuple[Readings, list[str]]:
    """Return the readings with their pieces named, and those set aside: a quarter, before anything is chosen.

    Presses of a pair of load cells; else whole samples where there are enough; else whole branches; else a quarter of each
    branch. Never the loading that the base was fitted to; training keeps every kind of branch and every place.
    """
    table = readings.table
    free = ~table["is_base"].to_numpy()
    others = free & ~table["sample"].isin(table["sample"][~free]).to_numpy()
    segment = table["segment"].astype(str)
    if "place" in table:
        piece = table["part"].astype(str)
    elif table["sample"][others].nunique() >= LEAST_PIECES:
        piece, free = table["sample"].astype(str), others
    elif segment[free].nunique() >= MANY_SEGMENTS:
        piece = "branch " + segment
    else:
        quarter = np.minimum((PARTS_OF_SEGMENT * table["progress"]).astype(int), PARTS_OF_SEGMENT - 1)
        piece = "branch " + segment + ", quarter " + (quarter + 1).astype(str)
        readings = replace(readings, table=table.assign(piece=piece.where(free, "")))
        by_segment = [list(dict.fromkeys(p)) for _, p in readings.table["piece"][free].groupby(segment[free])]
        return readings, [
            names[rng.integers(len(names))] for names in by_segment if len(names) == PARTS_OF_SEGMENT
        ]
    readings = replace(readings, table=table.assign(piece=piece.where(free, "")))
    return readings, _set_aside(readings.table, rng)


def _set_aside(table: pd.DataFrame, rng: np.random.Generator) -> list[str]:
    names = [name for name in dict.fromkeys(table["piece"]) if name]
    most = max(2, round(SHARE_HELD * len(names)))
    for _ in range(500):
        held = [names[k] for k in sorted(rng.permutation(len(names))[:most])]
        train = table[~table["piece"].isin(held)]
        if all(set(train[k]) == set(table[k]) for k in ("branch", "place") if k in table):
            return held
    return []


# --------------------------------------------------------------------------------------------------- choosing


def one_step(readings: Readings, candidates: Sequence[Candidate], before: Fitted, rows: np.ndarray) -> Step:
    """Return every effect that is not in a model yet added to it, by evidence on the rows (n,) of training."""
    taken = {c.name for c in before.model}
    shapes: dict[str, list[tuple[float, Candidate, Fitted]]] = {}
    for candidate in (c for c in candidates if c.name not in taken):
        fit = fitted(readings, combined(before.model, candidate), rows)
        shapes.setdefault(candidate.name, []).append((fit.log_evidence - before.log_evidence, candidate, fit))
    tried = {n: float(logsumexp([s[0] for s in found]) - np.log(len(found))) for n, found in shapes.items()}
    return Step(tried, {n: max(found, key=lambda s: s[0]) for n, found in shapes.items()}, before)


def chosen_steps(readings, candidates, train: np.ndarray, differs: bool) -> list[Step]:
    """Return the steps whose winners are put into the base, one after the other, and a last one without a winner.

    The first winner is the effect of most evidence; each further one must have EVIDENCE, predict what is set aside better
    than its standard error explains (what does not is refused), and of those have NAMED_PROBABILITY.
    """
    model = fitted(readings, (), train)
    steps: list[Step] = []
    while True:
        tried = one_step(readings, candidates, model, train)
        if steps:
            poor = [
                n
                for n, z in tried.tried.items()
                if z > EVIDENCE and not _gains(readings, model, tried.best[n][2], train)
            ]
            tried = replace(tried, refused=tuple(poor))
        eligible = {n: z for n, z in tried.tried.items() if n not in tried.refused}
        best = max(eligible, key=eligible.get, default="")
        accepted = (
            differs and best and eligible[best] > (EVIDENCE if steps else 0.0) and len(steps) < MOST_EFFECTS
        )
        if not accepted or (steps and tried.probabilities()[best] < v.NAMED_PROBABILITY):
            return [*steps, tried]
        steps.append(replace(tried, winner=best))
        model = tried.best[best][2]


def on_everything(readings: Readings, candidates: Sequence[Candidate], model: Model) -> Fitted | None:
    """Return a model fitted to all readings, the shape of each effect chosen anew, one after the other; None of nothing."""
    everything, best = np.ones(len(readings.measured), dtype=bool), None
    for name in [c.name for c in model]:
        others = tuple(c for c in (best.model if best else model) if c.name != name)
        fits = [fitted(readings, combined(others, c), everything) for c in candidates if c.name == name]
        best = max(fits, key=lambda f: f.log_evidence)
    return best


def _gains(readings, before: Fitted, after: Fitted, train) -> bool:
    gain, error = held_out_gain(readings, before, after, train)
    return gain > v.HELD_OUT_ERRORS * error


def held_out_gain(
    readings: Readings, before: Fitted, after: Fitted, train: np.ndarray
) -> tuple[float, float]:
    """Return the gain in log predictive density of all that is set aside, and its standard error from its units' scatter."""
    if train.all():
        return 0.0, 0.0
    d = held_out_scores(readings, after, train) - held_out_scores(readings, before, train)
    return float(d.sum()), float(d.std(ddof=1) * np.sqrt(len(d)))


# -------------------------------------------------------------------------------------------------- the verdict


def _judged(name, test: ContactTest, word, sources, synthetic, seed) -> Judged:
    rng = np.random.default_rng(seed)
    readings, held = with_pieces(test.readings, rng)
    everything = np.ones(len(readings.measured), dtype=bool)
    atoms = patterns(readings)
    base = fitted(readings, (), everything)
    total, where = what_remains(readings, base, atoms, rng, DRAWS)
    differs = min(total.p, where.p) < v.ALARM_P
    train = ~readings.table["piece"].isin(held).to_numpy()
    readings = readings.with_form_error()
    steps = chosen_steps(readings, test.candidates, train, differs)
    accepted = steps[:-1]
    final = on_everything(readings, test.candidates, steps[-1].before.model)
    left = what_remains(readings, final, atoms, rng, DRAWS) if final else None
    fit = _fit(readings, base, final, steps, train, held)
    groups = [_group(readings, s, test.no_signature) for s in accepted]
    limits = _limits(readings, test.candidates)
    effects = _effects(readings, test, steps, accepted, final, groups)
    adequacy = None
    if left:
        adequacy = v.Adequacy(p=left[0].p, scan_p=left[1].p, remains=_pattern(left[1].best))
    further = steps[-1].unconfirmed if accepted else []
    state = _state(differs, groups, effects, fit, adequacy, limits, further)
    answer = groups if state in ("named", "group", "open") else []
    nothing = steps[0].probabilities(test.no_signature)["null"] if steps[0].tried else 1.0
    after = final.prediction if answer else None
    unit = "MPa" if test.at_unit == "stretch" else "N"
    content = v.Verdict(
        title=f"{name}: {word or 'stress tests'} beside {test.base_words}",
        synthetic=synthetic,
        state=state,
        sentence=_sentence(name, test, state, answer, fit, adequacy, where, limits, final, unit, further),
        mismatch=v.Mismatch(chi2=total.chi2, degrees=total.degrees, p=total.p, scan_p=where.p),
        where=_where(where) if differs else [],
        answer=answer,
        effects=effects,
        null_probability=nothing,
        fit=fit if answer else fit.model_copy(update={"after": None}),
        adequacy=adequacy if answer else None,
        detection_limits=limits,
        noise=_noise(readings, total.p, state, answer, test, seed, held),
        next_experiments=_experiments(state, answer, limits, further),
        cannot_know=list(readings.cannot_know) + _not_entering(test),
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
    return Judged(name, content, _table(readings, after, held))


def patterns(readings: Readings) -> Atoms:
    """Return where readings may differ: kinds of branch, bands of strain, tests, branches of a test; a share of the base."""
    table = readings.table
    names, kinds, columns = [], [], []

    def add(name: str, kind: str, rows) -> None:
        rows = np.asarray(rows)
        if rows.any():
            names.append(name)
            kinds.append(kind)
            columns.append(rows * readings.base)

    moving = {"load": "loading", "unload": "unloading", "hold": "holds"}
    for branch, word in moving.items():
        own = (table["branch"] == branch).to_numpy()
        add(f"all {word}", "phase", own & ~table["is_base"].to_numpy())
        for low, high in BANDS:
            band = own & table["share"].between(low, high).to_numpy()
            add(
                f"{word} between {max(low, 0):.0%} and {min(high, 1):.0%} of the range of strain",
                "depth",
                band,
            )
        late = own & (table["progress"] > 0.5).to_numpy()
        add(f"second halves of {word}", "time", late)
    for sample in dict.fromkeys(table["sample"]):
        own = (table["sample"] == sample).to_numpy()
        add(f"sample {sample}", "session", own)
        for branch, word in moving.items():
            add(f"{word} of {sample}", "phase", own & (table["branch"] == branch).to_numpy())
    if "place" in table:
        for place in dict.fromkeys(table["place"]):
            add(f"place {place}", "position", table["place"] == place)
    one = np.abs(readings.measured).max() * (table["branch"] == "unload").to_numpy()
    if one.any():  # where the base is zero its share is nothing
        names.append("force of its own while unloading")
        kinds.append("phase")
        columns.append(one)
    return Atoms(tuple(names), tuple(kinds), tuple({} for _ in names), np.column_stack(columns))


def _pattern(found: Finding) -> str:
    share = f"{found.amplitude:+.1%} of {'the largest' if 'of its own' in found.name else 'the base'}"
    return f"{found.name}, {share}"


def _where(scan) -> list[v.Where]:
    return [
        v.Where(words=_pattern(f), channel="nominal stress or force", snr=f.snr, p=scan.p if k == 0 else None)
        for k, f in enumerate(scan.ranked[:3])
    ]


def _group(readings: Readings, s: Step, no_signature) -> v.Group:
    """Return the winner of a step with the rivals that these readings cannot tell from it."""
    winner, probability = s.winner, s.probabilities(no_signature)

    def change(name):
        return s.best[name][2].prediction - s.before.prediction

    rivals = [n for n in s.tried if n != winner and s.tried[n] > s.tried[winner] - EVIDENCE]
    cosines = {n: abs(cosine(readings, change(winner), change(n))) for n in rivals}
    same = sorted((n for n in rivals if cosines[n] > SAME_CHANGE), key=lambda n: -s.tried[n])
    members = [winner, *same]
    odds = float(np.exp(min(s.tried[winner] - s.tried[same[0]], 700.0))) if same else None
    return v.Group(
        members=members,
        probability=min(1.0, sum(probability[n] for n in members)),
        odds=odds,
        cosine=max(cosines[n] for n in same) if same else None,
        decided_by=DECIDED_BY[same[0]] if same else "",
    )


def _effects(
    readings, test, steps: list[Step], accepted, final: Fitted | None, groups
) -> list[v.NamedEffect]:
    found: dict[str, v.NamedEffect] = {}
    for number, s in enumerate(steps):
        probability = s.probabilities(test.no_signature) if s.tried else {}
        for name, z in s.tried.items():
            winner = number < len(accepted) and name == s.winner
            fit = final if winner else s.best[name][2]
            k = next(i for i, c in enumerate(fit.model) if c.name == name)
            change = fit.change(k, readings)
            group = groups[number].members if winner else []
            found[name] = v.NamedEffect(
                name=name,
                family=FAMILY_OF[name],
                probability=probability[name],
                log_bayes_factor=z,
                snr=signal_to_noise(readings, change),
                amounts=_amounts(fit, k),
                shape=dict(fit.model[k].shape),
                in_range=_in_range(fit, k),
                refitted=winner,
                group=group,
            )
    for name in test.no_signature:
        found[name] = v.NamedEffect(
            name=name, family=FAMILY_OF[name], probability=steps[0].probabilities(test.no_signature)[name],
            log_bayes_factor=0.0, snr=0.0, in_range=False,
        )  # fmt: skip
    first = [s.winner for s in accepted]
    return sorted(
        found.values(), key=lambda e: (first.index(e.name) if e.name in first else 9, -e.log_bayes_factor)
    )


def _amounts(fit: Fitted, k: int) -> list[v.Amount]:
    own = fit.of(k)
    sd = np.sqrt(np.diag(fit.amounts_covariance))[own]
    half = norm.ppf(0.95) * sd
    found = []
    for p, a, h in zip(fit.model[k].parameters, fit.amounts[own], half):
        low, high = max(a - h, p.bounds[0]), min(a + h, p.bounds[1])
        found.append(
            v.Amount(name=p.name, unit=p.unit, value=float(a), interval_90=(low, high), bounds=p.bounds)
        )
    return found


def _in_range(fit: Fitted, k: int) -> bool:
    """Return whether the amounts lie inside their bounds; elements of a spectrum may be absent, not all of them."""
    own, parameters = fit.amounts[fit.of(k)], fit.model[k].parameters
    inside = all(p.bounds[0] <= a < p.bounds[1] and p.sign * a >= 0 for p, a in zip(parameters, own))
    return bool(inside and np.any(own != 0))


def _score(readings: Readings, prediction, covariance, rows=None, log_score=None) -> v.Score:
    rows = np.ones(len(readings.measured), dtype=bool) if rows is None else rows
    r = (readings.measured - prediction)[rows]
    if log_score is None:
        L = np.linalg.cholesky(covariance)
        z = np.linalg.solve(L, r)
        log_score = float(-0.5 * z @ z - np.log(np.diag(L)).sum() - 0.5 * len(r) * np.log(2 * np.pi))
    return v.Score(
        readings=len(r), rmse_N=[None, None, float(np.sqrt(np.mean(r**2)))], log_score=float(log_score)
    )


def _fit(readings, base: Fitted, final: Fitted | None, steps, train, held) -> v.Fit:
    before = _score(readings, base.prediction, base.covariance)
    if final is None:
        return v.Fit(before=before)
    held_out = None
    if len(held) >= 2:
        first, last = steps[0].before, steps[-1].before
        one, two = (held_out_scores(readings, f, train) for f in (first, last))
        gain, error = held_out_gain(readings, first, last, train)
        held_out = v.HeldOut(
            block=f"{len(held)} of {readings.table['piece'].replace('', np.nan).nunique()} pieces: {', '.join(held)}",
            before=_score(readings, first.prediction, None, ~train, one.sum()),
            after=_score(readings, last.prediction, None, ~train, two.sum()),
            gain=gain,
            standard_error=error,
        )
    return v.Fit(before=before, after=_score(readings, final.prediction, final.covariance), held_out=held_out)


def _limits(readings: Readings, candidates: Sequence[Candidate]) -> list[v.DetectionLimit]:
    """Return the smallest amount of each effect, in its most visible shape, that has a signal to noise of DETECTED."""
    best: dict[str, tuple[float, Candidate]] = {}
    for c in candidates:
        width = c.parameters[0].width
        unit = np.zeros(len(c.parameters))
        unit[0] = 0.1 * width
        snr = 10 * signal_to_noise(readings, c.apply(readings.base, unit) - readings.base)
        if c.name not in best or snr > best[c.name][0]:
            best[c.name] = (snr, c)
    found = []
    for name, (snr, c) in best.items():
        p = c.parameters[0]
        amount = DETECTED / snr * p.width if snr > 0 else None
        found.append(
            v.DetectionLimit(effect=name, parameter=p.name, unit=p.unit, amount=amount, plausible=p.width)
        )
    return found


def _state(differs, groups, effects, fit: v.Fit, adequacy, limits, further) -> v.State:
    """Return the state; further: effects with evidence that were not taken, so the answer is not the whole of it."""
    if not differs:
        return "null" if any(limit.seen for limit in limits) else "insufficient"
    if not groups:
        return "open"
    by_name = {e.name: e for e in effects}
    sound = (
        all(g.probability >= v.NAMED_PROBABILITY for g in groups)
        and all(by_name[g.members[0]].in_range for g in groups)
        and adequacy is not None
        and adequacy.passed
        and fit.held_out is not None
        and fit.held_out.shown
        and not further
    )
    if not sound:
        return "open"
    return "named" if all(len(g.members) == 1 or g.odds >= v.NAMED_ODDS for g in groups) else "group"


def _noise(readings: Readings, p, state, answer, test, seed, held) -> v.Noise:
    typical = float(np.sqrt(np.mean(readings.noise**2)))
    case = v.NoiseCase(
        scale=1.0, sigma_z_N=typical, state=state, answer=[g.members for g in answer],
        probability=min((g.probability for g in answer), default=None), p=p,
    )  # fmt: skip
    return v.Noise(
        stated_N=[None, None, typical],
        zero_N=[None, None, readings.zero],
        touchdown_mm=0.0,
        floor_N=[None, None, 0.0],
        law_N=[None, None, float(np.sqrt(np.mean(readings.law**2)))],
        sensitivity=[case],
    )


def _experiments(state, answer: list[v.Group], limits, further) -> list[v.Experiment]:
    asked = [(g.decided_by, g.members) for g in answer if g.decided_by]
    if state == "open" and not asked:
        names = [*further, *(g.members[0] for g in answer)]
        asked = [(DECIDED_BY[n], [n]) for n in names]
    if state in ("null", "insufficient"):
        asked = [(DECIDED_BY[x.effect], [x.effect]) for x in limits if not x.seen]
    return [v.Experiment(words=words, separates=list(names)) for words, names in asked[:3]]


def _not_entering(test: ContactTest) -> list[str]:
    if not test.no_signature:
        return []
    return [
        f"{', '.join(test.no_signature)}: no property of the body between the load cells enters their difference, so these"
        " readings neither show nor exclude it"
    ]


def _sentence(name, test, state, answer, fit: v.Fit, adequacy, where, limits, final, unit, further) -> str:
    factor, word = (1e3, "kPa") if unit == "MPa" else (1.0, "N")
    factor, word = (1e9, "nN") if unit == "N" and (fit.before.rmse_N[2] or 0) < 1e-4 else (factor, word)

    def size(score):
        return f"{score.rmse_N[2] * factor:.3g} {word}"

    before = size(fit.before)
    if state == "null":
        seen = ", ".join(x.effect for x in limits if x.seen)
        return (
            f"{name}: nothing is missing within the errors ({before} beside {test.base_words}); plausible amounts of {seen}"
            " would have been seen."
        )
    if state == "insufficient":
        return f"{name}: nothing is seen, but these tests could not show plausible amounts of what may be missing."
    place = where.best.name
    if not answer:
        return f"{name}: {test.base_words} is off by {before}, most clearly in {place}; no effect known here explains it."
    said = " and ".join(" or ".join(WORDS[m] for m in g.members) for g in answer)
    text = f"{name}: {test.base_words} leaves out {said}: most clearly in {place}; the error falls from {before} to"
    text += f" {size(fit.after)}"
    if fit.held_out:
        text += f", on readings set aside from {size(fit.held_out.before)} to {size(fit.held_out.after)}"
    numbers = _numbers(final)
    text += f" ({numbers})" if numbers else ""
    if state == "open" and further:
        words = " or ".join(WORDS[n] for n in further)
        text += f"; there is evidence for {words} beside it, which what was set aside does not confirm"
    elif state == "open":
        text += f"; something remains ({adequacy.remains})" if not adequacy.passed else "; it is not certain"
    if all(FAMILY_OF[g.members[0]] == "force sensor" for g in answer) and test.no_signature:
        text += "; no effect of the material is needed, and none could enter"
    return text + "."


def _numbers(final: Fitted) -> str:
    said = []
    for k, candidate in enumerate(final.model):
        a = final.amounts[final.of(k)]
        if candidate.name == "viscoelastic":
            share = sum(x for x, p in zip(a, candidate.parameters) if p.name.startswith("share"))
            alike = "share_per_decade" == candidate.parameters[0].name
            per = " per decade of time" if alike else ", which relaxes beside it"
            said.append(f"{share:.2g} of the fastest loading's stress{per}")
        elif candidate.name == "ageing":
            s = candidate.shape
            said.append(f"stress changes by {a[0]:+.0%} from {s['from']:g} to {s['to']:g} {s['per']}")
        elif candidate.name == "force_gain":
            span = (
                f"{a.min():+.1%} to {a.max():+.1%} by {candidate.shape['by']}"
                if len(a) > 1
                else f"{a[0]:+.1%}"
            )
            said.append(f"gain {span}")
        elif candidate.name == "adhesion":
            said.append(f"a pull of {a[0]:.3g} N")
    return ", ".join(said)


# ------------------------------------------------------------------------------------------------------- files


def _table(readings: Readings, after, held) -> pd.DataFrame:
    held_out = readings.table["piece"].where(readings.table["piece"].isin(held), "no")
    table = readings.table.assign(
        measured=readings.measured,
        base=readings.base,
        after=np.nan if after is None else after,
        sigma=np.sqrt(np.diag(readings.covariance)),
        held_out=held_out,
    )
    return table[[c for c in ROW_COLUMNS if c in table]]


def write_judged(folder: Path, judged: Judged) -> None:
    """Write verdict.json and material_readings.csv (nominal stress [MPa], or force [N] of presses and pairs)."""
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
