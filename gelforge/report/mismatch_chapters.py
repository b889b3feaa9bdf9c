"""What a verdict's page says, and the chapter about it that ends a study's report."""

from __future__ import annotations

import os

import numpy as np
import pandas as pd

from gelforge.mismatch.verdict import (
    PAGE,
    VERDICT,
    Amount,
    Experiment,
    HeldOut,
    NamedEffect,
    Score,
    Unknown,
    VerdictError,
    Where,
)
from gelforge.report.chapters import Chapter, Facts, Link, count
from gelforge.report.mismatch_curves import (
    depth_figure,
    held_out_figure,
    noise_figure,
    profile_figure,
    time_figure,
)
from gelforge.report.mismatch_maps import (
    body_map_figure,
    chance_text,
    headline_figure,
    known_patches,
    pretty,
    residual_maps_figure,
)
from gelforge.report.mismatch_reader import MismatchResults, rms
from gelforge.report.results_reader import StudyResults

FOLDER = "mismatch"  # of a study's verdict, in its results folder
RANKED = 12  # effects in the table; the others are named below it
STATES = {
    "null": "nothing to explain",
    "named": "the missing physics has a name",
    "group": "one of a few, which these readings cannot tell apart",
    "open": "something is missing that no known effect explains",
    "insufficient": "these readings cannot tell",
}
STATE_MEANS = {
    "null": "Simulation and readings differ by no more than the errors that were allowed for.",
    "named": "One explanation stands far above all others, leaves nothing but noise, and improves the prediction of readings"
    " that were set aside before anything was fitted.",
    "group": "The mismatch is real and narrowed down, but the members of the group change these readings in the same way.",
    "open": "The mismatch is real. What the catalogue knows does not explain all of it, and no name is given to the rest.",
    "insufficient": "Plausible amounts of missing physics would not show in these readings, or not clearly enough.",
}


def in_short(results: MismatchResults) -> Chapter:
    """Return before, after and the chances, and the numbers that carry the verdict."""
    verdict, axis = results.verdict, results.strongest_axis
    chapter = Chapter("short", "In short")
    pushes = " (red: it pushes back less, blue: more)" if axis == "z" else ""
    words = f"Coloured squares are where the sensor reads another force than simulated{pushes}; white is agreement."
    words += " On the right, what is most probably missing." if verdict.effects else ""
    if not results.has_after:
        words += " There is one map only: nothing was put into the simulation."
    chapter.show(words, headline_figure(results))
    facts = [("What that means", STATE_MEANS[verdict.state])]
    for group in verdict.answer:
        names = " or ".join(pretty(name) for name in group.members)
        odds = f", odds {group.odds:.3g} : 1 for the first" if group.odds else ""
        label = "Missing" if verdict.state != "open" else "The best of the known"
        facts.append((label, f"{names} (probability {chance_text(group.probability)}{odds})"))
        first = next(effect for effect in verdict.effects if effect.name == group.members[0])
        facts += [("Amount", f"{pretty(first.name)}: {amounts_text(first)}")] if first.amounts else []
    if verdict.unknown is not None and verdict.state == "open":
        told = f"{chance_text(verdict.unknown.probability)} probable; it would change {verdict.unknown.words}"
        facts.append(("Something unknown", told))
    held_out = verdict.fit.held_out
    if held_out:
        facts.append((f"Error of F{axis}, set aside", _before_after(held_out, axis)))
    noise = rms(results.readings.loc[results.readings["axis"] == axis, "sigma_N"])
    facts.append(
        ("Error that is no mismatch", f"{noise:.3g} N: instrument, depth zero, materials' fit, mesh")
    )
    test = verdict.mismatch
    chance = f"as much mismatch: {p_text(test.p)}; as strong a pattern: {p_text(test.scan_p)}"
    if test.unknown_p is not None:
        chance += f"; as much for something unknown: {p_text(test.unknown_p)} at most"
    facts.append(("By chance alone", chance))
    if verdict.adequacy:
        a = verdict.adequacy
        kind = "only noise remains" if a.passed else "something remains"
        told = f"{kind}: by chance {p_text(a.p)}, as strong a pattern {p_text(a.scan_p)}"
        facts.append(("After it", told + ("; but what was set aside refutes it" if a.refuted else "")))
    chapter.blocks.append(Facts(facts))
    return chapter


def _before_after(block: HeldOut, axis: str) -> str:
    before, after = (score.rmse_N["xyz".index(axis)] for score in (block.before, block.after))
    gain = f"log score {block.gain:+.3g} ± {block.standard_error:.2g}"
    if before is None or after is None:
        return gain
    return f"{before:.3f} N before, {after:.3f} N after ({gain})"


def amounts_text(effect: NamedEffect) -> str:
    """Return an effect's amounts with unit and 90 % interval."""
    return "; ".join(_amount_text(amount) for amount in effect.amounts)


def _amount_text(amount: Amount) -> str:
    unit = "" if amount.unit in ("", "-", "1") else f" {amount.unit}"
    low, high = amount.interval_90
    return f"{pretty(amount.name)} {amount.value:+.3g}{unit} ({low:+.3g} to {high:+.3g})"


def p_text(p: float) -> str:
    """Return a probability of chance, never a bare zero."""
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def where(results: MismatchResults) -> Chapter:
    """Return the residual over the surface and the patterns found in it."""
    chapter, verdict = Chapter("where", "Where it differs"), results.verdict
    if verdict.sensor:
        chapter.show(
            "Means over the loading at each site. Every map is on the same colour scale, so a paler one agrees better."
            " Squares with a dark frame were set aside and not fitted"
            + ("; a dashed circle is a located defect." if _located(verdict.where) else "."),
            residual_maps_figure(results),
        )
    else:
        chapter.miss("No maps: these readings are not of a sensor's surface.")
    if verdict.where:
        chapter.tabulate(
            "The strongest patterns in what the base leaves; p already pays for looking everywhere.",
            _filled([_where_row(place) for place in verdict.where]),
        )
    else:
        chapter.say("No pattern stands out from the errors that were allowed for.")
    return chapter


def _located(places: list[Where]) -> bool:
    return any(place.radius_mm is not None for place in places)


def _where_row(place: Where) -> dict:
    centre = None if place.x_mm is None or place.y_mm is None else f"({place.x_mm:.3g}, {place.y_mm:.3g})"
    return {
        "pattern": place.words,
        "channel": place.channel,
        "centre_mm": centre,
        "radius_mm": _number(place.radius_mm),
        "layer": place.layer,
        "depth_mm": _span(place.depth_mm),
        "time_s": _span(place.time_s),
        "signal over noise": _number(place.snr),
        "chance": None if place.p is None else p_text(place.p),
    }


def _filled(rows: list[dict]) -> pd.DataFrame:
    """Return rows as a table without the columns that say nothing."""
    return pd.DataFrame(rows).dropna(axis="columns", how="all")


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _span(span: tuple[float, float] | None) -> str | None:
    return None if span is None else f"{span[0]:.3g} to {span[1]:.3g}"


def over_depth(results: MismatchResults) -> Chapter:
    """Return force over depth at a few sites."""
    chapter = Chapter("depth", "Over depth")
    after = " and the blue line to run through the dots" if results.has_after else ""
    chapter.show(
        f"Look for the grey line to leave the orange dots{after}; below, what is left of each reading, which should lie in"
        " the grey band. Bands are two standard deviations; hollow dots were read on the way up.",
        depth_figure(results),
    )
    return chapter


def over_time(results: MismatchResults) -> Chapter:
    """Return the residual over the recording."""
    chapter = Chapter("time", "Over time")
    time = results.readings.groupby("session")["time_s"]
    if not (time.max() > time.min()).any():  # not known, or all the same
        chapter.miss("No strip over time: these readings have no times.")
        return chapter
    chapter.show(
        "A slope or a step along this strip is drift, ageing or a change during the recording; a mismatch that depends on"
        " place or depth shows as scatter.",
        time_figure(results),
    )
    return chapter


def through_body(results: MismatchResults) -> Chapter:
    """Return the body map."""
    chapter = Chapter("body", "Inside the sensor")
    patches = results.body_map
    if patches is None:
        chapter.miss("No body map: the base has no cells whose stiffness could be changed patch by patch.")
        return chapter
    known = known_patches(patches)
    chapter.show(
        "Where the sensor would have to be stiffer (red) or softer (blue) to read as it did, whatever the true cause:"
        f" {count(known, 'patch', 'patches')} of {len(patches)}, in a dark frame, "
        + ("is" if known == 1 else "are")
        + " beyond two standard deviations; the faded ones could as well be unchanged.",
        body_map_figure(results),
    )
    return chapter


def _unknown_text(unknown: Unknown | None) -> str:
    """Return how probable something unknown is, and what it would change."""
    if unknown is None:
        return ""
    return f", that something unknown is missing {chance_text(unknown.probability)} (it would change {unknown.words})"


def ranking(results: MismatchResults) -> Chapter:
    """Return all effects that were tried, the most probable first."""
    chapter, verdict = Chapter("effects", "Which physics"), results.verdict
    if not verdict.effects:
        chapter.miss("No effect was tried.")
        return chapter
    rows = [
        {
            "effect": pretty(effect.name),
            "family": effect.family,
            "probability": chance_text(effect.probability),
            "log Bayes factor": round(effect.log_bayes_factor, 1),
            "signal over noise": _number(effect.snr),
            "amount (90 % interval)": amounts_text(effect) or None,
            "scanned": ", ".join(f"{pretty(k)} {_short(v)}" for k, v in effect.shape.items()) or None,
            "physically possible": effect.in_range,
            "judged in": "solver" if effect.refitted else "first order",
        }
        for effect in verdict.effects[:RANKED]
    ]
    chapter.tabulate(
        f"What was tried, the most probable first; that nothing is missing has probability"
        f" {chance_text(verdict.null_probability)}{_unknown_text(verdict.unknown)}. A good fit alone names nothing: an"
        " amount must also be physically possible.",
        _filled(rows),
    )
    rest = verdict.effects[RANKED:]
    if rest:
        names = ", ".join(pretty(effect.name) for effect in rest)
        most = max(effect.probability for effect in rest)
        chapter.say(f"Also tried ({chance_text(most)}{' each' if most < 0.005 else ' or less'}): {names}.")
    answered = {name for group in verdict.answer for name in group.members}
    profiled = [e for e in verdict.effects if e.name in answered and any(a.profile for a in e.amounts)]
    if profiled:
        chapter.show(
            "The narrower the peak, the better the readings fix the amount; shaded is the 90 % interval, and the effect's"
            " absence is at 0.",
            profile_figure(profiled),
        )
    if verdict.law:
        terms = ", ".join(f"{term}: {value:.4g} N" for term, value in verdict.law.terms.items())
        chapter.say(f"A law, not a cause, of what no effect explains: {verdict.law.words} ({terms}).")
    return chapter


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.3g}"


def set_aside(results: MismatchResults) -> Chapter:
    """Return the errors before and after on blocks that were set aside."""
    chapter, fit = Chapter("held-out", "On readings it had not seen"), results.verdict.fit
    if fit.held_out is None:
        chapter.miss(
            "Nothing was put into the simulation, so there is nothing to try on readings that were set aside."
        )
    else:
        blocks = [fit.held_out, *fit.held_out_blocks]
        chapter.show(
            "Blue should lie left of grey: with the effect in it, the simulation predicts readings that took no part in"
            " fitting it.",
            held_out_figure(blocks, results.axes),
        )
        chapter.tabulate(
            "A gain counts where it is more than twice its standard error.",
            pd.DataFrame([_gain_row(block) for block in blocks]),
        )
    rows = [_score_row("before", fit.before)] + ([_score_row("after", fit.after)] if fit.after else [])
    chapter.tabulate("The same on all readings, those that were fitted included.", pd.DataFrame(rows))
    if fit.flow:
        after = "" if fit.flow.rmse_after_px is None else f", {fit.flow.rmse_after_px:.3g} px after"
        chapter.say(
            f"The images' flow was {fit.flow.used}: error {fit.flow.rmse_before_px:.3g} px before{after};"
            f" by chance alone {p_text(fit.flow.p)}."
        )
    return chapter


def _gain_row(block: HeldOut) -> dict:
    return {
        "set aside": block.block,
        "values": block.before.readings,
        "log score before": block.before.log_score,
        "log score after": block.after.log_score,
        "gain": f"{block.gain:+.3g} ± {block.standard_error:.2g}",
        "counts": block.shown,
    }


def _score_row(name: str, score: Score) -> dict:
    errors = {f"rms error {axis}_N": _number(value) for axis, value in zip("xyz", score.rmse_N)}
    return {"simulation": name, "values": score.readings, **errors, "log score": score.log_score}


def undecided(results: MismatchResults) -> Chapter:
    """Return what could not be told apart, and the experiment that would decide."""
    chapter, verdict = Chapter("undecided", "What could not be told apart, and what would"), results.verdict
    several = [group for group in verdict.answer if len(group.members) > 1]
    for group in several:
        names = ", ".join(pretty(name) for name in group.members)
        alike = f" (their changes have a cosine of {group.cosine:.4f})" if group.cosine is not None else ""
        chapter.say(f"These readings cannot tell apart {names}{alike}. {group.decided_by}".strip())
    if verdict.answer and not several:
        chapter.say("Nothing else that was tried changes these readings in the same way as the answer.")
    if verdict.state == "open":
        chapter.say("No known effect explains what remains, so there is none to tell apart.")
    if verdict.next_experiments:
        chapter.tabulate(
            "What to record next, the most telling first.",
            _filled([_experiment_row(experiment) for experiment in verdict.next_experiments]),
        )
    else:
        chapter.say("No further experiment is proposed.")
    return chapter


def _experiment_row(experiment: Experiment) -> dict:
    odds = experiment.expected_log_odds
    cost = experiment.cost_s
    return {
        "experiment": experiment.words,
        "tells apart": ", ".join(pretty(name) for name in experiment.separates),
        "presses": experiment.presses,
        "time": None if cost is None else f"{cost / 60:.0f} min" if cost < 7200 else f"{cost / 3600:.1f} h",
        "expected odds": None if odds is None else f"{_odds(odds)} : 1",
    }


def _odds(log_odds: float) -> str:
    return "> 1000" if log_odds > np.log(1000) else f"{np.exp(log_odds):.2g}"


def noise(results: MismatchResults) -> Chapter:
    """Return the errors that were allowed for, and the verdict under others."""
    chapter, stated = Chapter("noise", "If the noise were another"), results.verdict.noise
    if stated.sensitivity:
        chapter.show(
            "The verdict, from left to right, as the force sensor is believed to be worse; numbers are its probability.",
            noise_figure(stated.sensitivity),
        )
    else:
        chapter.miss("The verdict was not repeated under other noise.")
    named = {"one reading": stated.stated_N, "zero, per press": stated.zero_N}
    named |= {"mesh": stated.floor_N, "materials' fit": stated.law_N}
    rows = [{"error of": n} | {f"{a}_N": _number(v) for a, v in zip("xyz", s)} for n, s in named.items()]
    chapter.tabulate(
        f"Standard deviations that were allowed for; the depth's zero: {stated.touchdown_mm:.3g} mm.",
        pd.DataFrame(rows),
    )
    return chapter


def limits(results: MismatchResults) -> Chapter:
    """Return what these readings cannot show: known reasons, and amounts too small to be seen."""
    chapter, verdict = Chapter("cannot-know", "What these readings cannot show"), results.verdict
    for sentence in verdict.cannot_know:
        chapter.say(sentence)
    if verdict.detection_limits:
        found = sorted(verdict.detection_limits, key=lambda limit: limit.seen)
        hidden = sum(not limit.seen for limit in found)
        rows = [
            {
                "effect": pretty(limit.effect),
                "parameter": pretty(limit.parameter),
                "unit": limit.unit,
                "smallest seen": _number(limit.amount),
                "plausible": limit.plausible,
                "would be seen": limit.seen,
            }
            for limit in found
        ]
        chapter.tabulate(
            f"The smallest amount that these readings would show, beside a plausible one: {hidden} of {len(found)} would"
            " stay hidden.",
            pd.DataFrame(rows),
        )
    if not chapter.blocks:
        chapter.say("Nothing is known to be out of reach.")
    return chapter


def outliers(results: MismatchResults) -> Chapter:
    """Return the readings that were set aside as outliers."""
    chapter, found = Chapter("outliers", "Readings set aside as outliers"), results.verdict.outliers
    if not found:
        chapter.say("None: every reading was judged.")
        return chapter
    rows = [
        {
            "session": o.session,
            "press": o.press,
            "depth_mm": _number(o.depth_mm),
            "axis": o.axis or "all",
            "size over sigma": _number(o.size),
            "reason": o.reason,
        }
        for o in found
    ]
    chapter.tabulate("Not judged, and not dropped from the recording.", pd.DataFrame(rows))
    return chapter


def origin(results: MismatchResults) -> Chapter:
    """Return what the verdict rests on."""
    chapter, made = Chapter("origin", "What this rests on"), results.verdict.provenance
    kind = "SYNTHETIC: made by a virtual lab or another solver" if results.verdict.synthetic else "recorded"
    facts = [("Readings", kind), ("Base", made.base), ("SHA-256 of the base", made.base_sha256)]
    facts += [(f"SHA-256 of session {name}", value) for name, value in made.sessions.items()]
    facts += [("Draws", f"{made.draws:,}, seed {made.seed}")]
    facts += [("Versions", ", ".join(f"{name} {version}" for name, version in sorted(made.versions.items())))]
    chapter.blocks.append(Facts(facts))
    return chapter


CHAPTERS = (
    in_short,
    where,
    over_depth,
    over_time,
    through_body,
    ranking,
    set_aside,
    undecided,
    noise,
    limits,
    outliers,
    origin,
)


def mismatch(results: StudyResults) -> Chapter:
    """Return the end of a study's report: the verdict in a sentence, before and after, and the way to its page."""
    chapter = Chapter("mismatch", "What the simulation leaves out")
    folder = results.folder / FOLDER
    if not results.study.sessions:
        chapter.miss("No verdict: without recording sessions there is nothing to compare.")
        return chapter
    try:
        found = MismatchResults(folder)
        verdict = found.verdict
    except VerdictError as error:
        missing = not (folder / VERDICT).is_file()
        chapter.miss(f"No verdict: {folder / VERDICT} is not there." if missing else f"No verdict: {error}")
        return chapter
    made_up = " The readings are SYNTHETIC." if verdict.synthetic else ""
    chapter.say(f"{verdict.sentence}{made_up}")
    chapter.show(
        "Left to right: the sensor's force less the simulated, before and after on one colour scale, and the chances of what"
        " is missing."
        if found.has_after
        else "The sensor's force less the simulated, and the chances of what is missing.",
        headline_figure(found),
    )
    page = folder / PAGE
    if page.is_file():
        chapter.blocks.append(
            Link("The whole verdict", os.path.relpath(page, results.folder).replace(os.sep, "/"))
        )
    return chapter
