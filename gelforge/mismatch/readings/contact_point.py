"""How well depth zero was found: as sessions state it, as repeated indentations show it, or assumed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from gelforge.config import DepthZero
from gelforge.mismatch.readings.noise import LEAST_FREEDOM
from gelforge.mismatch.readings.observations import Observations

CONTACT_POINT_MM = (
    0.02  # assumed where neither the session nor repeated indentations say how well zero was found
)


def depth_scatter(zero: DepthZero, instead_mm: float | None = None) -> tuple[float, float]:
    """Return the standard deviations [mm] of the depth from one indentation to the next and of the session's contact point;
    nan: missing.

    The one that the session does not find its zero by is 0 where nothing is said of either; where the contact point is
    stated and the indentations are not, repeats may show these. instead_mm stands in place of what is stated of `zero.by`.
    """
    press, session = zero.press_scatter_mm, zero.session_scatter_mm
    if zero.by == "session":
        unsaid = 0.0 if session is None else np.nan
        session = session if instead_mm is None else instead_mm
        return unsaid if press is None else press, np.nan if session is None else session
    press = press if instead_mm is None else instead_mm
    return np.nan if press is None else press, session or 0.0


def with_contact_point(found: Observations) -> Observations:
    """Fill scatter of the depth that no session states: from repeated indentations, or assumed and reported.

    Repeats show what differs from one indentation to the next; a session's contact point, which all its indentations share,
    is assumed.
    """
    press, session = found.press_depth_mm, found.session_depth_mm
    lone, shared = np.isnan(press), np.isnan(session)
    scatter = _repeated_contact_points(found, press != 0) if lone.any() else None
    beside = session > 0  # with a contact point that is stated, nothing is assumed of indentations
    filled = np.where(beside, 0.0, CONTACT_POINT_MM) if scatter is None else scatter
    said, unseen = [], lone & (scatter is None)
    if shared.any() or (unseen & ~beside).any():
        said.append(
            f"how well the contact point was found is not stated ({_keys(unseen & ~beside, shared)}):"
            f" {CONTACT_POINT_MM} mm is assumed"
        )
    if (unseen & beside).any():
        said.append(
            "the stage's repeatability is not stated (depth_zero.press_scatter_mm) and too few indentations are repeated to"
            " show it: indentations are taken to have no depth error of their own"
        )
    return replace(
        found,
        press_depth_mm=np.where(lone, filled, press),
        session_depth_mm=np.where(shared, CONTACT_POINT_MM, session),
        cannot_know=(*found.cannot_know, *said),
    )


def _keys(*missing: np.ndarray) -> str:
    """Return the keys of session.yaml that are missing: of indentations, of sessions (R,) bool each."""
    names = ("depth_zero.press_scatter_mm", "depth_zero.session_scatter_mm")
    return ", ".join(name for name, some in zip(names, missing) if some.any())


def _repeated_contact_points(found: Observations, of: np.ndarray) -> float | None:
    """Return the scatter [mm] of contact point that repeated indentations show in Fz, less the noise; None with few repeats.

    of (R,) bool: the readings that count. Of each indentation the depth by which all its loading readings are off their
    means, as the slope has it; indentations less places are the repeats.
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
