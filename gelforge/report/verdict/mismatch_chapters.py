"""The chapters of a verdict's page, and the one about it that ends a study's report."""

from __future__ import annotations

import os

import pandas as pd

from gelforge.mismatch.result.verdict import PAGE, VERDICT, DetectionLimit, Noise, VerdictError, Where
from gelforge.mismatch.result.verdict_tables import LIMITS
from gelforge.report.chapters.chapter import Chapter, Facts, Link, count
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.figures.style import MOST_PANELS
from gelforge.report.verdict.mismatch_answer import answer, held_out, show_before_after
from gelforge.report.verdict.mismatch_curves import depth_figure, time_figure
from gelforge.report.verdict.mismatch_flow import flow_residual_figure
from gelforge.report.verdict.mismatch_maps import body_map_figure, is_known
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import filled, in_unit, p_text, pretty, span_text, unbroken

FOLDER = "mismatch"  # of a study's verdict, in its results folder
WHERE = {"words": "pattern", "snr": "signal over noise", "p": "chance"}
# What a laboratory asks for first: materials, contact point, force sensor, geometry.
FIRST = (
    *("gel_stiffness", "skin_stiffness", "friction", "contact_zero", "layer_thickness", "force_gain"),
    *("indenter_radius", "frame_compliance", "viscoelastic", "elastic_base", "tilt", "adhesion"),
    "clock_offset",
)


def where(results: MismatchResults) -> Chapter:
    """Return the patterns that were found, force over depth, and in folds over time and through the body."""
    chapter, verdict = Chapter("where", "Where it differs"), results.verdict
    if verdict.where:
        located = any(place.radius_mm is not None for place in verdict.where)
        circled = "; dashed circles in the maps are places of this table" if located else ""
        chapter.tabulate(
            f"The strongest patterns, with p-values corrected for the search, and defects of the answer{circled}.",
            filled([_where_row(place) for place in verdict.where]).rename(columns=WHERE),
        )
    else:
        chapter.say("No pattern stands out from the errors that were allowed for.")
    after = "; the blue line, after, should run through the dots" if results.has_after else ""
    chapter.show(
        f"Grey is the simulation before, orange the readings{after}. Bands are two standard deviations; hollow dots"
        " were read during unloading.",
        depth_figure(results),
    )
    if results.flow is not None:
        chapter.show(
            f"How far the images' flow is from the simulated one, at {MOST_PANELS} sites at most: darker is farther. Where"
            " single particles are is always left.",
            flow_residual_figure(results),
        )
    _show_time(chapter, results)
    _show_body(chapter, results)
    return chapter


def _where_row(place: Where) -> dict:
    said = {"depth_mm": span_text(place.depth_mm), "time_s": span_text(place.time_s)}
    said["p"] = None if place.p is None else unbroken(p_text(place.p))
    return place.model_dump() | said


def _show_time(chapter: Chapter, results: MismatchResults) -> None:
    time = results.readings.groupby("session")["time_s"]
    if not (time.max() > time.min()).any():  # not known, or all the same
        chapter.miss("No strip over time: these readings have no times.")
        return
    chapter.fold("Over time").show(
        "A slope or a step is drift, ageing or a change during the recording; what depends on place or depth is scatter.",
        time_figure(results),
    )


def _show_body(chapter: Chapter, results: MismatchResults) -> None:
    patches = results.body_map
    if patches is None:
        chapter.miss("No body map: the nominal model has no solved sites whose modulus could be changed.")
        return
    known = f"{int(is_known(patches).sum())} of {count(len(patches), 'patch', 'patches')} beyond two standard deviations"
    chapter.fold(f"Inside the sensor: {known}").show(
        "Where the sensor would have to be stiffer (red) or softer (blue) to read as it did, whatever the true cause."
        " Patches in a dark frame are beyond two standard deviations; the faded ones could as well be unchanged.",
        body_map_figure(results),
    )


def limits(results: MismatchResults) -> Chapter:
    """Return what these readings cannot show: known reasons, values too small to be seen, and what was left out."""
    chapter, verdict = Chapter("cannot-know", "What these readings cannot show"), results.verdict
    for sentence in verdict.cannot_know:
        chapter.say(sentence)
    if detectable := verdict.detection_limits:
        hidden = sum(not limit.seen for limit in detectable)
        names = sorted(
            dict.fromkeys(limit.effect for limit in detectable), key=lambda name: [*FIRST, name].index(name)
        )
        chapter.tabulate(
            f"The smallest value that these readings would show, and a plausible one. Of {len(detectable)} plausible values"
            f" {hidden} would stay hidden; {LIMITS} has all.",
            pd.DataFrame([_limit_row(name, detectable) for name in names[:10]]),
        )
    if not chapter.blocks:
        chapter.say("Nothing is known to be out of reach.")
    if verdict.outliers:
        folded = chapter.fold(f"{count(len(verdict.outliers), 'outlier')} not judged")
        table = pd.DataFrame([outlier.model_dump() for outlier in verdict.outliers])
        folded.tabulate("They stay in the recording; size is in standard deviations.", table)
    return chapter


def _limit_row(name: str, detectable: list[DetectionLimit]) -> dict:
    """Return an effect's parameters, their smallest detectable and their plausible values, a line each."""
    of_effect = [limit for limit in detectable if limit.effect == name]
    cells = {
        "parameter": [pretty(limit.parameter) for limit in of_effect],
        "smallest detectable": [in_unit(limit.value, limit.parameter, limit.unit) for limit in of_effect],
        "plausible": [in_unit(limit.plausible, limit.parameter, limit.unit) for limit in of_effect],
        "a plausible one is seen": ["yes" if limit.seen else "no" for limit in of_effect],
    }
    return {"effect": pretty(name)} | {key: "\n".join(lines) for key, lines in cells.items()}


def origin(results: MismatchResults) -> Chapter:
    """Return what the verdict rests on: readings, nominal model, and errors that were allowed for."""
    chapter, verdict = Chapter("origin", "What this rests on"), results.verdict
    made, kind = verdict.provenance, "SYNTHETIC: made by a virtual lab or another solver"
    facts = [("Readings", kind if verdict.synthetic else "recorded"), ("Nominal model", made.base)]
    chapter.add(Facts(facts))
    _tabulate_noise(chapter, verdict.noise)
    facts = [("SHA-256 of the nominal model", made.base_sha256)]
    facts += [(f"SHA-256 of session {name}", value) for name, value in made.sessions.items()]
    facts += [("Draws", f"{made.draws:,}, seed {made.seed}")]
    facts += [("Versions", ", ".join(f"{name} {version}" for name, version in sorted(made.versions.items())))]
    chapter.fold("Digests, seed and versions").add(Facts(facts))
    return chapter


def _tabulate_noise(chapter: Chapter, stated: Noise) -> None:
    """Add the errors that were allowed for."""
    named = {"one reading": stated.stated_N, "zero, per indentation": stated.zero_N}
    named |= {"mesh": stated.floor_N, "materials' fit": stated.law_N}
    rows = [{"error of": n} | {f"{a}_N": v for a, v in zip("xyz", s)} for n, s in named.items()]
    depth = f"{stated.press_depth_mm:.3g} mm per indentation, {stated.session_depth_mm:.3g} mm of a session's contact point"
    chapter.tabulate(f"Standard deviations that were assumed; of the depth {depth}.", pd.DataFrame(rows))


CHAPTERS = (answer, where, held_out, limits, origin)


def mismatch(results: StudyResults) -> Chapter:
    """Return the end of a study's report: the verdict in a sentence, what to do, before and after, and its page."""
    chapter = Chapter("mismatch", "What the simulation leaves out")
    folder = results.folder / FOLDER
    if not results.study.sessions:
        return chapter.miss("No verdict: without recording sessions there is nothing to compare.")
    if not results.study.mismatch.judged and not (folder / VERDICT).is_file():
        return chapter.say(
            "Not judged: the study leaves the verdict out (mismatch.judged: false). To make one: "
            f"snakemake {folder / PAGE} with the study's --configfile."
        )
    try:
        judged = MismatchResults(folder)
        verdict, _ = judged.verdict, judged.readings
    except VerdictError as error:
        missing = not (folder / VERDICT).is_file()
        return chapter.miss(
            f"No verdict: {folder / VERDICT} is not there." if missing else f"No verdict: {error}"
        )
    made_up = " The readings are SYNTHETIC." if verdict.synthetic else ""
    chapter.say(f"{verdict.sentence}{made_up} Next: {verdict.next_step}")
    show_before_after(chapter, judged)
    page = folder / PAGE
    if page.is_file():
        chapter.add(Link("The whole verdict", os.path.relpath(page, results.folder).replace(os.sep, "/")))
    return chapter
