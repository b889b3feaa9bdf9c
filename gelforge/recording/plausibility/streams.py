"""The fast force log ft.csv: shared stamps of a coarse clock are spread, and no gap is bridged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Session
from gelforge.csv_table import read_csv
from gelforge.recording.plausibility.findings import Finding, force_left_out, mostly
from gelforge.recording.tables.checks import RecordingError

FORCE = ["fx_N", "fy_N", "fz_N"]

# Of 37 kinds of honest SYNTHETIC sessions each passes, and each seeded fault is found
# (tests/recording/test_plausibility.py):
WINDOW_S = 0.02  # samples this far from a reading are averaged: less than a camera's frame time
# Samples of a mean. Fewer may be one glitch and its neighbour; slow logs are interpolated
# (tests/recording/test_readings.py).
FEW = 3
# Samples farther apart than this many periods of the log enclose a gap: one or two lost are none. A clock with a jitter of
# 0.9 periods passes, 0.8 s without samples are found (test_plausibility.py).
GAP_PERIODS = 3.0
# The period is this quantile of the steps, so that a log that slows down while idle has no gaps. A log that idles for a
# tenth of its samples has none (tests/recording/test_plausibility.py).
SLOW_SHARE = 0.9
# But at most so many times the median step, so that many gaps do not hide each other. Gaps in most indentations are
# found (tests/recording/test_plausibility.py).
SLOWEST = 10.0
# Of a clock whose samples share stamps: the time between two dwell readings. Stamps of 10 ms are spread, whole seconds are
# refused (test_plausibility.py).
COARSEST_TICK_S = 0.1
# Readings farther than this before or after the whole log: its clock is another. A log that ends before the session is
# refused (test_plausibility.py).
ENDS_S = 1.0


@dataclass(frozen=True)
class ForceLog:
    """The samples of ft.csv in the order of their distinct times."""

    time_s: np.ndarray  # (T,)
    force_N: np.ndarray  # (T, 3) as recorded

    @property
    def gap_s(self) -> float:
        """Return how far apart two neighbouring samples may lie before there is a gap between them [s]."""
        steps = np.diff(self.time_s)
        if not len(steps):
            return 2 * WINDOW_S
        period = min(np.quantile(steps, SLOW_SHARE), SLOWEST * np.median(steps))
        return max(GAP_PERIODS * float(period), 2 * WINDOW_S)

    def around(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the times [s] of the last sample before and the first one after some times; infinite where none is."""
        ends = np.concatenate([[-np.inf], self.time_s, [np.inf]])
        after = np.searchsorted(self.time_s, at) + 1
        return ends[after - 1], ends[after]

    def at(self, at: np.ndarray) -> np.ndarray:
        """Return forces (N, 3) at times: the mean of samples within WINDOW_S, else between neighbours, NaN in a gap.

        Fewer than FEW samples are no mean, except at a gap: they may lie to one side, which is another force on a ramp.
        """
        first = np.searchsorted(self.time_s, at - WINDOW_S)
        last = np.searchsorted(self.time_s, at + WINDOW_S, side="right")
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(self.force_N, axis=0)])  # (T + 1, 3)
        count = (last - first)[:, None]
        mean = (total[last] - total[first]) / np.maximum(count, 1)
        mean = np.round(mean, 9)  # of equal samples their value, for tests of readings that repeat
        between = np.stack([np.interp(at, self.time_s, component) for component in self.force_N.T], axis=1)
        before, after = self.around(at)
        bridged = ((after - before) > self.gap_s)[:, None]
        few = np.where(bridged, np.where(count > 0, mean, np.nan), np.round(between, 9))
        return np.where(count >= FEW, mean, few)


def read_force_log(path: Path, delay_s: float = 0.0) -> ForceLog:
    """Return the samples of ft.csv on the stage's clock, which shows delay_s less than the log's.

    Raises RecordingError where time runs backwards, or where samples share stamps of a clock that is too coarse.
    """
    samples = read_csv(path, numbers=["time_s", *FORCE])
    time = samples["time_s"].to_numpy()
    backward = np.flatnonzero(np.diff(time) < 0)
    if len(backward):
        line = samples.index[backward[0] + 1]
        raise RecordingError(
            f"{path}, row {line}: time_s {time[backward[0] + 1]:.9g} after {time[backward[0]]:.9g} runs back; "
            "sort the rows by time_s, or remove the second start of the clock"
        )
    stamps, counts = np.unique(time, return_counts=True)
    if counts.max() > 1:
        tick = float(np.median(np.diff(stamps))) if len(stamps) > 1 else np.inf
        if tick > (1 + 1e-6) * COARSEST_TICK_S:
            line = samples.index[np.flatnonzero(np.diff(time) == 0)[0] + 1]
            raise RecordingError(
                f"{path}, row {line}: {counts.max()} samples share the stamp {time[np.diff(time).argmin()]:.9g} s of a "
                f"clock with steps of {tick:.3g} s, the limit is {COARSEST_TICK_S} s; record time_s with milliseconds"
            )
        time = spread_stamps(stamps, counts, tick)
    return ForceLog(time - delay_s, samples[FORCE].to_numpy())


def spread_stamps(stamps: np.ndarray, counts: np.ndarray, tick: float) -> np.ndarray:
    """Return a time for every sample: those that share a stamp lie evenly between it and the next, at most a tick on.

    Parameters
    ----------
    stamps : numpy.ndarray
        (n,), distinct times [s], rising.
    counts : numpy.ndarray
        (n,) int, samples that share each.
    tick : float
        Of the clock [s].

    Returns
    -------
    numpy.ndarray
        (counts.sum(),) [s].
    """
    # a gap behind a stamp is no room for its samples
    room = np.minimum(np.append(np.diff(stamps), tick), tick)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.repeat(stamps, counts) + number * np.repeat(room / counts, counts)


def check_ends(path: Path, table: pd.DataFrame, log: ForceLog) -> None:
    """Raise RecordingError for a reading more than ENDS_S before or after the whole log."""
    at = table["time_s"].to_numpy()
    beyond = np.maximum(log.time_s[0] - at, at - log.time_s[-1])
    if beyond.max() > ENDS_S:
        line = table.index[beyond.argmax()]
        raise RecordingError(
            f"{path}: no force sample within {ENDS_S} s of the reading at {table.at[line, 'time_s']} s "
            f"(indentations.csv, row {line}): the log runs from {log.time_s[0]:.6g} to {log.time_s[-1]:.6g} s; "
            "both files need one clock, and the log must last as long as the readings"
        )


def gap_findings(table: pd.DataFrame, raw: np.ndarray, log: ForceLog, session: Session) -> list[Finding]:
    """Return the indentations of which readings (N, 3), NaN there, fall into gaps of the log.

    Without any zero reading left an untared indentation loses all of its force. Gaps in most indentations are errors, unless
    the session confirms `gap`.
    """
    lost = np.isnan(raw).any(axis=1)
    before, after = log.around(table["time_s"].to_numpy())
    at = pd.DataFrame(
        {"press": table["press"], "gap": after - before, "lost": lost, "zero": table["phase"] == "zero"}
    )
    findings = []
    for press, rows in at[at["press"].isin(at.loc[at["lost"], "press"])].groupby("press", sort=False):
        blind = not session.force.tared and rows.loc[rows["zero"], "lost"].all()
        first = rows.index[rows["lost"].argmax()]
        findings.append(
            force_left_out(
                test="gap",
                press=str(press),
                time_s=float(table.at[first, "time_s"]),
                value=float(rows.at[first, "gap"]),
                limit=log.gap_s,
                unit="s",
                found=f"has no sample in ft.csv for {rows.at[first, 'gap']:.3g} s around this reading",
                remedy="record ft.csv without gaps, or at every time that is read",
                rows=tuple(rows.index if blind else rows.index[rows["lost"]]),
            )
        )
    return findings if "gap" in session.confirmed else mostly(findings, at["press"].nunique())
