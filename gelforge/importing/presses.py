"""Indentations with their phases, from the stage's excursions and the force; none is lost, invented or slipped off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from gelforge.importing.clocks import Signal, rise, runs_above
from gelforge.importing.contact import Contact, contact_point
from gelforge.importing.refusals import ImportingError
from gelforge.importing.stage_motion import Excursion, Wait
from gelforge.importing.streams import Stream, gap_limit_s
from gelforge.robust import SIGMA_OF_MEDIAN

# Every indentation of SYNTHETIC logs is found; knocks and motions without force are none (tests/importing/test_presses.py):
SMOOTH_S = 0.02  # a period of 50 Hz mains, and the grid of the lags
# Standard deviations of the smoothed force that are no accident: of normal noise one in 500 million. In logs with noise of
# 12 mN no indentation is lost or invented (tests/importing/test_presses.py).
NOISE = 6.0
# And steps of its resolution. A reading that is rounded moves by one step at rest and by two at most between
# neighbours.
STEPS = 2.0
# In contact: shorter is a knock. A sixth of the shortest wait by default (`least_dwell_s`).
LEAST_TOUCH_S = 0.05
# Before and after contact that every log must hold. Zero needs LEAST_ZERO_S and CLEAR_S of it; logs
# that begin later are refused (tests/importing/test_presses.py).
COVERED_S = 0.3
# The zero phase is the last of the rest before contact. Long against noise, and short
# against drift over a minute.
ZERO_S = 2.0
# Five smoothed samples of the force at rest.
LEAST_ZERO_S = 0.1
# From the zero phase to contact. Five smoothing windows, and twice the error to which contact points are found
# (tests/importing/test_presses.py).
CLEAR_S, CLEAR_MM = 0.1, 0.02
# After contact was lost, before the next zero phase. Fifteen smoothing windows (SMOOTH_S),
# in which a gel recovers most.
AFTER_S = 0.3
# Of the indentation's largest force, lost within so long while the stage does not retreat: relaxation by 40 % with 0.6 s
# loses 6 % and passes, a slip of 90 % is refused (tests/importing/test_presses.py).
SLIP_S, SLIP = 0.1, 0.3
# Half of a contact point's interval, where each indentation has its own depth zero. A tenth of an indentation of 1 mm
# changes its force by 15 % (Hertz 1882).
WIDEST_MM = 0.1


@dataclass(frozen=True)
class Press:
    """One indentation on the stage's clock."""

    number: int  # from 1, as the page counts
    excursion: Excursion
    contact: Contact
    touch_s: float
    end_s: float  # contact is lost
    zero_s: tuple[float, float]
    waits: tuple[Wait, ...]  # in contact
    top_s: float  # when it is deepest
    top_mm: np.ndarray  # (3,)
    peak_N: float


@dataclass(frozen=True)
class Presses:
    """What was found: indentations, those left out with the reason, and excursions on which nothing was touched [s]."""

    kept: tuple[Press, ...]
    left_out: tuple[tuple[int, float, str], ...]
    untouched_s: tuple[float, ...]
    smooth_N: np.ndarray  # (m,) force towards the gel above rest, smoothed


def find_presses(
    stage: Stream,
    moves: list[Excursion],
    force_s: np.ndarray,
    push: np.ndarray,
    level_mm: float,
    frames_s: tuple[float, float] | None,
    skip: list[int],
    drop_incomplete: bool,
) -> Presses:
    """Return the indentations. push (m,) [N]: force towards the gel at force_s (m,) [s] on the stage's clock.

    level_mm: travel about which contact begins; frames_s: first and last frame. Raises ImportingError naming the
    indentation and the key that settles it.
    """
    smooth, threshold = _above_rest(force_s, push)
    merged = _merged(stage, moves, force_s, smooth, threshold)
    travel_at = np.interp(force_s, stage.time_s, stage.values[:, 2])
    kept, left_out, untouched, number, before_s = [], [], [], 0, -np.inf
    gaps = np.flatnonzero(np.diff(force_s) > gap_limit_s(force_s))  # rows before them
    for excursion in merged:
        start, end = stage.time_s[excursion.first], stage.time_s[excursion.last]
        a, b = np.searchsorted(force_s, [start, end])
        cut = _cut(stage, excursion, force_s, level_mm, frames_s)
        touches = [
            (a + i, a + j)
            for i, j in runs_above(smooth[a:b], threshold)
            if force_s[a + j] - force_s[a + i] >= LEAST_TOUCH_S
        ]
        if not cut and not touches:
            untouched.append(float(stage.time_s[excursion.top]))
            continue
        number += 1
        at = f"indentation {number} at {stage.time_s[excursion.top]:.1f} s"
        if number in skip:
            left_out.append((number, float(stage.time_s[excursion.top]), "skip"))
        elif cut and drop_incomplete:
            left_out.append((number, float(stage.time_s[excursion.top]), cut))
        elif cut:
            raise ImportingError(f"{at}: {cut}; set incomplete: drop to leave it out, or use the whole log")
        else:
            rows = slice(touches[0][0], touches[-1][1] + 1)
            if gap := [k for k in gaps if rows.start <= k < rows.stop - 1]:
                raise ImportingError(
                    f"{at}: no row between {force_s[gap[0]]:.2f} and {force_s[gap[0] + 1]:.2f} s, while it is pressed;"
                    f" leave it out with skip: [{number}]"
                )
            _refuse_slip(at, number, force_s[rows], smooth[rows], travel_at[rows])
            from_s = max([before_s + AFTER_S, start, *force_s[gaps[gaps < rows.start] + 1]])
            kept.append(_press(at, number, stage, excursion, Signal(force_s, push), travel_at, rows, from_s))
        if touches:
            before_s = float(force_s[touches[-1][1]])
    if unknown := sorted(set(skip) - set(range(1, number + 1))):
        raise ImportingError(f"skip names {unknown}, there are indentations 1 to {number}; correct skip")
    if not kept:
        raise ImportingError(
            f"none of {number} indentations is left; correct skip, or check force.columns and stage.z"
        )
    return Presses(tuple(kept), tuple(left_out), tuple(untouched), smooth)


def _above_rest(force_s, push) -> tuple[np.ndarray, float]:
    """Return the force above rest (m,), smoothed, and the least one that is no noise [N]."""
    size = max(1, round(SMOOTH_S / float(np.median(np.diff(force_s)))))
    grid = np.linspace(force_s[0], force_s[-1], int((force_s[-1] - force_s[0]) / SMOOTH_S) + 2)
    even = np.interp(grid, force_s, uniform_filter1d(push, size, mode="nearest"))
    rest = even - rise(grid, even)  # below rest this is the signal itself
    smooth = uniform_filter1d(push, size, mode="nearest") - np.interp(force_s, grid, rest)
    noise = SIGMA_OF_MEDIAN * float(np.median(np.abs(np.diff(push)))) / np.sqrt(2 * size)
    levels = np.diff(np.unique(push[:20000]))
    step = float(levels.min()) if len(levels) else 0.0
    return smooth, max(
        NOISE * noise, STEPS * step if noise == 0 else 0.0, 0.01 * float(np.quantile(smooth, 0.999))
    )


def _merged(stage, moves, force_s, smooth, threshold) -> list[Excursion]:
    """Return excursions, those joined between which contact was not lost."""
    out: list[Excursion] = []
    for excursion in moves:
        valley = stage.time_s[excursion.first]
        near = slice(*np.searchsorted(force_s, [valley - 0.05, valley + 0.05]))
        if out and len(smooth[near]) and smooth[near].min() > threshold:
            last = out.pop()
            top = max(last.top, excursion.top, key=lambda row: stage.values[row, 2])
            excursion = Excursion(last.first, top, excursion.last, last.waits + excursion.waits)
        out.append(excursion)
    return out


def _cut(stage, excursion, force_s, level_mm, frames_s) -> str:
    """Return which log begins or ends within an indentation, "" where none does."""
    travel = stage.values[excursion.first : excursion.last + 1, 2]
    deep = np.flatnonzero(travel > level_mm)
    if not len(deep):
        return ""
    first, last = excursion.first + deep[0], excursion.first + deep[-1]
    begin, end = stage.time_s[first] - COVERED_S, stage.time_s[last] + COVERED_S
    spans = {"stage": (stage.time_s[0], stage.time_s[-1]), "force": (force_s[0], force_s[-1])}
    if frames_s:
        spans["camera"] = frames_s
    for name, (from_s, to_s) in spans.items():
        if begin < from_s:
            return f"the {name} log begins within it, at {from_s:.2f} s"
        if end > to_s:
            return f"the {name} log ends within it, at {to_s:.2f} s"
    return ""


def _refuse_slip(at, number, force_s, smooth, travel) -> None:
    """Raise ImportingError where the force falls at once while the stage stays or goes deeper."""
    later = np.minimum(np.searchsorted(force_s, force_s + SLIP_S), len(force_s) - 1)
    retreat = travel - travel[later]
    fall = np.where(retreat <= 0.02, smooth - smooth[later], 0.0)
    fall[later == len(force_s) - 1] = 0.0
    k, peak = int(fall.argmax()), float(smooth.max())
    if fall[k] > SLIP * peak:
        raise ImportingError(
            f"{at}: the force falls from {smooth[k]:.3g} to {smooth[later[k]]:.3g} N within {SLIP_S} s at"
            f" {force_s[k]:.2f} s while the stage does not retreat: the indenter slipped off; leave it out with"
            f" skip: [{number}]"
        )


def _press(at, number, stage, excursion, force: Signal, travel_at, rows, from_s) -> Press:
    """Return an indentation whose force exceeds its noise in these rows of the force log; from_s: rest may begin here."""
    time, travel = stage.time_s, stage.values[:, 2]
    force_s, push = force
    guess_s, end_s = float(force_s[rows.start]), float(force_s[rows.stop - 1])
    guess = float(travel_at[rows.start])
    inside = [
        w for w in excursion.waits if w.first > np.searchsorted(time, guess_s) - 1 and time[w.first] < end_s
    ]
    arrive = inside[0].arrive_s if inside and np.isfinite(inside[0].arrive_s) else time[excursion.top]
    before = [time[w.last] for w in excursion.waits if time[w.last] < guess_s and w.travel_mm < guess]
    ramp = slice(*np.searchsorted(force_s, [max([from_s, *before[-1:]]), arrive]))
    contact = contact_point(travel_at[ramp], push[ramp], guess)
    if contact is None:
        raise ImportingError(
            f"{at}: the force has {ramp.stop - ramp.start} samples on the loading ramp, too few for its contact point; leave"
            f" it out with skip: [{number}], or log faster"
        )
    rising = force_s[ramp][travel_at[ramp] >= contact.travel_mm]
    touch_s = float(rising[0]) if len(rising) else guess_s
    waits = tuple(w for w in inside if w.travel_mm > contact.travel_mm)
    before_touch = force_s[(force_s >= from_s) & (force_s <= touch_s - CLEAR_S)]
    # of a noisy force the interval may reach back to the beginning
    for level in (contact.low_mm, contact.travel_mm):
        clear = before_touch[np.interp(before_touch, time, travel) < level - CLEAR_MM]
        if len(clear) and clear[-1] - clear[0] >= LEAST_ZERO_S:
            break
    if not len(clear) or clear[-1] - clear[0] < LEAST_ZERO_S:
        raise ImportingError(
            f"{at}: no rest of {LEAST_ZERO_S} s before contact in which the force is zero; leave it out with"
            f" skip: [{number}]"
        )
    zero = (float(max(clear[0], clear[-1] - ZERO_S)), float(clear[-1]))
    rest = push[(force_s >= zero[0]) & (force_s <= zero[1])].mean()
    top, peak = excursion.top, float(push[rows].max() - rest)
    return Press(
        number, excursion, contact, touch_s, end_s, zero, waits, float(time[top]), stage.values[top], peak
    )


def depth_zero_mm(
    presses: tuple[Press, ...], rule, pressing: str, within_mm: float = WIDEST_MM
) -> np.ndarray:
    """Return the travel (P,) [mm] at depth zero of each indentation. Raises ImportingError where contact points deny the
    rule.

    rule: `session`, `press`, or a surface `at_mm` on the axis that presses. within_mm: of their median, and of that surface.
    """
    points = np.array([press.contact.travel_mm for press in presses])
    if rule == "press":
        half = np.array([(p.contact.high_mm - p.contact.low_mm) / 2 for p in presses])
        k = int(half.argmax())
        if half[k] > WIDEST_MM:
            raise ImportingError(
                f"indentation {presses[k].number} at {presses[k].top_s:.1f} s: its contact point is known to {half[k]:.2g}"
                f" mm only, the limit is {WIDEST_MM} mm; set depth_zero: session, or leave it out with"
                f" skip: [{presses[k].number}]"
            )
        return points
    middle = float(np.median(points))
    k = int(np.abs(points - middle).argmax())
    if abs(points[k] - middle) > within_mm:
        one = np.abs(np.delete(points, k) - middle).max(initial=0.0) <= within_mm
        known = (presses[k].contact.high_mm - presses[k].contact.low_mm) / 2
        if one:
            cause = f"leave it out with skip: [{presses[k].number}], or set depth_zero: press"
        elif known > within_mm:
            cause = f"the force is noisy (this one is known to {known:.2g} mm): set contact_within_mm"
        else:
            cause = (
                "the surface is curved or tilted, or x, y, z are of another frame: set depth_zero: press, or correct"
                " stage.z"
            )
        raise ImportingError(
            f"contact points lie up to {abs(points[k] - middle):.3g} mm off their median (indentation {presses[k].number} at"
            f" {presses[k].top_s:.1f} s), the limit is {within_mm:g} mm: " + cause
        )
    if rule == "session":
        return np.full(len(presses), middle)
    sign = -1 if pressing == "-z" else 1
    declared = sign * rule.at_mm
    if abs(declared - middle) > within_mm:
        raise ImportingError(
            f"depth_zero.at_mm is {rule.at_mm:g} mm, but the force begins at {sign * middle:.3f} mm (median), more than"
            f" {within_mm:g} mm away; correct at_mm, or set depth_zero: session"
        )
    return np.full(len(presses), declared)
