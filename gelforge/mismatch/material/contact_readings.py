"""Indentations of a ball beside Hertz's half space, and a pair of load cells beside their equality: readings and effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import erf

from gelforge.materials.basis.common_form import ForcePair, IndentationTest
from gelforge.materials.small_tests.microindentation import contact_point
from gelforge.mismatch.material.material_effects import (
    ORDER,
    SENSOR,
    SOFTENINGS,
)
from gelforge.mismatch.material.material_evidence import Candidate, Readings
from gelforge.mismatch.material.material_readings import FORCE_CLASS, LAW_LENGTH, row_noise
from gelforge.mismatch.material.material_viscosity import Viscous, decades, hereditary, viscous_candidates
from gelforge.mismatch.model.effect import Parameter

ROWS_OF_SEGMENT = 60
NEAR = 8.0  # largest depths: rows farther from the sample than that only give the zero
BASELINE = 0.01  # of the largest push: an optical lever's zero moves by as much between ways
CONTACT = 0.02  # of the largest depth: the touch that Hertz's fit finds
LONGEST_PATH = 3000
ROWS_OF_WAY = 8  # of an indentation between load cells, during its unloading and loading
HEIGHTS = 16  # at which the ball may come free
LEAST_LOADED = 0.05  # of the largest force of a pair
UNDER_LOAD = 0.05  # of the largest force
UNSYNCHRONISED = 0.5  # readings


@dataclass(frozen=True)
class ContactTest:
    """Readings of an indentation or of a pair, the candidates, and what the base is in words."""

    readings: Readings
    candidates: tuple[Candidate, ...]
    base_words: str
    at_unit: str
    no_signature: tuple[str, ...] = ()  # effects that cannot enter here at all


def _scaled(eta: np.ndarray) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda F, a: F * (1 + eta * a[0])


def _less(shape: np.ndarray) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return lambda F, a: F - a[0] * shape


def press_readings(press: IndentationTest) -> ContactTest:
    """Return an indentation with approach and withdrawal beside Hertz's ball fitted to its approach; raises ValueError."""
    if press.segment is None:
        raise ValueError(f"{press.sample}: one way only; adhesion and creep need the way back and a hold")
    names, kinds = zip(*press.segment_kinds)
    if "load" not in kinds:
        raise ValueError(f"{press.sample}: no approach among its segments {list(names)}")
    approach = press.in_segment(names[kinds.index("load")])
    radius = press.ball_radius_mm or 1.0  # Hertz's depth dependence on a half space is that of any ball
    touch = contact_point(approach.position_mm, approach.force_N, radius)
    shape = np.maximum(approach.position_mm - touch, 0.0) ** 1.5
    rest, stiffness = np.linalg.lstsq(
        np.column_stack([np.ones(len(shape)), shape]), approach.force_N, rcond=None
    )[0]
    deepest = float(press.position_mm.max() - touch)
    d = press.position_mm - touch
    hertz = stiffness * np.maximum(d, 0.0) ** 1.5
    measured = press.force_N - rest
    time = np.arange(len(d), dtype=float) if press.time_s is None else np.asarray(press.time_s, dtype=float)
    groups, rows = [], []
    for number, (name, kind) in enumerate(zip(names, kinds)):
        own = np.flatnonzero((press.segment == name) & (d > -NEAR * deepest))
        found = _bins(np.arcsinh(8 * d[own] / deepest) if kind != "hold" else time[own], own)
        groups += found
        rows += [(kind, number, name, k / max(len(found) - 1, 1)) for k in range(len(found))]

    def reduced(values):
        return np.array([values[g].mean(axis=0) for g in groups])

    table = pd.DataFrame(rows, columns=["branch", "segment", "part", "progress"])
    table = table.assign(
        sample=press.sample,
        test="indentation",
        at=reduced(d),
        share=reduced(d) / deepest,
        time_s=reduced(time),
        rate=np.nan,
    )
    table["is_base"] = table["segment"] == kinds.index("load")
    y, base = reduced(measured), reduced(hertz)
    push = float(y.max())
    noise = np.hypot(row_noise(approach.force_N) / np.sqrt([len(g) for g in groups]), FORCE_CLASS * push)
    same = table["segment"].to_numpy()[:, None] == table["segment"].to_numpy()
    slope = 1.5 * stiffness * np.sqrt(np.maximum(table["at"].to_numpy(), 0.0))
    touching = table["is_base"].to_numpy() & (base > 0)
    misfit = float(np.sqrt(np.mean((y - base)[touching] ** 2)))
    share = table["share"].to_numpy()
    law = misfit**2 * np.exp(-np.abs(share[:, None] - share) / LAW_LENGTH)
    C = np.diag(noise**2) + (BASELINE * push) ** 2 * same + law
    C += (CONTACT * deepest) ** 2 * np.outer(slope, slope)
    said = [f"{press.sample}: {text}" for text in press.findings if "bending" in text]
    if press.time_s is None:
        said.append(
            f"{press.sample}: no time is recorded: relaxation cannot be distinguished from the order of rows"
        )
    readings = Readings(table, y, base, C, noise, np.full(len(y), misfit), BASELINE * push, tuple(said))
    candidates = _press_candidates(
        readings, press, reduced, hertz, d, time, deepest, push, press.time_s is not None
    )
    words = f"Hertz's ball on a half space, F = k d^1.5, fitted to the approach of {press.sample}"
    return ContactTest(readings, tuple(candidates), words, "mm")


def _bins(x: np.ndarray, own: np.ndarray) -> list[np.ndarray]:
    """Return rows (k groups) in equal bins of x, in the order of time."""
    if len(own) <= ROWS_OF_SEGMENT:
        return [own[i : i + 1] for i in range(len(own))]
    number = np.minimum(
        (ROWS_OF_SEGMENT * (x - x.min()) / max(np.ptp(x), 1e-300)).astype(int), ROWS_OF_SEGMENT - 1
    )
    groups = [own[number == k] for k in np.unique(number)]
    return sorted(groups, key=lambda g: g[0])


def _press_candidates(readings, press, reduced, hertz, d, time, deepest, push, timed) -> list[Candidate]:
    base, branch = readings.base, readings.table["branch"].to_numpy()
    found = []
    if timed:
        loading = readings.table["is_base"].to_numpy() & (base > 0)
        ramp = max(float(np.ptp(readings.table["time_s"].to_numpy()[loading])), 1e-6)
        taus = decades(ramp, float(np.ptp(time)))
        thin = np.unique(np.linspace(0, len(d) - 1, min(len(d), LONGEST_PATH)).astype(int))
        h = hereditary(time[thin], hertz[thin], taus, float(time[0]))
        full = np.column_stack([np.interp(np.arange(len(d)), thin, c) for c in (hertz[thin, None] - h).T])
        lost = reduced(full)
        own = readings.table["is_base"].to_numpy()
        rho = base[own] @ lost[own] / (base[own] @ base[own])
        V = rho * base[:, None] - lost
        found += [_no_tension(c, base) for c in viscous_candidates(Viscous(V, rho, ()), taus, base)]
    if (branch == "unload").any():
        found += _adhesions(d, press, reduced, deepest, push)
        Wm = 1.0
        W = np.clip(readings.table["share"].to_numpy(), 0, 1) ** 2.5  # energy of F ~ d^1.5
        back = branch == "unload"
        one_over_r = Parameter(
            "one_over_r", "1", 0.3, (0.0, 1.0), "r of 1.5 to 5 in filled rubber (Ogden & Roxburgh 1999)", 1
        )
        for m, beta in SOFTENINGS:
            eta = -erf((Wm - W) / (m + beta)) * back
            found.append(
                Candidate(
                    "mullins", (one_over_r,), _scaled(eta), ORDER["mullins"],
                    shape={"m_of_largest_energy": m, "beta": beta},
                )
            )  # fmt: skip
    segment = readings.table["segment"].to_numpy()
    others = [k for k in np.unique(segment) if not readings.table["is_base"].to_numpy()[segment == k].all()]
    if others:
        mine = np.column_stack([segment == k for k in others]).astype(float)
        size = 0.05 * push
        offsets = tuple(
            Parameter(
                f"offset_{k}",
                "N",
                size,
                (-0.3 * push, 0.3 * push),
                "5 % of the push between approach and withdrawal",
            )
            for k in others
        )
        found.append(Candidate("force_offset", offsets, lambda F, a: F + mine @ a, SENSOR, {"by": "segment"}))
    if timed:
        since = readings.table["time_s"].to_numpy() - readings.table["time_s"].min()
        since = since / max(since.max(), 1e-12)
        drift = Parameter(
            "drift_over_test", "N", 0.05 * push, (-0.3 * push, 0.3 * push), "5 % of the push over the test"
        )
        found.append(Candidate("force_drift", (drift,), lambda F, a: F + since * a[0], SENSOR + 1))
    return found


def _no_tension(candidate: Candidate, base: np.ndarray) -> Candidate:
    """Return relaxation for a contact without adhesion: what relaxes cannot pull."""
    inner = candidate.apply
    return Candidate(
        candidate.name, candidate.parameters, lambda F, a: np.maximum(inner(F, a), 0.0), candidate.order, candidate.shape,
    )  # fmt: skip


def _adhesions(d, press, reduced, deepest, push) -> list[Candidate]:
    """Return adhesion: from the turn on a pull that grows to its full size over a way, and lets go at a height.

    Between the pull of a stiff contact (Johnson, Kendall & Roberts 1971: over the depth itself, lets go at once) and that of
    threads that stay attached far above the surface.
    """
    pull = Parameter(
        "pull_off",
        "N",
        push,
        (0.0, 20 * push),
        "pull-off forces of soft sticky gels are as large as the push",
        1,
    )
    names = list(dict.fromkeys(press.segment))
    last = press.segment == names[-1]
    turn = float(d[last].max())
    above = max(
        -float(d[last].min()), 0.0
    )  # none where the record ends before the ball is back at the surface
    heights = deepest * np.sinh(np.linspace(0, np.arcsinh(8 * above / deepest), HEIGHTS)) / 8
    found = []
    for way in (0.5, 2.0):
        for height in np.unique(heights):
            attached = last & (d > -height)
            shape = reduced(np.where(attached, -np.expm1(-(turn - d) / (way * deepest)), 0.0))
            found.append(
                Candidate(
                    "adhesion", (pull,), _less(shape), ORDER["adhesion"],
                    {"way_mm": way * deepest, "lets_go_above_mm": float(height)},
                )
            )  # fmt: skip
    return found


def pair_readings(pair: ForcePair) -> ContactTest:
    """Return the second of two load cells beside the first: both carry the same force, so they should read the same.

    Whatever the body between them does enters both alike: no property of a material changes their difference.
    """
    one, two = pair.force_1_N - _rest(pair.force_1_N), pair.force_2_N - _rest(pair.force_2_N)
    mean = (one + two) / 2
    largest = float(mean.max())
    loaded = mean > LEAST_LOADED * largest
    edges = np.flatnonzero(np.diff(np.r_[False, loaded, False].astype(int)))
    groups, rows = [], []
    for number, (a, b) in enumerate(zip(edges[::2], edges[1::2])):
        if b - a < 4 or np.ptp(mean[a:b]) < 0.5 * mean[a:b].max():
            continue
        top = a + int(np.argmax(mean[a:b]))
        place = str(a) if pair.position is None else str(pair.position[a])
        for branch, own in (("load", np.arange(a, top + 1)), ("unload", np.arange(top + 1, b))):
            if not len(own):
                continue
            level = np.minimum(
                (ROWS_OF_WAY * mean[own] / (1.0001 * mean[own].max())).astype(int), ROWS_OF_WAY - 1
            )
            found = sorted((own[level == k] for k in np.unique(level)), key=lambda g: g[0])
            groups += found
            rows += [(branch, f"{number}/{branch}", f"indentation {number + 1}", place, k / max(len(found) - 1, 1))
                     for k in range(len(found))]  # fmt: skip
    if len(groups) < 10:
        raise ValueError(
            f"{pair.source}: no indentation that rises by half of its force; press between the load cells"
        )

    def reduced(values):
        return np.array([values[g].mean() for g in groups])

    F1, F2 = reduced(one), reduced(two)
    table = pd.DataFrame(rows, columns=["branch", "segment", "part", "place", "progress"])
    table["segment"] = pd.factorize(table["segment"])[0]
    time = np.arange(len(one), dtype=float) if pair.time_s is None else np.asarray(pair.time_s, dtype=float)
    table = table.assign(
        sample=pair.sample,
        test="force_pair",
        at=F1,
        share=F1 / largest,
        time_s=reduced(time),
        rate=np.nan,
        is_base=False,
    )
    count = np.array([len(g) for g in groups])
    noise = np.hypot(np.hypot(row_noise(one), row_noise(two)) / np.sqrt(count), FORCE_CLASS * largest)
    place, press = table["place"].to_numpy(), table["part"].to_numpy()
    C = np.diag(noise**2) + (FORCE_CLASS * largest) ** 2 * (press[:, None] == press)
    # what comes with the load at a place and is no gain: friction at the fixture, a force that bypasses a load cell
    C += (UNDER_LOAD * largest) ** 2 * (place[:, None] == place)
    per_row = reduced(np.gradient(one))  # [N] from one reading to the next
    # load cells that are not read at one instant: either value may be up to a reading old, now more and now less
    C += np.diag((UNSYNCHRONISED * per_row) ** 2) + UNSYNCHRONISED**2 * np.outer(per_row, per_row)
    said = []
    if pair.time_s is not None and (np.diff(pair.time_s) == 0).mean() > 0.5:
        said.append(
            "time stamps are coarser than the readings: a delay between the load cells is known in readings only"
        )
    readings = Readings(table, F2, F1, C, noise, np.zeros(len(F1)), FORCE_CLASS * largest, tuple(said))
    words = "equality of both load cells, which carry the same force"
    return ContactTest(
        readings, tuple(_pair_candidates(readings, largest, per_row)), words, "N",
        ("viscoelastic", "mullins", "ageing", "temperature", "adhesion"),
    )  # fmt: skip


def _pair_candidates(readings: Readings, largest: float, per_row: np.ndarray) -> list[Candidate]:
    base, table = readings.base, readings.table
    places = list(dict.fromkeys(table["place"]))
    source = "load cells are calibrated to 1 to 2 %, a moment or a bypass changes it by some more"
    gain = Parameter("gain", "1", 0.03, (-0.3, 0.3), source)
    by_place = tuple(Parameter(f"gain_at_{p}", "1", 0.03, (-0.3, 0.3), source) for p in places)
    mine = np.column_stack([table["place"] == p for p in places]).astype(float)
    found = [Candidate("force_gain", (gain,), lambda F, a: F * (1 + a[0]), SENSOR, {"by": "load cell"})]
    if len(places) > 1:
        found.append(
            Candidate("force_gain", by_place, lambda F, a: F * (1 + mine @ a), SENSOR, {"by": "place"})
        )
    size = 0.01 * largest
    offset = Parameter(
        "offset", "N", size, (-0.3 * largest, 0.3 * largest), "1 % of the largest force beyond the zero"
    )
    found.append(Candidate("force_offset", (offset,), lambda F, a: F + a[0], SENSOR + 1))
    since = table["time_s"].to_numpy() - table["time_s"].min()
    since = since / max(since.max(), 1e-12)
    drift = Parameter(
        "drift_over_test", "N", size, (-0.3 * largest, 0.3 * largest), "1 % of the largest force"
    )
    found.append(Candidate("force_drift", (drift,), lambda F, a: F + since * a[0], SENSOR + 2))
    late = Parameter(
        "delay", "readings", 1.0, (-5.0, 5.0), "load cells that are read one after the other: one reading"
    )
    found.append(Candidate("clock_offset", (late,), lambda F, a: F - per_row * a[0], SENSOR + 4))
    back = (table["branch"] == "unload").to_numpy() * 4 * (base / largest) * (1 - base / largest) * largest
    lag = Parameter("lag", "1", 0.01, (-0.1, 0.1), "load cells lag by less than 1 % of their range")
    found.append(Candidate("force_hysteresis", (lag,), lambda F, a: F + back * a[0], SENSOR + 3))
    return found


def _rest(force: np.ndarray) -> float:
    """Return the reading without load: the median of the lowest tenth."""
    return float(np.median(np.sort(force)[: max(len(force) // 10, 1)]))
