"""What was found in a material's tests, in the form and the words of verdict.json."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import norm

from gelforge.mismatch.goodness.scan import Finding
from gelforge.mismatch.material.contact_readings import ContactTest
from gelforge.mismatch.material.material_effects import DECIDED_BY, FAMILY_OF, WORDS
from gelforge.mismatch.material.material_evidence import (
    Candidate,
    Fitted,
    Readings,
    cosine,
    held_out_scores,
    signal_to_noise,
)
from gelforge.mismatch.material.material_search import EVIDENCE, Step, held_out_gain
from gelforge.mismatch.result import verdict as v

SAME_CHANGE = 0.95  # |cos| of whitened changes that these readings cannot distinguish
DETECTED = 4.0  # signal to noise at which a change is seen against all errors in nine of ten cases
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


def pattern_words(found: Finding) -> str:
    """Return a pattern in words, with its size."""
    share = (
        f"{found.amplitude:+.1%} of {'the largest' if 'of its own' in found.name else 'the nominal model'}"
    )
    return f"{found.name}, {share}"


def where_entries(scan) -> list[v.Where]:
    """Return the three strongest patterns of a scan."""
    return [
        v.Where(
            words=pattern_words(f), channel="nominal stress or force", snr=f.snr, p=scan.p if k == 0 else None
        )
        for k, f in enumerate(scan.ranked[:3])
    ]


def group_entry(readings: Readings, s: Step, no_signature) -> v.Group:
    """Return the winner of a step with the rivals that these readings cannot distinguish from it."""
    winner, probability = s.winner, s.probabilities(no_signature)

    def change(name):
        return s.best[name][2].prediction - s.before.prediction

    rivals = [n for n in s.tried if n != winner and s.tried[n] > s.tried[winner] - EVIDENCE]
    cosines = {n: abs(cosine(readings, change(winner), change(n))) for n in rivals}
    same = sorted((n for n in rivals if cosines[n] > SAME_CHANGE), key=lambda n: -s.tried[n])
    members = [winner, *same]
    weights = np.exp([s.tried[n] - s.tried[winner] for n in members])
    return v.Group(
        members=members,
        probability=min(1.0, sum(probability[n] for n in members)),
        shares=dict(zip(members, (weights / weights.sum()).tolist())),
        decided_by=DECIDED_BY[same[0]] if same else "",
    )


def effect_entries(
    readings, test, steps: list[Step], accepted, final: Fitted | None, groups
) -> list[v.NamedEffect]:
    """Return every effect that was tried, those taken first; values of those taken are of the final fit."""
    found: dict[str, v.NamedEffect] = {}
    for number, s in enumerate(steps):
        probability = s.probabilities(test.no_signature) if s.tried else {}
        for name, z in s.tried.items():
            winner = number < len(accepted) and name == s.winner
            fit = final if winner and final is not None else s.best[name][2]
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
    """Return whether the values lie inside their bounds; elements of a spectrum may be absent, not all of them."""
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


def fit_entry(readings, base: Fitted, final: Fitted | None, steps, train, held) -> v.Fit:
    """Return how base and final fit meet all readings, and how those of the search met what was held out."""
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


def limit_entries(readings: Readings, candidates: Sequence[Candidate]) -> list[v.DetectionLimit]:
    """Return the smallest value of each effect, in its most visible shape, that has a signal to noise of DETECTED."""
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


def noise_entry(readings: Readings) -> v.Noise:
    """Return the errors that were allowed for."""
    return v.Noise(
        stated_N=[None, None, float(np.sqrt(np.mean(readings.noise**2)))],
        zero_N=[None, None, readings.zero],
        touchdown_mm=0.0,
        floor_N=[None, None, 0.0],
        law_N=[None, None, float(np.sqrt(np.mean(readings.law**2)))],
    )


def experiment_entries(state, answer: list[v.Group], limits, further) -> list[v.Experiment]:
    """Return three experiments at most that would decide what is left open."""
    asked = [(g.decided_by, g.members) for g in answer if g.decided_by]
    if state == "unexplained" and not asked:
        names = [*further, *(g.members[0] for g in answer)]
        asked = [(DECIDED_BY[n], [n]) for n in names]
    if state in ("consistent", "inconclusive"):
        asked = [(DECIDED_BY[x.effect], [x.effect]) for x in limits if not x.seen]
    return [v.Experiment(words=words, separates=list(names)) for words, names in asked[:3]]


def not_entering(test: ContactTest) -> list[str]:
    """Return, in words, the effects that cannot show in these readings."""
    if not test.no_signature:
        return []
    return [
        f"{', '.join(test.no_signature)}: no property of the body between the load cells enters their difference, so these"
        " readings neither show nor exclude it"
    ]


def sentence_of(name, test, state, answer, fit: v.Fit, adequacy, where, limits, final, unit, further) -> str:
    """Return the verdict in one plain sentence."""
    factor, word = (1e3, "kPa") if unit == "MPa" else (1.0, "N")
    factor, word = (1e9, "nN") if unit == "N" and (fit.before.rmse_N[2] or 0) < 1e-4 else (factor, word)

    def size(score):
        return f"{score.rmse_N[2] * factor:.3g} {word}"

    before = size(fit.before)
    if state == "consistent":
        seen = ", ".join(x.effect for x in limits if x.seen)
        return (
            f"{name}: nothing is missing within the errors ({before} from {test.base_words}); plausible values of {seen}"
            " would have been detected."
        )
    if state == "inconclusive":
        return f"{name}: nothing is detected, but these tests could not show plausible values of what may be missing."
    place = where.best.name
    if not answer:
        return f"{name}: {test.base_words} is off by {before}, most clearly in {place}; no effect known here explains it."
    said = " and ".join(" or ".join(WORDS[m] for m in g.members) for g in answer)
    text = f"{name}: {test.base_words} leaves out {said}: most clearly in {place}; the error falls from {before} to"
    text += f" {size(fit.after)}"
    if fit.held_out:
        text += f", on readings held out from {size(fit.held_out.before)} to {size(fit.held_out.after)}"
    numbers = _numbers(final)
    text += f" ({numbers})" if numbers else ""
    if state == "unexplained" and further:
        words = " or ".join(WORDS[n] for n in further)
        text += f"; there is also evidence for {words}, which the held-out readings do not confirm"
    elif state == "unexplained":
        text += f"; something remains ({adequacy.remains})" if not adequacy.passed else "; it is not certain"
    if all(FAMILY_OF[g.members[0]] == "force sensor" for g in answer) and test.no_signature:
        text += "; no effect of the material is needed, and none could enter"
    return text + "."


def _numbers(final: Fitted) -> str:
    said = []
    for k, candidate in enumerate(final.model):
        a = final.amounts[final.of(k)]
        if candidate.name == "viscoelastic":
            said.append(_relaxation(candidate, a))
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


def _relaxation(candidate: Candidate, a: np.ndarray) -> str:
    amounts = {p.name: x for p, x in zip(candidate.parameters, a)}
    said = []
    if amounts.get("flow_stiffness"):
        said.append(
            f"{amounts['flow_stiffness']:.2g} of the nominal stiffness flows, the faster the higher its stress"
        )
    if share := sum(x for name, x in amounts.items() if name.startswith("share")):
        per = " per decade of time" if "share_per_decade" in amounts else ", which relaxes in addition"
        said.append(f"{share:.2g} of the fastest loading's stress{per}")
    return ", ".join(said)


def readings_table(readings: Readings, after, held) -> pd.DataFrame:
    """Return the rows of material_readings.csv."""
    held_out = readings.table["piece"].where(readings.table["piece"].isin(held), "no")
    table = readings.table.assign(
        measured=readings.measured,
        base=readings.base,
        after=np.nan if after is None else after,
        sigma=np.sqrt(np.diag(readings.covariance)),
        held_out=held_out,
    )
    return table[[c for c in ROW_COLUMNS if c in table]]
