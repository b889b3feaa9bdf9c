"""Tests of the force: near zero before contact, answering the indentation, growing with depth at a site."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gelforge.recording.plausibility.findings import Finding, force_left_out, mostly
from gelforge.recording.plausibility.indentations import force_over_depth, isolated_floors
from gelforge.recording.plausibility.streams import FORCE

if TYPE_CHECKING:
    from gelforge.recording.plausibility.session import SessionData

AXES = np.array(["fx", "fy", "fz"])

# Of 37 kinds of honest SYNTHETIC sessions each passes, and each seeded fault is found
# (tests/recording/test_plausibility.py):
# Floors: resolution, repeatability and scatter of one reading together (`floor_N`).
TARED_FLOORS = 5.0  # a mean of zero rows this far from zero is no noise
# of the session's largest force: no more than a force sensor of class 1 errs by (ISO 7500-1:2018)
TARED_SHARE = 0.01
# Of a session: fewer are single failures. Sessions whose zero rows read a force are refused, single ones pass
# (tests/recording/test_plausibility.py).
TARED_INDENTATIONS = 0.1
# Of the force at depth: what touches earlier is adhesion or the scatter of depth zero. Zero rows with the force at depth
# are found, a surface 0.1 mm too high and adhesion as large as the force pass (test_plausibility.py).
STEP_SHARE = 0.2
# Above the surface by more than this, or four standard deviations of depth zero, nothing touches: depth zero that is 0.1 mm
# too deep passes (test_plausibility.py).
CLEAR_MM = 0.1
SILENT_FLOORS = TARED_FLOORS
# Of the session's usual force at that depth: softer than that is no site of one sensor. Sites of 0.4 to 1.6 times the usual
# stiffness pass, one without an answer is found (test_plausibility.py).
SILENT_SHARE = 0.1
# Share of indentations that push one way: noise pushes half of them either way, so many of 15 once in 1,000 sessions. Noise
# alone is refused, seven shallow indentations and a deep one pass (test_plausibility.py).
SAME_WAY = 0.9
# Depth zero may be off by this, or by three times its stated scatter: 0.05 mm too high passes in honest sessions of any
# mixture (test_plausibility.py).
OFF_MM = 0.05
# depths that are compared: one this many times the other, as 1.2 mm to 0.8 mm in test_plausibility.py
DEEPER = 1.5
# Of a force in proportion to depth, the least that a gel shows: softening and ageing take less than 60 %. A gel that
# softens by 40 % passes, an indentation with 5 % of its force is found (test_plausibility.py).
FALLS_TO = 0.4
# The floor is then a tenth of the force. Ratios of forces are then known to a sixth, far less than FALLS_TO allows
# (tests/recording/test_plausibility.py).
GROWING_FLOORS = 10.0


def force_before_touch(data: SessionData) -> list[Finding]:
    """Return sessions whose tared zero is none, and indentations whose force steps or touches before contact."""
    return [*tared_zero(data), *steps_before_touch(data)]


def tared_zero(data: SessionData) -> list[Finding]:
    """Return that the zero rows of a tared session read more than nothing, or of which single indentations they do."""
    zero = data.readings[data.readings["phase"] == "zero"].dropna(subset=FORCE)
    if not data.session.force.tared or zero.empty:
        return []
    largest = data.readings[FORCE].abs().max().max()
    noise = TARED_FLOORS * data.floor_N
    limit = np.maximum(noise, TARED_SHARE * largest)
    by_press = zero.groupby("press", sort=False)[
        FORCE
    ].median()  # one outlier among the rows of an indentation is none
    size = by_press.abs().to_numpy() / limit
    far = size.max(axis=1) > 1
    axis = int(size.max(axis=0).argmax())
    worst = int(size[:, axis].argmax())
    read, press = float(by_press.iloc[worst, axis]), str(by_press.index[worst])
    remedy = (
        "set force.tared: false in session.yaml, so that the zero rows of each indentation are subtracted"
    )
    finding = partial(
        Finding, "force_before_touch", channel="force", remedy=remedy, unit="N", value=abs(read)
    )
    if far.mean() > TARED_INDENTATIONS:
        found = (
            f"reads up to {read:.3g} N ({AXES[axis]}, indentation {press}) in the zero rows of a tared session, beyond the"
            f" limit in {far.sum()} of {len(far)} indentations (resolution {data.session.force.resolution_N[axis]:g} N)"
        )
        return [finding(level="error", found=found, limit=float(limit[axis]))]
    if (by_press.abs().to_numpy() > noise).any(axis=1).mean() > TARED_INDENTATIONS:
        found = f"reads up to {read:.3g} N ({AXES[axis]}, indentation {press}) in the zero rows of a tared session"
        return [finding(level="note", found=found, limit=float(noise[axis]))]
    return []


def steps_before_touch(data: SessionData) -> list[Finding]:
    """Return the indentations whose force changes among their zero rows, or while approaching far above the surface."""
    readings, scatter = data.readings, data.session.depth_zero.both_scatter_mm
    clear = -max(CLEAR_MM, 4 * scatter)
    before = (readings["phase"] == "zero") | (
        (readings["phase"] == "approach") & (readings["depth_mm"] < clear)
    )
    rows = readings[before].dropna(subset=FORCE)
    by_press = rows.groupby("press", sort=False)[FORCE]
    spread = by_press.max() - by_press.min()
    largest = data.indentations["push_N"].reindex(spread.index)
    largest = largest.fillna(0.0).to_numpy()[:, None]
    floors = isolated_floors(spread.to_numpy() / data.floor_N)
    limit = np.maximum(floors * data.floor_N, STEP_SHARE * largest)
    findings = []
    for k in np.flatnonzero((spread.to_numpy() > limit).any(axis=1)):
        press, axis = str(spread.index[k]), int((spread.to_numpy()[k] / limit[k]).argmax())
        at = readings.index[readings["press"] == press]
        findings.append(
            force_left_out(
                test="force_before_touch",
                press=press,
                time_s=float(readings.at[at[0], "time_s"]),
                value=float(spread.iloc[k, axis]),
                limit=float(limit[k, axis]),
                found=f"changes by {spread.iloc[k, axis]:.3g} N ({AXES[axis]}) before contact",
                remedy="record zero rows clear of the surface and at rest",
                rows=tuple(at),
            )
        )
    return mostly(findings, len(data.indentations))


def force_repeats(data: SessionData) -> list[Finding]:
    """Return the indentations in which a channel stays at one value, to the last digit, while it should change."""
    runs = data.repeats
    if not runs:
        return []
    channels: dict[int, list[str]] = {}
    since: dict[int, int] = {}
    for run in runs:
        for row in run.rows:
            channels.setdefault(row, []).append(f"{AXES[run.axis]} = {run.value:g} N")
            since[row] = min(since.get(row, run.rows[0]), run.rows[0])
    readings = data.readings
    stuck = readings.loc[sorted(channels)]
    findings = []
    for press, rows in stuck.groupby("press", sort=False):
        of_press = readings[readings["press"] == press]
        zero_gone = not data.session.force.tared and (rows["phase"] == "zero").any()
        first = rows.index[0]
        names = ", ".join(dict.fromkeys(channels[first]))
        findings.append(
            force_left_out(
                test="force_repeats",
                press=str(press),
                time_s=float(rows.at[first, "time_s"]),
                value=float(len(rows)),
                unit="rows",
                found=f"repeats one value to the last digit from indentation {readings.at[since[first], 'press']} on"
                f" ({names})",
                remedy="check the sensor's supply and plug, and record these indentations again",
                rows=tuple(of_press.index if zero_gone else rows.index),
            )
        )
    return mostly(findings, len(data.indentations))


def force_answers(data: SessionData) -> list[Finding]:
    """Return the indentations that show no force where the session's others do, or that no indentation shows any.

    A site's own answer at that depth or a shallower one is proof. A site that never answers is compared with the session's
    force over depth; a shallow depth of a site that answers deeper may be above a tilted or domed surface and is let pass.
    """
    every, floor = data.indentations, float(data.floor_N[2])
    if every.empty:
        return []
    if unanswered := _no_answer_at_all(every):
        return [unanswered]
    every = every[~every["row"].isin(data.repeated_rows)]
    usual = force_over_depth(every, GROWING_FLOORS * floor)
    if usual is None:
        return []
    off = max(OFF_MM, 3 * data.session.depth_zero.both_scatter_mm)
    least = SILENT_SHARE * usual.at(every["depth_mm"].to_numpy() - off)
    silent = every["push_N"].abs().to_numpy() < SILENT_FLOORS * floor
    answered = every["depth_mm"].where(~silent & (every["push_N"].to_numpy() > 0))
    shallowest = answered.groupby(every["site"]).transform("min").to_numpy()
    proved = every["depth_mm"].to_numpy() >= shallowest + off
    never = np.isnan(shallowest) & (every["depth_mm"].to_numpy() >= 0.5 * every["depth_mm"].max())
    wrong = silent & (proved | never) & (least > SILENT_FLOORS * floor)
    findings = [
        force_left_out(
            test="force_answers",
            press=str(press),
            time_s=row.time_s,
            value=abs(row.push_N),
            limit=float(limit),
            found=f"is {row.push_N:.3g} N at {row.depth_mm:g} mm, where {usual.at(row.depth_mm):.3g} N is usual",
            remedy="check sensor and indenter, and record these indentations again",
            rows=tuple(data.readings.index[data.readings["press"] == press]),
        )
        for (press, row), limit in zip(every[wrong].iterrows(), least[wrong])
    ]
    return mostly(findings, len(data.indentations))


def _no_answer_at_all(every: pd.DataFrame) -> Finding | None:
    """Return that the mean force of all indentations is not distinguished from zero by its own scatter, nor by its sign.

    One deep indentation among shallow ones scatters the force, but all push the same way.
    """
    push = every["push_N"].to_numpy()
    if len(push) < 3:
        return None
    error = push.std(ddof=1) / np.sqrt(len(push))
    same_way = max((push > 0).mean(), (push < 0).mean())
    # of the wrong sign it answers too, see checks.check_force
    if abs(push.mean()) > 3 * error or same_way > SAME_WAY:
        return None
    return Finding(
        test="force_answers",
        level="error",
        channel="force",
        value=float(push.mean()),
        limit=float(3 * error),
        unit="N",
        found=f"does not respond to indentation: {push.mean():.3g} N on average over {len(push)} indentations",
        remedy="check force.axes and the sensor; fz_N must fall below zero where the indenter presses",
    )


def force_grows(data: SessionData) -> list[Finding]:
    """Return the indentations whose force is too small against that of a much shallower one at the same site, both loading.

    Forces are those of the first reading at depth, of two dwell or two load rows: relaxation is no fall. Of two that
    contradict each other the one farther from the session's force over depth is blamed.
    """
    floor = float(data.floor_N[2])
    usual = force_over_depth(data.indentations, GROWING_FLOORS * floor)
    if usual is None:
        return []
    known = data.indentations[~data.indentations["row"].isin(data.repeated_rows)]
    off = max(OFF_MM, 3 * data.session.depth_zero.both_scatter_mm)
    findings = []
    for _, site in known.groupby(["site", "phase"], sort=False):
        findings += _fallen(data, site, usual, off, GROWING_FLOORS * floor)
    return mostly(findings, len(data.indentations))


def _fallen(data: SessionData, site: pd.DataFrame, usual, off: float, least: float) -> list[Finding]:
    """Return the findings of one site, blaming one indentation after the other until no two contradict each other."""
    findings: list[Finding] = []
    while len(site) > 1:
        depth, push = site["depth_mm"].to_numpy(), site["first_N"].to_numpy()
        deeper = (depth[:, None] >= DEEPER * depth) & (depth[:, None] - off > depth + off)
        least_push = FALLS_TO * push * depth[:, None] / depth
        fallen = deeper & (push[:, None] < least_push) & (push > least)  # (deep, shallow)
        if not fallen.any():
            return findings
        ratio = np.log(np.maximum(push, least / GROWING_FLOORS) / usual.at(depth))
        doubt = np.abs(ratio - np.median(ratio)) * (fallen.any(axis=0) | fallen.any(axis=1))
        k = int(doubt.argmax())
        against = int(np.flatnonzero(fallen[k] | fallen[:, k])[0])
        press = site.index[k]
        findings.append(
            force_left_out(
                test="force_grows",
                press=str(press),
                time_s=float(site["time_s"].iloc[k]),
                value=float(push[k]),
                limit=float(least_push[k, against]),
                found=(
                    f"does not grow with depth: {push[k]:.3g} N at {depth[k]:g} mm, {push[against]:.3g} N at"
                    f" {depth[against]:g} mm of the same site (indentation {site.index[against]})"
                ),
                remedy="check depth_mm and the force of both indentations, and record the wrong one again",
                rows=tuple(data.readings.index[data.readings["press"] == press]),
            )
        )
        site = site.drop(index=press)
    return findings
