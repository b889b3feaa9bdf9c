"""A force channel that saturates where the signal is largest: readings at one largest value, without the channel's noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy.stats import beta, binom

from gelforge.recording.plausibility.findings import CHANCE, LEAST_PAIRS, Finding, force_left_out, mostly
from gelforge.recording.plausibility.indentations import scatter_N
from gelforge.recording.plausibility.repeats import RAW

if TYPE_CHECKING:
    from gelforge.recording.plausibility.session import SessionData

# Clipped SYNTHETIC channels are found; coarse, noisy and quiet ones pass (tests/recording/test_saturation.py):
LEAST_PRESSES = 3  # of a depth, to know how often two sites read the same
# Noise beyond rounding: so large a share differs by so many steps. Noise of less than a tenth of a step of 0.05 N passes
# (test_saturation.py).
STEPS_APART, APART_SHARE = 2, 0.02
# Of the channel, with the scatter of a reading, by which a force has to be beyond the largest value: 3 standard deviations.
# A channel that stops at 35 % of its largest force is found, a gel that levels off passes (test_saturation.py).
STUCK_STEPS = 3.0
# Steps of the channel between sites; less and rounding alone makes them equal, as sites that differ by 2 % on steps of 0.02
# N (test_saturation.py).
SPREAD_STEPS = 4
# On the share of sites that read the same by chance: of a normal distribution 0.399 x 2.56 step / spread at most fall into
# one step, twice that is allowed; steps of 0.05 N pass (test_saturation.py).
MARGIN = 2.0


def force_saturates(data: SessionData) -> list[Finding]:
    """Return the indentations that reach a largest value which the channel never exceeds and at which it has no noise.

    Three signs of it: neighbouring readings at the largest value are equal, where others differ by noise; indentations
    read it to the last digit, where sites differ at other depths; or where their force at a smaller depth of the same site,
    in proportion to depth, is beyond it: a gel's force grows at least so along the axis that is pressed.
    """
    held = data.readings[data.readings["phase"].isin(["load", "dwell", "shear"])].dropna(subset=RAW)
    held = held[~held.index.isin(data.repeated_rows)]  # of a dead sensor, known as such
    still = data.readings[data.readings["phase"] == "zero"].dropna(subset=RAW)
    if held.empty:
        return []
    findings: dict[str, Finding] = {}
    zeros = {name: float(still[name].median()) if len(still) else 0.0 for name in RAW}
    pressed = max(RAW, key=lambda name: (held[name] - zeros[name]).abs().median())
    for axis, name in enumerate(RAW):
        step, zero = _step(data.readings[name], float(data.session.force.resolution_N[axis])), zeros[name]
        for extreme in (held[name].min(), held[name].max()):
            top = (held[name] == extreme).to_numpy()
            # readings from ft.csv are means of several samples, whose noise is not that of their steps
            noiseless = data.log is None and _without_noise(held, still, name, top, step)
            if (
                noiseless
                or _without_sites(held, zero, name, top, step)
                or (name == pressed and _short_of_proportion(data, held, zero, name, top, step))
            ):
                for finding in _findings(held, name[:2], extreme, top):
                    findings.setdefault(finding.press, finding)
    return mostly(list(findings.values()), data.readings["press"].nunique())


def _step(readings: pd.Series, resolution: float) -> float:
    """Return the step of a channel [N]: what it resolves, or the least distance of two readings, if that is more."""
    levels = np.unique(np.round(readings.dropna(), 9))
    return max(resolution, float(np.diff(levels).min())) if len(levels) >= LEAST_PAIRS else resolution


def _without_noise(held, still, name: str, top: np.ndarray, step: float) -> bool:
    """Return whether neighbouring readings at the largest value are equal too often for the channel's noise."""
    same = (
        (held["press"] == held["press"].shift()) & (held["depth_mm"] == held["depth_mm"].shift())
    ).to_numpy()
    before = np.append(False, top[:-1])
    ours, both = same & (top | before), same & top & before
    rest = (still["press"] == still["press"].shift()).to_numpy()
    groups = [np.diff(still[name], prepend=np.nan)[rest]]
    change = np.diff(held[name], prepend=np.nan)
    depth = held["depth_mm"].round(2).to_numpy()
    groups += [change[same & ~ours & (depth == d)] for d in np.unique(depth)]
    groups = [np.abs(group) for group in groups if len(group) >= LEAST_PAIRS]
    if not groups or not both.any():
        return False
    if np.mean(np.concatenate(groups) > (STEPS_APART - 0.5) * step) < APART_SHARE:
        return False
    equal = max(_at_most(int((group == 0).sum()), len(group)) for group in groups)
    return bool(binom.sf(both.sum() - 1, ours.sum(), equal) < CHANCE)


def _without_sites(held: pd.DataFrame, zero: float, name: str, top: np.ndarray, step: float) -> bool:
    """Return whether more indentations reach exactly the largest value than read the same at other depths."""
    reading = held.assign(top=top, depth=held["depth_mm"].round(2)).groupby(["press", "depth"], sort=False)
    presses = reading.agg(top=("top", "any"), first=(name, "first")).reset_index()
    others = presses[~presses["top"]]
    groups = [group["first"] for _, group in others.groupby("depth") if len(group) >= LEAST_PRESSES]
    if sum(map(len, groups)) < len(others) / 2:
        groups = [others["first"]]  # depths chosen at random
    groups = [group for group in groups if len(group) >= LEAST_PRESSES and group.median() != zero]
    if not groups or not top.any():
        return False
    extreme = float(held.loc[top, name].iloc[0])
    spread = abs(extreme - zero) * min(_spread(group) / abs(group.median() - zero) for group in groups)
    if spread < SPREAD_STEPS * step:
        return False
    # at most so many of a normal distribution's values fall into one step; and as many as read the same elsewhere
    equal = max((group.value_counts().iloc[0] - 1) / len(group) for group in groups)
    equal = max(equal, min(1.0, MARGIN * step / spread))
    same_depth = presses[presses["depth"].isin(presses.loc[presses["top"], "depth"])]
    return bool(binom.sf(presses["top"].sum() - 1, len(same_depth), equal) < CHANCE)


def _short_of_proportion(
    data, held: pd.DataFrame, zero: float, name: str, top: np.ndarray, step: float
) -> bool:
    """Return whether sites, or two depths of one, read exactly the largest value where their force has to be beyond it.

    Where a force below the largest value levels off too, the gel does it.
    """
    size, site = (held[name] - zero).abs(), held["press"].map(data.indentations["site"])
    table = held.assign(top=top, size=size, site=site, depth=held["depth_mm"].round(2))
    table = table.groupby(["site", "depth"]).agg(top=("top", "any"), size=("size", "median")).reset_index()
    steepest = (table["size"] / table["depth"]).groupby(table["site"])
    least = table["depth"] * steepest.transform(lambda slope: slope.cummax().shift())
    beyond = least - table["size"] > STUCK_STEPS * np.hypot(step, scatter_N(data.readings, [name])[0])
    reached = table[table["top"]].groupby("site").size()
    gel = (beyond & ~table["top"]).any()
    return bool(not gel and beyond.any() and (len(reached) >= LEAST_PRESSES or reached.max() > 1))


def _spread(values: pd.Series) -> float:
    """Return the range between the first and the last tenth, 2.56 standard deviations of a normal distribution."""
    return float(np.ptp(np.quantile(values, [0.1, 0.9])))


def _at_most(count: int, of: int) -> float:
    """Return the upper end of a 95 % interval of a share (Clopper and Pearson)."""
    return 1.0 if count == of else float(beta.ppf(0.975, count + 1, of - count))


def _findings(held, axis: str, extreme: float, top: np.ndarray) -> list[Finding]:
    reached = held[top]
    at = set(zip(reached["press"], reached["depth_mm"]))
    clipped = held[[pair in at for pair in zip(held["press"], held["depth_mm"])]]
    return [
        force_left_out(
            test="force_saturates",
            press=str(press),
            time_s=float(rows["time_s"].iloc[0]),
            value=abs(float(extreme)),
            limit=abs(float(extreme)),
            found=f"({axis}) stays at {extreme:.6g} N to the last digit and never exceeds it, as a saturated sensor does",
            remedy="use a larger range of the force sensor (force.range_N), or press less deep",
            rows=tuple(rows.index),
        )
        for press, rows in clipped.groupby("press", sort=False)
    ]
