"""What was found in a material's tests, in the form and the words of verdict.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.identifiability import detection_limits
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.goodness.scan import Finding
from gelforge.mismatch.inference.posterior import Effects, Posterior
from gelforge.mismatch.material.material_models import Fitted, Tests
from gelforge.mismatch.material.material_readings import Readings
from gelforge.mismatch.result import verdict as v
from gelforge.mismatch.result.values import value_entries

# Of each effect: what it is, and the experiment that decides.
TEXTS = {
    "viscoelastic": (
        "rate dependence (the material relaxes: viscoelastic)",
        "hold at one strain for a hundred times the duration of the loading, and load at a tenth of its rate",
    ),
    "mullins": (
        "softening below the largest strain so far (mullins)",
        "load a second time, after a rest as long as ten loadings: damage stays, viscosity has recovered",
    ),
    "ageing": (
        "ageing (a later date or a treatment changes the material)",
        "load three specimens at either date: a specimen's own stiffness is then distinguished from the date",
    ),
    "temperature": ("temperature", "load one specimen at two temperatures, there and back"),
    "adhesion": (
        "adhesion (the surface holds on to the ball)",
        "withdraw at a tenth of the speed, and from a tenth of the push",
    ),
    "force_gain": ("a gain of the force (force_gain)", "hang a known weight on the load cell"),
    "force_offset": (
        "an offset of the force (force_offset)",
        "read the load cell without load before and after",
    ),
    "force_drift": (
        "a drift of the force's zero (force_drift)",
        "read the load cell without load for as long as the test",
    ),
    "force_hysteresis": (
        "hysteresis of the load cell (force_hysteresis)",
        "load and unload a steel spring",
    ),
    "clock_offset": ("a delay between the readings (clock_offset)", "tap once and compare the instants"),
}


def pattern_words(found: Finding) -> str:
    """Return a pattern in words, with its size."""
    of = "the largest" if "of its own" in found.name else "the nominal model"
    return f"{found.name}, {found.amplitude:+.1%} of {of}"


def group_entries(posterior: Posterior, effects: Effects) -> list[v.Group]:
    """Return the credible set of each effect of an answer."""
    return [
        v.Group(
            members=list(one.members),
            probability=one.probability,
            alternatives=list(one.alternatives),
            set_probability=one.set_probability,
            shares=dict(one.shares),
            decided_by=TEXTS[one.names[0]][1] if len(one.names) > 1 else "",
        )
        for one in posterior.credible_sets(effects)
    ]


def effect_entries(
    tests: Tests, posterior: Posterior, fits: Mapping[Effects, Fitted], mode: Effects, answer: Fitted | None
) -> list[v.NamedEffect]:
    """Return every effect that the readings can show, those of the most probable set first, with its values there."""
    found = []
    for name in posterior.singles:
        taken = answer is not None and name in mode
        effects = mode if taken else frozenset({name})
        fit = answer if answer is not None and taken else fits[effects]
        k = [change.name for change in fit.model].index(name)
        change, own = fit.model[k], fit.own(k)
        amounts, spread = fit.judged.amounts[own], fit.judged.covariance[own, own]
        by = replace(CATALOGUE[name], parameters=change.parameters)
        snr = np.linalg.norm(tests.readings.covariance.whiten(fit.changes(tests.readings)[k]))
        entry = v.NamedEffect(
            name=name, family=by.family, probability=posterior.holding([name]),
            log_bayes_factor=posterior.evidence[effects], snr=float(snr),
            amounts=value_entries(change.parameters, amounts, spread), shape=dict(change.shape),
            in_range=by.in_range(amounts), refitted=taken, group=[name] if taken else [],
        )  # fmt: skip
        found.append(entry)
    for name in tests.cannot_enter:
        family = CATALOGUE[name].family
        found.append(
            v.NamedEffect(
                name=name, family=family, probability=0.0, log_bayes_factor=0.0, snr=0.0, in_range=False
            )
        )
    return sorted(found, key=lambda effect: (effect.name not in mode, -effect.probability))


def limit_entries(tests: Tests) -> list[v.DetectionLimit]:
    """Return the smallest value of each effect, in its most visible shape, that these readings would show."""
    base, columns = tests.readings.base, []
    for k, change in enumerate(tests.changes):
        step = 0.1 * change.parameters[0].width * np.eye(len(change.parameters))[0]
        column = 10 * (change.apply(base, step) - base)[:, None]
        columns.append(Candidate(change.name, {"change": k}, column, np.ones(1), np.zeros(1)))
    found = []
    for limit in detection_limits(tests.readings.covariance, columns):
        p = tests.changes[int(limit.shape["change"])].parameters[0]
        amount = limit.amount * p.width if np.isfinite(limit.amount) else None
        one = {"effect": limit.name, "parameter": p.name, "unit": p.unit, "plausible": p.width}
        found.append(v.DetectionLimit(amount=amount, **one))
    return found


def noise_entry(readings: Readings) -> v.Noise:
    """Return the errors that were allowed for."""
    stated, law = (float(np.sqrt(np.mean(size**2))) for size in (readings.noise, readings.law))
    one = {"stated_N": stated, "zero_N": readings.zero, "floor_N": 0.0, "law_N": law}
    return v.Noise(contact_point_scatter_mm=0.0, **{name: [None, None, size] for name, size in one.items()})


def experiment_entries(
    state: v.State, answer: Sequence[v.Group], limits: Sequence[v.DetectionLimit]
) -> list[v.Experiment]:
    """Return three experiments at most that would decide what is left open."""
    asked = [(group.decided_by, group.names) for group in answer if group.decided_by]
    if state == "unexplained" and not asked:
        asked = [(TEXTS[group.members[0]][1], group.members[:1]) for group in answer]
    if state in ("consistent", "inconclusive"):
        asked = [(TEXTS[limit.effect][1], [limit.effect]) for limit in limits if not limit.seen]
    return [v.Experiment(words=words, separates=names) for words, names in asked[:3]]


def sentence_of(name: str, tests: Tests, verdict: v.Verdict, place: str) -> str:
    """Return a verdict in one plain sentence."""
    fit, adequacy, answer = verdict.fit, verdict.adequacy, verdict.answer
    factor, unit = (1e3, "kPa") if tests.unit == "MPa" else (1.0, "N")
    if unit == "N" and (fit.before.rmse_N[2] or 0.0) < 1e-4:
        factor, unit = 1e9, "nN"

    def size(score: v.Score) -> str:
        return f"{factor * (score.rmse_N[2] or 0.0):.3g} {unit}"

    before = size(fit.before)
    if verdict.state == "consistent":
        seen = ", ".join(limit.effect for limit in verdict.detection_limits if limit.seen)
        return (
            f"{name}: nothing is missing within the errors ({before} from {tests.base_words}); plausible values of {seen}"
            " would have been detected."
        )
    if verdict.state == "inconclusive":
        return f"{name}: nothing is detected, but these tests could not show plausible values of what may be missing."
    if not answer or fit.after is None:
        return f"{name}: {tests.base_words} is off by {before}, most clearly in {place}; no effect known here explains it."
    said = " and ".join(" or ".join(TEXTS[one][0] for one in group.names) for group in answer)
    text = f"{name}: {tests.base_words} leaves out {said}: most clearly in {place}; the error falls from {before} to"
    text += f" {size(fit.after)}"
    if fit.held_out:
        text += f", on readings held out from {size(fit.held_out.before)} to {size(fit.held_out.after)}"
    numbers = [_number(effect) for effect in verdict.effects if effect.refitted]
    text += f" ({', '.join(filter(None, numbers))})" if any(numbers) else ""
    if verdict.state == "unexplained" and adequacy is not None:
        text += f"; something remains ({adequacy.remains})"
    if tests.cannot_enter:
        text += "; no effect of the material is needed, and none could enter"
    return text + "."


def _number(effect: v.NamedEffect) -> str:
    """Return the values of an effect in words; nothing for those that say little by themselves."""
    value, shape = {amount.name: amount.value for amount in effect.amounts}, effect.shape
    if effect.name == "viscoelastic":
        share = sum(x for name, x in value.items() if name.startswith("share"))
        per = " per decade of time" if "share_per_decade" in value else ", which relaxes in addition"
        flows = value.get("flow_stiffness", 0.0)
        said = [f"{flows:.2g} of the nominal stiffness flows, the faster the higher its stress"] * (flows > 0)
        return ", ".join(said + [f"{share:.2g} of the fastest loading's stress{per}"] * (share > 0))
    if effect.name == "ageing" and "change_over_span" in value:
        change, span = value["change_over_span"], f"{shape['from']:g} to {shape['to']:g} {shape['per']}"
        return f"stress changes by {change:+.0%} from {span}"
    if effect.name == "force_gain":
        low, high = min(value.values()), max(value.values())
        return f"gain {low:+.1%}" if low == high else f"gain {low:+.1%} to {high:+.1%} by {shape['by']}"
    return f"a pull of {value['pull_off']:.3g} N" if effect.name == "adhesion" else ""


def readings_table(
    readings: Readings, after: np.ndarray | None, piece: pd.Series, held: Sequence[str]
) -> pd.DataFrame:
    """Return the rows of material_readings.csv."""
    columns = ["sample", "test", "part", "branch", "at", "time_s"]
    return readings.table[columns].assign(
        measured=readings.measured,
        base=readings.base,
        after=np.nan if after is None else after,
        sigma=readings.covariance.standard_deviation,
        held_out=piece.where(piece.isin(held), "no"),
    )
