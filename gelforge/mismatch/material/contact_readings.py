"""Indentations of a ball and Hertz's half space, a pair of load cells and their equality: readings and changes."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.materials.basis.common_form import ForcePair, IndentationTest
from gelforge.materials.basis.statistics import row_noise
from gelforge.materials.small_tests.microindentation import contact_point
from gelforge.materials.small_tests.trials import from_rest, pressed_rows
from gelforge.mismatch.material.material_effects import decades, factor, lost, relaxations, softenings
from gelforge.mismatch.material.material_readings import (
    FORCE_CLASS,
    Change,
    Readings,
    binned,
    means,
    misfit_covariance,
    reduced,
    same,
)
from gelforge.mismatch.model.effect import Parameter

CONTACT = 0.02  # of the largest depth: the touch that Hertz's fit finds
CALIBRATED = "load cells are calibrated to 1 to 2 %, a moment or a bypass changes it by some more"


def press_readings(press: IndentationTest) -> Readings:
    """Return an indentation with approach and withdrawal next to Hertz's ball fitted to its approach; raises ValueError."""
    if press.segment is None:
        raise ValueError(f"{press.sample}: one way only; adhesion and creep need the way back and a hold")
    names, kinds = zip(*press.segment_kinds)
    if "load" not in kinds:
        raise ValueError(f"{press.sample}: no approach among its segments {list(names)}")
    approach = press.in_segment(names[kinds.index("load")])
    # Hertz's depth dependence on a half space is that of any ball
    touch = contact_point(approach.position_mm, approach.force_N, press.ball_radius_mm or 1.0)
    hertz = np.maximum(approach.position_mm - touch, 0.0) ** 1.5
    (rest, k), *_ = np.linalg.lstsq(np.column_stack([hertz**0, hertz]), approach.force_N, rcond=None)
    d = press.position_mm - touch
    deepest, timed = float(d.max()), press.time_s is not None
    time = np.asarray(press.time_s, dtype=float) if timed else np.arange(len(d), dtype=float)
    groups, segment = [], []
    for number, (name, kind) in enumerate(zip(names, kinds)):
        # rows farther from the sample only give the zero
        near = np.flatnonzero((press.segment == name) & (d > -8 * deepest))
        along = time[near] if kind == "hold" else np.arcsinh(8 * d[near] / deepest)
        groups += (bins := binned(along, near, 60))
        segment += [number] * len(bins)
    table = reduced(groups, segment, at=d, share=d / deepest, time_s=time).assign(
        branch=np.array(kinds)[segment],
        part=np.array(names)[segment],
        sample=press.sample,
        test="indentation",
    )
    table["is_base"] = table["segment"] == kinds.index("load")
    hertz = k * np.maximum(d, 0.0) ** 1.5
    y, base, share = means(groups, press.force_N - rest), means(groups, hertz), table["share"].to_numpy()
    push = float(y.max())
    noise = np.hypot(row_noise(approach.force_N) / np.sqrt([len(g) for g in groups]), FORCE_CLASS * push)
    slope = 1.5 * k * np.sqrt(np.maximum(table["at"].to_numpy(), 0.0))
    misfit = float(np.sqrt(np.mean((y - base)[table["is_base"] & (base > 0)] ** 2)))
    zero = 0.01 * push  # an optical lever's zero moves by as much between ways
    C = np.diag(noise**2) + zero**2 * same(table["segment"])
    C += misfit_covariance(share, misfit) + (CONTACT * deepest) ** 2 * np.outer(slope, slope)
    said = [text for text in press.findings if "bending" in text]
    said += ["no time is recorded: relaxation cannot be distinguished from the order of rows"] * (not timed)
    readings = Readings(
        table, y, base, C, noise, np.full(len(y), misfit), zero,
        f"Hertz's ball on a half space, F = k d^1.5, fitted to the approach of {press.sample}",
        tuple(f"{press.sample}: {text}" for text in said),
    )  # fmt: skip
    changes = _of_sensor(readings, push, timed)
    if timed:
        fitted = table["is_base"].to_numpy()
        ramp = max(float(np.ptp(table["time_s"][fitted & (base > 0)])), 1e-6)
        taus = decades(ramp, float(np.ptp(time)))
        gone = means(groups, lost(time, hertz, taus, float(time[0])))
        changes += [_no_tension(change) for change in relaxations(base, fitted, gone, taus)]
    if "unload" in kinds:
        W = np.clip(share, 0, 1) ** 2.5  # energy of F ~ d^1.5, of the largest
        changes += softenings(W, np.ones(len(W)), (table["branch"] == "unload").to_numpy())
        changes += _adhesions(d, press.segment == names[-1], groups, deepest, push)
    return readings.changed_by(changes)


def _of_sensor(readings: Readings, push: float, timed: bool) -> list[Change]:
    """Return an offset of each way but the approach, and a drift of the zero."""
    segment, bounds = readings.table["segment"].to_numpy(), (-0.3 * push, 0.3 * push)
    others = np.setdiff1d(segment, segment[readings.table["is_base"]])
    why = "5 % of the push between approach and withdrawal"
    offsets = tuple(Parameter(f"offset_{k}", "N", 0.05 * push, bounds, why) for k in others)
    mine = (segment[:, None] == others).astype(float)
    changes = [Change("force_offset", offsets, lambda F, a: F + mine @ a, {"by": "segment"})] * bool(offsets)
    if timed:
        changes.append(_drift(readings.table, 0.05 * push, push, "5 % of the push over the test"))
    return changes


def _drift(table: pd.DataFrame, size: float, largest: float, why: str) -> Change:
    since = (table["time_s"] - table["time_s"].min()).to_numpy()
    drift = Parameter("drift_over_test", "N", size, (-0.3 * largest, 0.3 * largest), why)
    return _added("force_drift", drift, since / max(since.max(), 1e-12))


def _added(name: str, parameter: Parameter, column: np.ndarray | float, hyperparameters=None) -> Change:
    return Change(name, (parameter,), lambda F, a: F + a[0] * column, hyperparameters or {})


def _no_tension(change: Change) -> Change:
    """Return relaxation for a contact without adhesion: what relaxes cannot pull."""
    return Change(
        change.name,
        change.parameters,
        lambda F, a: np.maximum(change.apply(F, a), 0.0),
        change.hyperparameters,
    )


def _adhesions(d: np.ndarray, last: np.ndarray, groups, deepest: float, push: float) -> list[Change]:
    """Return adhesion: from the turn on a pull that grows to its full size over a way, and lets go at a height.

    Between the pull of a stiff contact (Johnson, Kendall & Roberts 1971: over the depth itself, lets go at once) and that of
    threads that stay attached far above the surface. last: rows of the last way.
    """
    why = "pull-off forces of soft sticky gels are as large as the push"
    pull, turn = Parameter("pull_off", "N", push, (0.0, 20 * push), why), float(d[last].max())
    # none where the record ends before the ball is back at the surface
    above = max(-float(d[last].min()), 0.0)
    heights = deepest * np.sinh(np.linspace(0, np.arcsinh(8 * above / deepest), 16)) / 8
    changes = []
    for way in (0.5 * deepest, 2.0 * deepest):
        for height in np.unique(heights):
            pulled = means(groups, np.where(last & (d > -height), np.expm1(-(turn - d) / way), 0.0))
            hyperparameters = {"way_mm": way, "lets_go_above_mm": float(height)}
            changes.append(_added("adhesion", pull, pulled, hyperparameters))
    return changes


def pair_readings(pair: ForcePair) -> Readings:
    """Return the second of two load cells next to the first: both carry the same force, so they should read the same.

    Whatever the body between them does enters both alike: no property of a material changes their difference.
    """
    one, two = from_rest(pair)
    mean = (one + two) / 2
    largest = float(mean.max())
    groups, segment, parts = [], [], []
    for number, (place, rows) in enumerate(pressed_rows(pair), start=1):
        top = rows.start + int(np.argmax(mean[rows])) + 1
        for branch, near in (("load", np.arange(rows.start, top)), ("unload", np.arange(top, rows.stop))):
            groups += (bins := binned(mean[near], near, 8, 0.0))
            segment += [(number, branch)] * len(bins)
            parts += [(branch, f"indentation {number}", place)] * len(bins)
    if len(groups) < 10:
        raise ValueError(
            f"{pair.source}: no indentation that rises by half of its force; press between the load cells"
        )
    F1, F2 = means(groups, one), means(groups, two)
    time = np.arange(len(one), dtype=float) if pair.time_s is None else np.asarray(pair.time_s, dtype=float)
    table = reduced(groups, pd.factorize(pd.Series(segment))[0], at=one, share=one / largest, time_s=time)
    table[["branch", "part", "place"]] = parts
    table = table.assign(sample=pair.sample, test="force_pair", is_base=False)
    count = np.array([len(g) for g in groups])
    noise = np.hypot(np.hypot(row_noise(one), row_noise(two)) / np.sqrt(count), FORCE_CLASS * largest)
    C = np.diag(noise**2) + (FORCE_CLASS * largest) ** 2 * same(table["part"])
    # what comes with the load at a place and is no gain: friction at the fixture, a force that bypasses a load cell
    C += (0.05 * largest) ** 2 * same(table["place"])
    per_row = means(groups, np.gradient(one))  # [N] from one reading to the next
    # load cells that are not read at one instant: either value may be up to a reading old, now more and now less
    C += 0.5**2 * (np.diag(per_row**2) + np.outer(per_row, per_row))
    said: tuple[str, ...] = ()
    if pair.time_s is not None and (np.diff(pair.time_s) == 0).mean() > 0.5:
        said = (
            "time stamps are coarser than the readings: a delay between the load cells is known in readings only",
        )
    words = "equality of both load cells, which carry the same force"
    readings = Readings(table, F2, F1, C, noise, np.zeros(len(F1)), FORCE_CLASS * largest, words, said)
    return readings.changed_by(
        _of_pair(readings, largest, per_row),
        "no property of the body between the load cells enters their difference: none is shown or excluded",
    )


def _of_pair(readings: Readings, largest: float, per_row: np.ndarray) -> list[Change]:
    """Return what the second load cell may read differently."""
    base, table, size = readings.base, readings.table, 0.01 * largest
    places, bounds = table["place"].unique().tolist(), (-0.3 * largest, 0.3 * largest)
    by_place = tuple(Parameter(f"gain_at_{p}", "1", 0.03, (-0.3, 0.3), CALIBRATED) for p in places)
    mine = np.column_stack([table["place"] == p for p in places]).astype(float)
    gain = Parameter("gain", "1", 0.03, (-0.3, 0.3), CALIBRATED)
    offset = Parameter("offset", "N", size, bounds, "1 % of the largest force beyond the zero")
    late = Parameter(
        "delay", "readings", 1.0, (-5.0, 5.0), "load cells that are read one after the other: one reading"
    )
    lag = Parameter("lag", "1", 0.01, (-0.1, 0.1), "load cells lag by less than 1 % of their range")
    back = (table["branch"] == "unload").to_numpy() * 4 * base * (1 - base / largest)
    changes = [factor("force_gain", gain, np.ones(len(base)), {"by": "load cell"})]
    if len(places) > 1:
        changes.append(Change("force_gain", by_place, lambda F, a: F * (1 + mine @ a), {"by": "place"}))
    return [
        *changes,
        _added("force_offset", offset, 1.0),
        _drift(table, size, largest, "1 % of the largest force"),
        _added("clock_offset", late, -per_row),
        _added("force_hysteresis", lag, back),
    ]
