"""How well depth zero was found: as sessions state it, as repeated presses show it, or assumed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from gelforge.mismatch.noise import LEAST_FREEDOM
from gelforge.mismatch.observations import Observations

TOUCHDOWN_MM = 0.02  # assumed where neither the session nor repeated presses say how well zero was found


def with_touchdown(found: Observations) -> Observations:
    """Fill scatter of touchdown that no session states: from repeated presses, or assumed and told.

    Repeats show only a zero that each press found by itself.
    """
    missing = ~np.isfinite(found.touchdown_mm)
    if not missing.any():
        return found
    by_press = np.asarray(found.zero_by) == "press"
    scatter = _repeated_touchdown(found, by_press)
    assumed = missing & ~by_press if scatter is not None else missing
    said = (
        f"how well depth zero was found is not stated (depth_zero.scatter_mm): {TOUCHDOWN_MM} mm is assumed"
    )
    return replace(
        found,
        touchdown_mm=np.where(assumed, TOUCHDOWN_MM, np.where(missing, scatter or 0.0, found.touchdown_mm)),
        cannot_know=(*found.cannot_know, *([said] if assumed.any() else [])),
    )


def _repeated_touchdown(found: Observations, of: np.ndarray) -> float | None:
    """Return the scatter [mm] of touchdown that repeated presses show in Fz, less the noise; None with few repeats.

    of (R,) bool: the readings that count. Of each press the depth by which all its loading readings are off their means, as
    the slope has it; presses less places are the repeats.
    """
    table = found.table.assign(fz=found.force[:, 2], noise=found.noise_N[:, 2], zero=found.zero_N[:, 2])
    loads = table[(table["phase"] == "load") & of & np.isfinite(table["fz"])]
    squares, freedom = 0.0, 0
    for _, of_site in loads.groupby("site"):
        curve = of_site.groupby("depth_mm")["fz"].mean()
        if len(curve) < 2:
            continue
        slopes = pd.Series(np.gradient(curve.to_numpy(), curve.index.to_numpy()), curve.index)
        means = of_site.groupby("depth_mm")["fz"]
        repeated = of_site[means.transform("size") > 1]
        k, off = repeated["depth_mm"].map(slopes), repeated["fz"] - means.transform("mean")
        sums = pd.DataFrame(
            {
                "press": repeated["press"],
                "kf": k * off,
                "kk": k**2,
                "noise": (k * repeated["noise"]) ** 2,
                "zero": k * repeated["zero"],
            }
        )
        sums = sums.groupby("press").sum()
        sums = sums[sums["kk"] > 0]
        if len(sums) < 2:
            continue
        own = ((sums["noise"] + sums["zero"] ** 2) / sums["kk"] ** 2).mean()
        squares += ((sums["kf"] / sums["kk"]) ** 2).sum() - (len(sums) - 1) * own
        freedom += len(sums) - 1
    return float(np.sqrt(max(squares / freedom, 0.0))) if freedom >= LEAST_FREEDOM else None
