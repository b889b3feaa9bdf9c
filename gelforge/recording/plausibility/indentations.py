"""What the tests of the force compare: one row per indentation, the session's noise, and its own force over depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import theilslopes

from gelforge.indentation.paths.places import DEPTH_MATCH_MM, POSITION_MATCH_MM, visited, within
from gelforge.recording.plausibility.streams import FORCE
from gelforge.robust import SIGMA_OF_MEDIAN

# Of 37 kinds of honest SYNTHETIC sessions each passes, and each seeded fault is found
# (tests/recording/test_plausibility.py):
# of force over depth: a flat punch has 1, a ball on a thick gel 1.5, on a thin one 2 and more
EXPONENTS = 0.8, 2.5
# See isolated_floors: heavy tails pass, and digits lost below them are found where they stand alone (test_plausibility.py).
STEP_FLOORS, LEAST_FLOORS, ISOLATED = 15.0, 8.0, 3.0


@dataclass(frozen=True)
class ForceOverDepth:
    """The force that a session's indentations show at a depth: F = scale depth^exponent, the usual one of all its sites."""

    scale: float
    exponent: float

    def at(self, depth_mm: np.ndarray | float) -> np.ndarray:
        """Return the force towards the gel [N] at depths [mm], 0 above it."""
        return self.scale * np.maximum(depth_mm, 0.0) ** self.exponent


def at_commanded_depth(readings: pd.DataFrame) -> np.ndarray:
    """Return (N,) bool: the load and dwell readings at the indentation's commanded depth, its deepest load or dwell row."""
    held = readings["phase"].isin(["load", "dwell"])
    deepest = readings["depth_mm"].where(held).groupby(readings["press"]).transform("max")
    return (held & within((deepest - readings["depth_mm"]).abs(), DEPTH_MATCH_MM)).to_numpy()


def indentation_table(readings: pd.DataFrame, tolerance_mm: float = POSITION_MATCH_MM) -> pd.DataFrame:
    """Return one row per indentation with a force: site, depth_mm, row and time_s of its first reading at depth, and

    push_N, the mean force towards the gel there, first_N, that of its first reading there, of this phase.

    Index: the indentation's name. tolerance_mm: within which positions are of one site.
    """
    held = readings[at_commanded_depth(readings) & np.isfinite(readings[FORCE]).all(axis=1).to_numpy()]
    rows = held.assign(row=held.index, push_N=-held["fz_N"]).groupby("press", sort=False)
    first = {name: (name, "first") for name in ("order", "x_mm", "y_mm", "row", "time_s", "phase")}
    pushes = {"first_N": ("push_N", "first"), "push_N": ("push_N", "mean")}
    table = rows.agg(depth_mm=("depth_mm", "max"), **first, **pushes)
    return table.assign(site=visited(table[["x_mm", "y_mm"]].to_numpy(), tolerance_mm))


def scatter_N(readings: pd.DataFrame, names: list[str]) -> np.ndarray:
    """Return the standard deviations (3,) [N] of one reading, from differences between neighbours before contact and at
    rest.

    Robust: the median of the differences, so that steps, spikes and relaxation count little.
    """
    same = (readings["press"] == readings["press"].shift()) & (readings["phase"] == readings["phase"].shift())
    still = same & readings["phase"].isin(["zero", "dwell"])
    steps = readings[names].diff()[still].abs().dropna()
    return SIGMA_OF_MEDIAN * steps.median().fillna(0.0).to_numpy() / np.sqrt(2)


def floor_N(readings: pd.DataFrame, resolution_N, repeatability_N) -> np.ndarray:
    """Return (3,) [N]: resolution, repeatability, scatter together, below which a force is not distinguished from none."""
    stated = 0.0 if repeatability_N is None else np.asarray(repeatability_N, float)
    scatter = np.maximum(scatter_N(readings, FORCE), stated)
    return np.hypot(np.asarray(resolution_N, float), scatter)


def isolated_floors(sizes: np.ndarray) -> np.ndarray:
    """Return by axis (3,) how many floors what stands alone must exceed, from how far all of a session (n, 3) lie off.

    Heavy tails reach 8 standard deviations once in 10000 readings, not 15. What lies ISOLATED times farther off than
    anything else in the session is none of its tails: of tails that fall with the fifth power one in 240.
    """
    if len(sizes) < 2:
        return np.full(3, STEP_FLOORS)
    return np.clip(ISOLATED * np.sort(sizes, axis=0)[-2], LEAST_FLOORS, STEP_FLOORS)


def force_over_depth(indentations: pd.DataFrame, least_N: float) -> ForceOverDepth | None:
    """Return the session's own force over depth, from indentations that push by more than least_N; None without any."""
    known = indentations[indentations["push_N"] > least_N]
    if known.empty:
        return None
    depth, push = np.log(known["depth_mm"].to_numpy()), np.log(known["push_N"].to_numpy())
    exponent = 1.5
    if np.ptp(depth) > 0.1:  # depths that differ by more than a tenth
        few = np.linspace(0, len(depth) - 1, min(len(depth), 300)).astype(int)  # pairs grow with the square
        exponent = float(np.clip(theilslopes(push[few], depth[few])[0], *EXPONENTS))
    return ForceOverDepth(float(np.exp(np.median(push - exponent * depth))), exponent)
