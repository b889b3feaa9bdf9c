"""The lag of every stop and start of the stage, and the law of the clock that they make.

Where the stage stops or leaves under load, force and image bend at once, whatever the material relaxes: the time of the
bend in the signal less that in the stage is the lag. A clock's law is
``signal time = stage time + lag + rate * stage time``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from gelforge.importing.clocks import Match, Signal
from gelforge.importing.refusals import ImportingError
from gelforge.importing.stage_motion import Excursion
from gelforge.recording.plausibility.bends import BEND_S, WINDOW_S, centred_bend
from gelforge.robust import SIGMA_OF_MEDIAN

# Lags of SYNTHETIC logs are found within 5 ms, with drift and jitter too (tests/importing/test_clocks.py):
LOCAL_S, LOCAL_STEP_S = 1.0, 0.01  # around the coarse lag, each indentation on its own
# Between which rates are taken. 0.06 s, three periods of 50 Hz mains, which average out; lags of noisy logs are found
# within 5 ms (tests/importing/test_clocks.py).
RATE_STEPS = 6
# Of the lag of the whole session. At 1 mm/s it is 0.01 mm of depth, the precision of contact points (judgement).
LARGEST_SE_S = 0.01
# Over the session: drift beyond both. A clock that gains 900 ppm in eight indentations is refused, even ones pass
# (tests/importing/test_clocks.py).
DRIFT_S, DRIFT_SE = 0.006, 4.0
# Of an indentation's lag off the line: 11 dropped frames and steps of 0.25 s are named (tests/importing/test_clocks.py,
# test_logs_of_programs.py).
JUMP_S, JUMP_SPREADS = 0.02, 5.0
# Two make a line whatever they show.
LEAST_PRESSES = 3
# Of a jump of the lag, within which a step between two stamps explains it: steps of 0.25 s name the clock that made them
# (tests/importing/test_logs_of_programs.py).
STEP_SHARE = 0.25


@dataclass(frozen=True)
class Bends:
    """The lags of single bends: when on the stage's clock [s], lag [s], standard deviation [s], number of the excursion."""

    at_s: np.ndarray
    lag_s: np.ndarray
    sd_s: np.ndarray
    excursion: np.ndarray

    def by_press(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time, weighted mean lag and its standard deviation of each indentation [s]."""
        rows = []
        for number in np.unique(self.excursion):
            of_press = self.excursion == number
            weight = 1 / self.sd_s[of_press] ** 2
            lag = np.average(self.lag_s[of_press], weights=weight)
            rows.append((self.at_s[of_press].mean(), lag, np.sqrt(1 / weight.sum())))
        return tuple(np.array(rows).T)


@dataclass(frozen=True)
class ClockLaw:
    """Signal time = stage time + lag + rate * stage time; all since the first rows of their logs [s]."""

    lag_s: float
    rate: float
    se_s: float  # standard error of the lag in the middle of the session
    bends: Bends | None

    def on_stage(self, time_s: np.ndarray) -> np.ndarray:
        """Return times of the signal on the stage's clock [s]."""
        return (np.asarray(time_s) - self.lag_s) / (1 + self.rate)


def find_bends(
    stage: Signal, excursions: list[Excursion], log: Signal, match: Match, contact_mm: float
) -> Bends:
    """Return the bends of a log at stops and starts of the stage under load.

    Parameters
    ----------
    stage : Signal
        Travel [mm].
    excursions : list of Excursion
        Those of the stage.
    log : Signal
        What grows with depth, in any unit.
    match : Match
        The coarse lag, about which bends are looked for.
    contact_mm : float
        Travel at which contact begins.
    """
    rows = []
    for number, excursion in enumerate(excursions):
        if stage.values[excursion.top] <= contact_mm or not excursion.waits:
            continue
        lag = _local_lag(stage, excursion, log, match, contact_mm)
        if lag is None:
            continue
        for k, wait in enumerate(excursion.waits):
            for at, side in ((wait.arrive_s, -1), (wait.leave_s, 1)):
                bend = _bend(stage, excursion, k, side, log, lag, contact_mm)
                if bend is not None:
                    rows.append((at, *bend, number))
    ats, lags, sds, numbers = np.array(rows).T if rows else np.zeros((4, 0))
    return Bends(ats, lags, sds, numbers.astype(int))


def _local_lag(stage, excursion, log, match, contact_mm) -> float | None:
    """Return the lag [s] at which the signal of one indentation follows its depth best, None where it is not covered."""
    time = np.arange(stage.time_s[excursion.first], stage.time_s[excursion.last], LOCAL_STEP_S)
    model = np.maximum(np.interp(time, *stage) - contact_mm, 0.0) ** match.power
    pressed = np.flatnonzero(model > 0)
    if len(pressed) < 2:
        return None
    keep = slice(max(0, pressed[0] - 50), pressed[-1] + 50)
    time = time[keep]
    model = model[keep][RATE_STEPS:] - model[keep][:-RATE_STEPS]  # rates: relaxation changes them little
    lag_s, room = match.lag_s, min(LOCAL_S, 0.5 * (time[-1] - time[0]))
    if time[0] + lag_s - room < log.time_s[0] or time[-1] + lag_s + room > log.time_s[-1]:
        return None
    lags = lag_s + np.arange(-room, room + LOCAL_STEP_S / 2, LOCAL_STEP_S)
    seen = np.interp(time[None, :] + lags[:, None], *log)
    seen = seen[:, RATE_STEPS:] - seen[:, :-RATE_STEPS]
    size = np.sqrt((seen**2).sum(axis=1) * (model @ model))
    return float(lags[(seen @ model / np.maximum(size, 1e-300)).argmax()])


def _bend(
    stage: Signal, excursion: Excursion, number: int, side: int, log: Signal, lag: float, contact_mm: float
) -> tuple[float, float] | None:
    """Return lag and its standard deviation [s] of the bend where the stage stops (side -1) or leaves (1) a wait.

    The window holds motion under load on one side of the bend and rest on the other.
    """
    wait = excursion.waits[number]
    at = wait.arrive_s if side < 0 else wait.leave_s
    if not np.isfinite(at) or wait.travel_mm <= contact_mm:
        return None
    rows = slice(excursion.first, wait.first) if side < 0 else slice(wait.last, excursion.last + 1)
    clear = stage.time_s[rows][stage.values[rows] <= contact_mm]
    others = (
        [w.leave_s for w in excursion.waits[:number]]
        if side < 0
        else [w.arrive_s for w in excursion.waits[number + 1 :]]
    )
    ends = np.concatenate([clear, others, [stage.time_s[excursion.first], stage.time_s[excursion.last]]])
    distance = -side * (at - ends)
    moving = min(WINDOW_S, np.nanmin(distance[distance > 0], initial=WINDOW_S))
    rest = np.nan_to_num(wait.leave_s - wait.arrive_s, nan=stage.time_s[wait.last] - stage.time_s[wait.first])
    before, after = (moving, min(rest, WINDOW_S))[::-side]
    if min(before, after) <= BEND_S:
        return None
    return centred_bend(at, lag, before - BEND_S, after - BEND_S, side, *log)


def refined_lag(bends: Bends, otherwise: float) -> float:
    """Return the lag [s] that most indentations' bends have; otherwise: where they show none."""
    if not len(bends.lag_s):
        return otherwise
    _, lag, sd = bends.by_press()
    return _robust_mean(lag, sd)


def clock_law(
    bends: Bends,
    known: float | None,
    drift: bool,
    what: str,
    key: str,
    stamps: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
) -> ClockLaw:
    """Return the law of a clock from its bends. Raises ImportingError where they make none, with the key that settles it.

    known: the lag that the mapping gives, which is kept. drift: whether the clock may gain or lose. stamps: of the signal
    and of the stage [s], where each row has its own: none of these rows can be lost without a trace.
    """
    if known is not None and not drift:
        return ClockLaw(known, 0.0, 0.0, bends)
    if len(np.unique(bends.excursion)) < LEAST_PRESSES:
        raise ImportingError(
            f"{what}: {len(np.unique(bends.excursion))} indentations show when the stage stops or leaves, at least"
            f" {LEAST_PRESSES} are needed to align its clock; set {key}.lag_s, or log faster and wait longer at depth"
        )
    at, lag, sd = bends.by_press()
    straight, offset, slope_se = _line(at, lag, sd)
    change = straight * np.ptp(at)
    drifts = abs(change) > max(DRIFT_S, DRIFT_SE * slope_se * np.ptp(at))
    law = offset + straight * at if drifts else np.full(len(at), _robust_mean(lag, sd))
    _refuse_jumps(at, lag, law, what, key, stamps)
    if drifts and not drift:
        causes, remedies = _without_stamps(key, stamps)
        rate = f", or a rate is wrong by {abs(straight):.3g} of itself" if causes else ""
        raise ImportingError(
            f"{what}: its clock {'gains' if change > 0 else 'loses'} {abs(change) * 1e3:.3g} ms over {np.ptp(at):.3g} s"
            f" ({straight * 1e6:.3g} ppm) against the stage's, the limit is {DRIFT_S * 1e3:g} ms"
            f"{f': {causes}{rate}; {remedies}, or' if causes else ';'} set {key}.drift: true to correct it in proportion to"
            " time, or use one clock"
        )
    scatter = SIGMA_OF_MEDIAN * np.median(np.abs(lag - law)) / np.sqrt(max(len(lag) - 2, 1))
    se = float(max(scatter, np.sqrt(1 / (1 / sd**2).sum())))
    if se > LARGEST_SE_S:
        raise ImportingError(
            f"{what}: its lag is known to {2 * se * 1e3:.2g} ms only (two standard errors of {len(lag)} indentations), the"
            f" limit is {2 * LARGEST_SE_S * 1e3:g} ms; set {key}.lag_s, or log faster"
        )
    if drift:
        return ClockLaw(float(offset), float(straight), se, bends)
    return ClockLaw(float(law[0]), 0.0, se, bends)


def _line(at, lag, sd) -> tuple[float, float, float]:
    """Return slope, offset and the slope's standard error of a line through lags that outliers do not bend."""
    weight = np.ones(len(at))
    spread = np.inf
    for _ in range(10):
        w = weight / (sd**2 + np.median(sd) ** 2)
        middle = np.average(at, weights=w)
        inertia = (w * (at - middle) ** 2).sum()
        slope = (w * (at - middle) * lag).sum() / inertia
        offset = np.average(lag, weights=w) - slope * middle
        off = lag - offset - slope * at
        spread = max(SIGMA_OF_MEDIAN * float(np.median(np.abs(off))), 1e-4)
        weight = np.minimum(1.0, 2 * spread / np.maximum(np.abs(off), 1e-12))
    few = np.sqrt(len(at) / max(len(at) - 2, 1))  # two of them are the line's own
    weight = 1 / np.maximum(sd, few * spread) ** 2
    slope_se = 1 / np.sqrt((weight * (at - np.average(at, weights=weight)) ** 2).sum())
    return float(slope), float(offset), float(slope_se)


def _robust_mean(lag, sd) -> float:
    middle = np.median(lag)
    spread = max(SIGMA_OF_MEDIAN * float(np.median(np.abs(lag - middle))), 1e-4)
    good = np.abs(lag - middle) <= 3 * spread
    return float(np.average(lag[good], weights=1 / (sd[good] ** 2 + spread**2)))


def _refuse_jumps(at, lag, law, what: str, key: str, stamps) -> None:
    """Raise ImportingError where the lags of indentations leave their line: a clock was set, or frames or rows were lost."""
    steady = median_filter(lag, 3, mode="nearest")  # one indentation alone that was misread is no jump
    steps, off = np.abs(np.diff(steady)), np.abs(steady - law)
    limit = max(JUMP_S, JUMP_SPREADS * SIGMA_OF_MEDIAN * float(np.median(np.abs(np.diff(lag)))))
    if max(off.max(), steps.max()) <= limit:
        return
    k = int(steps.argmax())
    words = (
        f"{what}: its lag jumps from {steady[k]:.3f} to {steady[k + 1]:.3f} s between the indentations at {at[k]:.1f} and"
        f" {at[k + 1]:.1f} s, the limit is {limit * 1e3:.2g} ms"
    )
    signal, stage = stamps
    if signal is not None and stage is not None:
        raise ImportingError(
            f"{words}: {_stepped((signal, stage), steady[k : k + 2], at[k : k + 2], limit, key)}"
        )
    causes, remedies = _without_stamps(key, stamps)
    raise ImportingError(f"{words}: {causes}; {remedies}, or record again")


def _without_stamps(key: str, stamps) -> tuple[str, str]:
    """Return what may be lost of the logs whose rows have no stamps of their own, and the remedies; "" where all have."""
    signal, stage = stamps
    lost = []
    if signal is None and key == "camera":
        lost.append(("frames were dropped", "name their own time stamps (camera.times, camera.from_name)"))
    elif signal is None:
        lost.append(("rows were dropped", f"name time stamps of each row in {key}.time"))
    if stage is None:
        lost.append(("rows of the stage's log were dropped", "name time stamps of each row in stage.time"))
    return " or ".join(cause for cause, _ in lost), " or ".join(remedy for _, remedy in lost)


def _stepped(stamps, lags, at, limit: float, key: str) -> str:
    """Return which of two clocks was set between two indentations, and what to do.

    stamps: of the signal and of the stage [s]; lags, at (2,): before and after. A clock that is set leaves one step between
    its rows that is longer by the change of the lag.
    """
    jump = float(lags[1] - lags[0])
    remedy = f"split the session there into two, or log both with one steady clock ({key}.rate_hz where rows are even)"
    for whose, time, sign, lag in (
        (f"the clock of {key}", stamps[0], 1, lags),
        ("the stage's clock", stamps[1], -1, (0, 0)),
    ):
        first = np.searchsorted(time, [at[0] + min(lag), at[1] + max(lag)])
        near = slice(max(int(first[0]) - 1, 0), int(first[1]) + 1)
        steps = np.diff(time[near])
        if not len(steps):
            continue
        longer = float(steps.max() - np.median(np.diff(time)))
        if abs(longer - sign * jump) <= max(limit, STEP_SHARE * abs(jump)):
            where = float(time[near][int(steps.argmax())])
            return f"{whose} steps by {longer:.3g} s at {where:.5g} s after its beginning; {remedy}"
    return f"one of the clocks was set, or rows were stamped late; {remedy}"
