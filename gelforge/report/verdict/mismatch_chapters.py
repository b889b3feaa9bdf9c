"""What a verdict's page says, and the chapter about it that ends a study's report."""

from __future__ import annotations

import os

import pandas as pd

from gelforge.mismatch.result.verdict import PAGE, VERDICT, Group, HeldOut, Noise, Verdict, VerdictError
from gelforge.mismatch.result.verdict_tables import LIMITS
from gelforge.report.chapters.chapter import Chapter, Facts, Link
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.verdict.mismatch_answer import ranking, set_aside, undecided
from gelforge.report.verdict.mismatch_curves import noise_figure
from gelforge.report.verdict.mismatch_maps import chance_text, headline_figure, pretty
from gelforge.report.verdict.mismatch_pattern import over_depth, over_time, through_body, where
from gelforge.report.verdict.mismatch_reader import MismatchResults, rms
from gelforge.report.verdict.mismatch_words import (
    STATE_MEANS,
    amounts_text,
    filled,
    number,
    p_text,
    unbroken,
)

FOLDER = "mismatch"  # of a study's verdict, in its results folder
MOST_LIMITS = 10  # values in the table of the page
# What a laboratory asks for first: materials, contact point, force sensor, geometry.
SHOWN_FIRST = (
    *("gel_stiffness", "skin_stiffness", "friction", "contact_zero", "layer_thickness", "force_gain"),
    *(
        "indenter_radius",
        "frame_compliance",
        "viscoelastic",
        "elastic_base",
        "tilt",
        "adhesion",
        "clock_offset",
    ),
)


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
    if verdict.answer:
        chapter.tabulate(
            "What may be missing. Of each set one effect is there; sets hold 95 % of the probability. Effects of one line"
            " have the same sensitivities: only another experiment distinguishes them.",
            filled([row for group in verdict.answer for row in _rows(verdict, group)]),
        )
        chapter.say(" ".join(filter(None, (_interchange(group) for group in verdict.answer))))
    facts = [("What that means", STATE_MEANS[verdict.state]), ("Next", verdict.next_step)]
    if verdict.unknown is not None and verdict.state == "unexplained":
        reported = (
            f"{chance_text(verdict.unknown.probability)} probable; it would change {verdict.unknown.words}"
        )
        facts.append(("No known effect", reported))
    held_out = verdict.fit.held_out
    if held_out:
        facts.append((f"Error of F{axis}, held out", _before_after(held_out, axis)))
    noise = rms(results.readings.loc[results.readings["axis"] == axis, "sigma_N"])
    facts.append(("Error allowed for", f"{noise:.3g} N: instrument, contact point, materials' fit, mesh"))
    test = verdict.mismatch
    chance = f"as much mismatch: {p_text(test.p)}; as strong a pattern: {p_text(test.scan_p)}"
    if test.unknown_p is not None:
        chance += f"; as much for a discrepancy: {p_text(test.unknown_p)} at most"
    if test.known_p is not None:
        chance += f"; as much for known effects: {p_text(test.known_p)} at most"
    facts.append(("By chance alone", chance))
    if verdict.adequacy:
        a = verdict.adequacy
        reported = f"{a.words}: by chance {p_text(a.p)}, as strong a pattern {p_text(a.scan_p)}"
        facts.append(("After it", reported))
    chapter.blocks.append(Facts(facts))
    return chapter


def _rows(verdict: Verdict, group: Group) -> list[dict]:
    """Return a row for each effect of a credible set."""
    effects = {effect.name: effect for effect in verdict.effects}
    chance = group.probability if group.set_probability is None else group.set_probability
    return [
        {
            "probability of the set": chance_text(chance) if name == group.names[0] else "",
            "effect": unbroken(pretty(name)),
            "share": chance_text(group.shares.get(name, 1.0)),
            "line": "same as the first" if name in group.members[1:] else "",
            "value (90 % interval)": unbroken(amounts_text(effects[name])),
        }
        for name in group.names
    ]


def _interchange(group: Group) -> str:
    """Return whether it matters which effect of a set is put into the study; nothing of a single one."""
    if group.differs_N is None or group.differs_snr is None or len(group.names) == 1:
        return ""
    size = f"by {group.differs_N:.2g} N rms at most (signal over noise {group.differs_snr:.2g})"
    if group.one_patch:
        return f"Effects of the set of {pretty(group.members[0])} predict the same readings, {size}: one patch serves."
    return f"Effects of the set of {pretty(group.members[0])} predict readings that differ {size}."


def _before_after(block: HeldOut, axis: str) -> str:
    before, after = (score.rmse_N["xyz".index(axis)] for score in (block.before, block.after))
    gain = f"log score {block.gain:+.3g} ± {block.standard_error:.2g}"
    if before is None or after is None:
        return gain
    return f"{before:.3f} N before, {after:.3f} N after ({gain})"


def noise(results: MismatchResults) -> Chapter:
    """Return the errors that were allowed for, and the verdict under others where that was asked."""
    chapter, stated = Chapter("noise", "Errors that were allowed for"), results.verdict.noise
    if stated.sensitivity:
        chapter.show(
            "The verdict, from left to right, as the force sensor is believed to be worse; numbers are its probability.",
            noise_figure(stated.sensitivity),
        )
    named = {"one reading": stated.stated_N, "zero, per indentation": stated.zero_N}
    named |= {"mesh": stated.floor_N, "materials' fit": stated.law_N}
    rows = [{"error of": n} | {f"{a}_N": number(v) for a, v in zip("xyz", s)} for n, s in named.items()]
    chapter.tabulate(
        f"Standard deviations that were allowed for; {_depth_errors(stated)}.",
        pd.DataFrame(rows),
    )
    return chapter


def _depth_errors(stated: Noise) -> str:
    """Return in words how well the depth was taken to be known."""
    parts = {
        "from one indentation to the next": stated.press_depth_mm,
        "of a session's contact point": stated.session_depth_mm,
    }
    if None in parts.values():  # a verdict of an earlier version
        return f"the depth's zero: {stated.touchdown_mm:.3g} mm"
    return "the depth: " + ", ".join(f"{size:.3g} mm {words}" for words, size in parts.items())


def limits(results: MismatchResults) -> Chapter:
    """Return what these readings cannot show: known reasons, and values too small to be seen."""
    chapter, verdict = Chapter("cannot-know", "What these readings cannot show"), results.verdict
    for sentence in verdict.cannot_know:
        chapter.say(sentence)
    if verdict.detection_limits:
        found = verdict.detection_limits
        hidden = sum(not limit.seen for limit in found)
        first = sorted(found, key=lambda limit: [*SHOWN_FIRST, limit.effect].index(limit.effect))
        rows = [
            {
                "effect": pretty(limit.effect),
                "parameter": pretty(limit.parameter),
                "smallest detectable": _in_unit(limit.amount, limit.unit),
                "plausible": _in_unit(limit.plausible, limit.unit),
            }
            for limit in first[:MOST_LIMITS]
        ]
        chapter.tabulate(
            f"The smallest value that these readings would show, and a plausible one. Of {len(found)} values {hidden} would"
            f" stay hidden; {LIMITS} has all.",
            pd.DataFrame(rows),
        )
    if not chapter.blocks:
        chapter.say("Nothing is known to be out of reach.")
    return chapter


def _in_unit(value: float | None, unit: str) -> str:
    """Return a value with two digits and its unit; shares in per cent."""
    if value is None:
        return "none"
    return f"{100 * value:.2g} %" if unit in ("1", "-") else f"{value:.2g} {unit}"


def outliers(results: MismatchResults) -> Chapter:
    """Return the readings that were left out as outliers."""
    chapter, found = Chapter("outliers", "Readings left out as outliers"), results.verdict.outliers
    if not found:
        chapter.say("None: every reading was judged.")
        return chapter
    rows = [
        {
            "session": o.session,
            "press": o.press,
            "time_s": number(o.time_s),
            "depth_mm": number(o.depth_mm),
            "axis": o.axis or "all",
            "size over sigma": number(o.size),
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
    facts = [
        ("Readings", kind),
        ("Nominal model", made.base),
        ("SHA-256 of the nominal model", made.base_sha256),
    ]
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
    if not results.study.mismatch.judged and not (folder / VERDICT).is_file():
        chapter.say(
            "Not judged: the study leaves the verdict out (mismatch.judged: false). To make one: "
            f"snakemake {folder / PAGE} with the study's --configfile."
        )
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
