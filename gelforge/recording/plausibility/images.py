"""Tests of the images: they show the surface, stand still before contact, follow the indentation, and are images of their
own.

The tests see measures of images (`image_measures`), of a sample while a session is read and of all when features are made.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from gelforge.recording.plausibility.findings import Finding, Level, mostly
from gelforge.recording.plausibility.image_series import LEAST_LIGHT, LEAST_TEXTURE, ImageSeries
from gelforge.recording.plausibility.image_steps import lag

# Of 14 kinds of honest SYNTHETIC images each passes, and each fault is found (tests/recording/test_image_plausibility.py):
DARK, BRIGHT = 10.0, 245.0  # mean grey levels that are called black and white
# Lamps warm by less from one image to the next, and pressing shades less: light that fades by a fifth in 18 images passes,
# an image of 0.7 times the light is left out, 0.75 in all is refused (test_image_plausibility.py).
EXPOSURE_STEP = 0.15
# Relative brightness that misleads the flow; of the untouched images that show it. Bands of 50 % are refused, dark corners
# pass (test_image_plausibility.py).
BANDS, BANDED_SHARE = 0.3, 0.1
# Of the flow under load: images before contact that move more do not stand still. Frames one image late are refused
# (test_image_plausibility.py).
BEFORE_SHARE = 0.5
# Of the flow under load, of a single image: one of another indentation at depth is left out (test_image_plausibility.py).
ONE_BEFORE_SHARE = 0.3
# Robust standard deviations of the untouched images' flow, beyond which one is no accident: of normal noise one in 500
# million; 14 kinds of honest images pass (test_image_plausibility.py).
SPREADS = 6.0
# A session whose images move by less is judged by its answer alone, as one of 0.005 px in test_image_plausibility.py.
MOVES_PX = 0.1
# Depths whose ratio is less do not have to differ. With forces over depth^1.5 and a scatter of 0.05 mm they are one
# depth (tests/recording/test_image_plausibility.py).
GROWS = 1.1
# Of the flow at a shallower depth of the same place, below which the deeper has lost it: an untouched image at the deepest
# depth is left out (test_image_plausibility.py).
LEAST_GROWTH = 0.7
# Ratio of flows of one indentation's images at one depth, beyond which one is of another row: one late image of five is
# left out, with relaxation as small as in 14 honest kinds none (test_image_plausibility.py).
ALIKE = 2.0
# Between the reference frame's darkest and brightest thousandth: 12 bits saved as 16 have 256 / 16 levels
# (test_image_plausibility.py).
LEAST_LEVELS = 16
# Of the textured pixels. Measured on speckle, dots and drawn particles: right flow loses 1 % at most, flow with 2 % of
# wrong pixels 3.5 % and more (tests/recording/test_flow_lost.py).
MOST_LOST = 0.02
# Expected motion below which two noiseless images may be equal: 0.0001 mm deeper passes, a frozen frame is found
# (test_image_plausibility.py).
REPEAT_PX = 0.1


def image_readable(series: ImageSeries) -> list[Finding]:
    """Return an error where an image of the sample cannot be read."""
    if not series.error:
        return []
    found, _, remedy = series.error.rpartition("; ")
    return [Finding("image_readable", "error", "image", f"cannot be used: {found}", remedy)]


def image_content(series: ImageSeries) -> list[Finding]:
    """Return the images that are black, white or without texture; a reference frame of few grey levels is an error."""
    if series.levels < LEAST_LEVELS:
        text = f"of the reference frame spans {series.levels:.0f} of 256 grey levels"
        remedy = (
            "record with more light, or scale 10 and 12 bits to the whole range before they are saved as 16"
        )
        limit = float(LEAST_LEVELS)
        return [Finding("image_content", "error", "image", text, remedy, value=series.levels, limit=limit)]
    table = series.table[series.blank]
    findings = [
        _one(
            row,
            "image_content",
            f"{row.image} is {_look(row.grey)}: {100 * row.gain:.0f} % of the reference frame's brightness and"
            f" {100 * row.texture:.0f} % of its texture",
            "check lamps, exposure and focus, and record it anew",
            *((row.texture, LEAST_TEXTURE) if row.texture < LEAST_TEXTURE else (row.gain, LEAST_LIGHT)),
        )
        for row in table.itertuples()
    ]
    return mostly(findings, len(series.table))


def _look(grey: float) -> str:
    return "black" if grey < DARK else "white" if grey > BRIGHT else "without texture"


def image_exposure(series: ImageSeries) -> list[Finding]:
    """Return the images whose brightness steps against the untouched image of their indentation, or those around.

    Lamps that warm or age change slowly, and a lamp that was switched between two indentations changes both images.
    """
    table = series.shown
    zero = table[table["phase"] == "zero"].groupby("press")["gain"].mean()
    around = table["gain"].rolling(11, center=True, min_periods=1).median()
    usual = table["press"].map(zero).astype(float).fillna(around)
    step = (table["gain"] / usual - 1).abs()
    held = table["phase"] != "zero"
    findings = [
        _one(
            row,
            "image_exposure",
            f"{row.image} has {100 * row.gain / usual[row.Index]:.0f} % of the brightness before contact: exposure or gain"
            " changed by itself",
            "switch automatic exposure and gain of the camera off and record anew",
            step[row.Index],
            EXPOSURE_STEP,
        )
        for row in table[held & (step > EXPOSURE_STEP)].itertuples()
    ]
    return mostly(findings, int(held.sum()))


def image_bands(series: ImageSeries) -> list[Finding]:
    """Return the images whose rows or columns are bright in bands, where untouched images show the same light."""
    table = series.shown
    untouched = table[table["phase"] == "zero"]
    if "bands" not in table or untouched.empty or (untouched["bands"] > BANDS).mean() < BANDED_SHARE:
        return []
    findings = [
        _one(
            row,
            "image_bands",
            f"{row.image} has bands of +-{100 * row.bands:.0f} % brightness against the reference frame: light that flickers"
            " under a rolling shutter",
            "expose for a whole number of periods of the light (multiples of 1/100 s at 50 Hz, of 1/120 s at 60 Hz), or"
            " light with direct current, and record anew",
            row.bands,
            BANDS,
        )
        for row in table[table["bands"] > BANDS].itertuples()
    ]
    return mostly(findings, len(table))


def image_repeats(series: ImageSeries) -> list[Finding]:
    """Return the images equal to an earlier one, pixel by pixel, while the surface must have moved between them.

    Noise makes any two images of a camera differ. Without noise images may be equal where nothing moved: at the same depth
    of one place, or at depths so close that no grey level changes.
    """
    seen: dict[str, tuple[float, float, float]] = {series.reference: (np.nan, np.nan, 0.0)}
    findings = []
    for row, depth in zip(series.shown.itertuples(), series.depth):
        x, y, earlier = seen.setdefault(row.pixels, (row.x_mm, row.y_mm, depth))
        same_place = (x, y) == (row.x_mm, row.y_mm) or min(depth, earlier) <= 0
        moved_mm = abs(depth - earlier) if same_place else max(depth, earlier)
        moved_px = moved_mm * series.px_per_mm
        if moved_px > REPEAT_PX:
            findings.append(
                _one(
                    row,
                    "image_repeats",
                    f"{row.image} equals an earlier one in every pixel, though depth went from {earlier:g} to {depth:g} mm",
                    "the camera or its buffer repeated a frame: record it anew",
                    moved_px,
                    REPEAT_PX,
                    "px",
                )
            )
    return mostly(findings, len(series.table))


def image_in_step(series: ImageSeries) -> list[Finding]:
    """Return that images move before contact as they do under load, lag or lead the readings, or show nothing of them."""
    before, spread = series.floor_px
    table = series.shown
    if len(table) < 2 or not (series.depth > 0).any():
        return []
    if max(before, series.answer_px) > MOVES_PX:
        why = lag(table, series.depth)
        if not why and len(series.before) and before > BEFORE_SHARE * series.answer_px:
            why = "the flow does not fit this surface, or the images belong to other rows"
        if why:
            text = f"before contact move by {before:.2g} px and those under load by {series.answer_px:.2g} px: {why}"
            remedy = "save each image when its row is read, after the stage has come to rest"
            limit = BEFORE_SHARE * series.answer_px
            return [
                Finding(
                    "image_in_step", "error", "images", text, remedy, value=before, limit=limit, unit="px"
                )
            ]
    if series.answer_px <= before + SPREADS * spread:
        return [_silent(series, before, spread)]
    return []


def _silent(series: ImageSeries, before: float, spread: float) -> Finding:
    """Return that images show nothing of the indentations: an error where these are deep enough to be seen."""
    limit = before + SPREADS * spread
    deepest = float(series.depth.max())
    expected = series.least_px_per_mm * deepest
    text = (
        f"do not respond to the indentations: flow {series.answer_px:.2g} px at depths up to {deepest:g} mm"
    )
    level: Level = "error" if expected > limit else "note"
    remedy = "check that the camera sees the gel and that images and rows match"
    if level == "note":
        text, remedy = text + ", within that before contact", "none where the indentations are that shallow"
    return Finding(
        "image_in_step", level, "images", text, remedy, value=series.answer_px, limit=limit, unit="px"
    )


def image_before_touch(series: ImageSeries) -> list[Finding]:
    """Return single images before contact that move as those under load do."""
    before, spread = series.floor_px
    limit = max(before + SPREADS * spread, ONE_BEFORE_SHARE * series.answer_px)
    table = series.before[series.before["flow_px"] > limit]
    findings = [
        _one(
            row,
            "image_before_touch",
            f"{row.image} before contact moves by {row.flow_px:.2g} px",
            "the indenter was still in contact, or the image belongs to another row: record it anew",
            row.flow_px,
            limit,
            "px",
        )
        for row in table.itertuples()
    ]
    return mostly(findings, len(series.before))


def image_alike(series: ImageSeries) -> list[Finding]:
    """Return single images whose flow is not that of the other images of their indentation at the same depth."""
    _, spread = series.floor_px
    held = series.shown.assign(depth_mm=series.depth)[series.depth > 0]
    depth = held["depth_mm"].round(2)
    usual = held.groupby([held["press"], depth])["flow_px"].transform("median")
    few, many = usual / ALIKE - SPREADS * spread, usual * ALIKE + SPREADS * spread
    findings = [
        _one(
            row,
            "image_alike",
            f"{row.image} moves by {row.flow_px:.2g} px, the median of this indentation's by {usual[row.Index]:.2g} px",
            "the camera lagged, or the image belongs to another row: record the indentation anew",
            row.flow_px,
            few[row.Index] if row.flow_px < few[row.Index] else many[row.Index],
            "px",
        )
        for row in held[(held["flow_px"] < few) | (held["flow_px"] > many)].itertuples()
    ]
    return mostly(findings, len(held))


def image_grows(series: ImageSeries) -> list[Finding]:
    """Return the indentations whose images move less than those at a smaller depth of the same place.

    Only loading counts: before contact, load and dwell. A place with one depth says nothing, as a camera may not see it.
    """
    before, spread = series.floor_px
    held = series.shown.assign(depth_mm=series.depth)[series.depth > 0]
    findings, compared = [], 0
    for _, place in held.groupby([held["x_mm"].round(2), held["y_mm"].round(2)], sort=False):
        presses = place.groupby("press", sort=False).agg(
            depth=("depth_mm", "max"), flow=("flow_px", "median")
        )
        for press, (depth, flow) in presses.iterrows():
            shallower = presses["flow"][presses["depth"] * GROWS < depth]
            if shallower.empty:
                continue
            compared += 1
            # the median: one image of another row among the shallower ones is not the fault of this one
            limit = LEAST_GROWTH * float(shallower.median()) - SPREADS * spread
            if flow >= limit or limit <= before:
                continue
            rows = place[place["press"] == press]
            text = f"move by {flow:.2g} px at {depth:g} mm, less than at smaller depths at this site"
            remedy = (
                "the images belong to another row, or the flow lost the surface: record the indentation anew"
            )
            first = rows.iloc[0]
            findings.append(
                Finding(
                    "image_grows", "excluded", "image", text, remedy, press, float(first["time_s"]), flow, limit, "px",
                    tuple(rows.index),
                )
            )  # fmt: skip
    return mostly(findings, compared)


def flow_lost_of(table: pd.DataFrame) -> list[Finding]:
    """Return the indentations whose displacements the flow could not follow; their rows stay, `flow_lost` next to them."""
    remedy = "these features are no displacements: press less deep, or record finer texture, more pixels or more light"
    lost = table[table["flow_lost"] > MOST_LOST].drop_duplicates("press")
    return [
        Finding(
            "flow_lost",
            "note",
            "flow",
            f"of {row.image} fits the image on all but {100 * row.flow_lost:.1f} % of the textured pixels",
            remedy,
            str(row.press),
            float(row.time_s),
            float(row.flow_lost),
            MOST_LOST,
        )
        for row in lost.itertuples()
    ]


def _one(row, test, found, remedy, value, limit, unit="") -> Finding:
    """Return the exclusion of one image."""
    return Finding(
        test, "excluded", "image", found, remedy, str(row.press), float(row.time_s), float(value), float(limit), unit,
        (row.Index,),
    )  # fmt: skip


IMAGE_TESTS: dict[str, Callable[[ImageSeries], list[Finding]]] = {
    "image_readable": image_readable,
    "image_content": image_content,
    "image_bands": image_bands,
    "image_exposure": image_exposure,
    "image_repeats": image_repeats,
    "image_in_step": image_in_step,
    "image_before_touch": image_before_touch,
    "image_alike": image_alike,
    "image_grows": image_grows,
}
