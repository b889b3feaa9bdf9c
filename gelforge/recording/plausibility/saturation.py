"""A force channel that saturates where the signal is largest: readings at one largest value, without the channel's noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy.stats import beta, binom

from gelforge.recording.plausibility.findings import Finding, mostly

if TYPE_CHECKING:
    from gelforge.recording.plausibility.session import SessionData

RAW = ["fx_raw_N", "fy_raw_N", "fz_raw_N"]
CHANCE = 1e-6  # of so many readings, or indentations, at exactly the largest value of an honest channel
LEAST_PAIRS = 10  # of neighbours, to know how often two readings are equal
LEAST_PRESSES = 3  # of a depth, to know how often two sites read the same
STEPS_APART, APART_SHARE = (
    2,
    0.02,
)  # noise beyond rounding: so many neighbours differ by so many steps of the channel
SPREAD_STEPS = 4  # steps of the channel between sites; less and rounding alone makes them equal
MARGIN = 2.0  # on the share of sites that read the same by chance


def force_saturates(data: SessionData) -> list[Finding]:
    """Return the indentations that reach a largest value which the channel never exceeds and at which it has no noise.

    Two signs of it, both compared with the rest of the session: neighbouring readings at the largest value are equal,
    where others differ by noise; indentations read it to the last digit, where sites differ at other depths.
    """
    held = data.readings[data.readings["phase"].isin(["load", "dwell", "shear"])].dropna(subset=RAW)
    held = held[~held.index.isin(data.repeated_rows)]  # of a dead sensor, known as such
    still = data.readings[data.readings["phase"] == "zero"].dropna(subset=RAW)
    if held.empty:
        return []
    found: dict[str, Finding] = {}
    for axis, name in enumerate(RAW):
        step = _step(held[name], still[name], float(data.session.force.resolution_N[axis]))
        for extreme in (held[name].min(), held[name].max()):
            top = (held[name] == extreme).to_numpy()
            # readings from ft.csv are means of several samples, whose noise is not that of their steps
            noiseless = data.log is None and _without_noise(held, still, name, top, step)
            if noiseless or _without_sites(held, still, name, top, step):
                for finding in _findings(data, held, name[:2], extreme, top):
                    found.setdefault(finding.press, finding)
    return mostly(list(found.values()), data.readings["press"].nunique())


def _step(held: pd.Series, still: pd.Series, resolution: float) -> float:
    """Return the step of a channel [N]: what it resolves, or the smallest change that is seen, if that is more."""
    changes = np.abs(np.concatenate([np.diff(held), np.diff(still)]))
    changes = changes[changes > 0]
    return max(resolution, float(np.quantile(changes, 0.05)) if len(changes) else resolution)


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


def _without_sites(held: pd.DataFrame, still: pd.DataFrame, name: str, top: np.ndarray, step: float) -> bool:
    """Return whether more indentations reach exactly the largest value than read the same at other depths."""
    reading = held.assign(top=top, depth=held["depth_mm"].round(2)).groupby(["press", "depth"], sort=False)
    presses = reading.agg(top=("top", "any"), first=(name, "first")).reset_index()
    others = presses[~presses["top"]]
    groups = [group["first"] for _, group in others.groupby("depth") if len(group) >= LEAST_PRESSES]
    if sum(map(len, groups)) < len(others) / 2:
        groups = [others["first"]]  # depths chosen at random
    zero = float(still[name].median()) if len(still) else 0.0
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
    own = presses[presses["depth"].isin(presses.loc[presses["top"], "depth"])]
    return bool(binom.sf(presses["top"].sum() - 1, len(own), equal) < CHANCE)


def _spread(values: pd.Series) -> float:
    """Return the range between the first and the last tenth, 2.56 standard deviations of a normal distribution."""
    return float(np.ptp(np.quantile(values, [0.1, 0.9])))


def _at_most(count: int, of: int) -> float:
    """Return the upper end of a 95 % interval of a share (Clopper and Pearson)."""
    return 1.0 if count == of else float(beta.ppf(0.975, count + 1, of - count))


def _findings(data: SessionData, held, axis: str, extreme: float, top: np.ndarray) -> list[Finding]:
    reached = held[top]
    at = set(zip(reached["press"], reached["depth_mm"]))
    own = held[[pair in at for pair in zip(held["press"], held["depth_mm"])]]
    return [
        Finding(
            test="force_saturates",
            level="excluded",
            channel="force",
            press=str(press),
            time_s=float(rows["time_s"].iloc[0]),
            value=abs(float(extreme)),
            limit=abs(float(extreme)),
            unit="N",
            found=f"({axis}) stays at {extreme:.6g} N to the last digit and never exceeds it, as a saturated sensor does",
            remedy="use a larger range of the force sensor (force.range_N), or press less deep",
            rows=tuple(rows.index),
        )
        for press, rows in own.groupby("press", sort=False)
    ]
