"""The chapters of a verdict about the mismatch itself: where it is, over depth, over time, in the body."""

from __future__ import annotations

from gelforge.mismatch.result.verdict import Where
from gelforge.report.chapters.chapter import Chapter, count
from gelforge.report.figures.neighbours import MAP_SITES
from gelforge.report.verdict.mismatch_curves import depth_figure, time_figure
from gelforge.report.verdict.mismatch_flow import MOST_SHOWN, flow_residual_figure
from gelforge.report.verdict.mismatch_maps import body_map_figure, known_patches, residual_maps_figure
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import filled, number, p_text, span_text

AT_SITES = {False: "at each site", True: f"of the {MAP_SITES} nearest sites, which have one depth each"}


def where(results: MismatchResults) -> Chapter:
    """Return the residual over the surface and the patterns found in it."""
    chapter, verdict = Chapter("where", "Where it differs"), results.verdict
    if verdict.sensor:
        chapter.show(
            f"Means over the loading {AT_SITES[results.has_one_depth_each]}. Every map is on the same colour scale, so a"
            " paler one agrees better."
            " Squares with a dark frame were held out for the proof below"
            + (
                "; a dashed circle is around a pattern, or a defect, of the table below."
                if _located(verdict.where)
                else "."
            ),
            residual_maps_figure(results),
        )
    else:
        chapter.miss("No maps: these readings are not of a sensor's surface.")
    if results.flow is not None:
        chapter.show(
            f"How far the flow in the images is from the simulated one, at the sites where it is farthest ({MOST_SHOWN}"
            " at most): the darker, the farther. With the effect in it the squares should be paler; where single"
            " particles are is always left.",
            flow_residual_figure(results),
        )
    if verdict.where:
        chapter.tabulate(
            "The strongest patterns in the residual, with p-values corrected for the search, and where the"
            " answer's defects lie.",
            filled([_where_row(place) for place in verdict.where]),
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
        "radius_mm": number(place.radius_mm),
        "layer": place.layer,
        "depth_mm": span_text(place.depth_mm),
        "time_s": span_text(place.time_s),
        "signal over noise": number(place.snr),
        "chance": None if place.p is None else p_text(place.p),
    }


def over_depth(results: MismatchResults) -> Chapter:
    """Return force over depth at a few sites."""
    chapter = Chapter("depth", "Over depth")
    after = " and the blue line to run through the dots" if results.has_after else ""
    chapter.show(
        f"Look for the grey line to leave the orange dots{after}; below, what is left of each reading, which should lie in"
        " the grey band. Bands are two standard deviations; hollow dots were read during unloading.",
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
        chapter.miss(
            "No body map: the nominal model has no solved sites whose stiffness could be changed patch by patch."
        )
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
