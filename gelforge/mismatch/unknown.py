"""What no effect of the catalogue is: readings that differ in some smooth manner, weighed beside the effects that are known.

Its change is a random function: of depth, of place, of the session's time, of the press's own path, or one for each press;
of the pressing force, of the sideways forces, or of all in proportion. Such a function can follow anything of its manner and
pays for that (Kennedy & O'Hagan 2001, doi:10.1111/1467-9868.00294): an effect that is right does the same with an amount or
two and is likelier; effects that only happen to fit are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.mismatch.covariance import Covariance, Draws
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.screen import SCALES, Candidate, chance_of, log_evidence

PLAUSIBLE = 0.1  # of the pressing force, standard deviation; SCALES make it smaller
MODES = {"depth": 6, "place": 4, "time": 8, "path": 3}  # cosines along each coordinate
BESIDE = 3  # cosines over depth beside those of place, path or press
DIRECTIONS = {
    "the pressing force": (2,),
    "the sideways forces": (0, 1),
    "all forces in proportion": None,
}


@dataclass(frozen=True, eq=False)
class Manner:
    """One manner in which readings may differ for an unknown reason."""

    words: str
    directions: np.ndarray  # (n, q) [N], a standard deviation of PLAUSIBLE together
    each: np.ndarray | None = (
        None  # (n,) int, groups of entries that differ each by itself; None: all together
    )

    def beside(self, covariance: Covariance, scale: float) -> Covariance:
        """Return the covariance of n entries with this manner at a scale of its plausible size."""
        wide = scale * self.directions
        if self.each is None:
            return covariance.extended(wide)
        *finer, alike, common = covariance.levels  # presses lie in the groups of the last two
        group = np.where(self.each < 0, self.each.max() + 1 + alike.group, self.each)
        return replace(covariance, levels=(*finer, Draws(group, wide), alike, common))


@dataclass(frozen=True)
class Weighed:
    """The unknown beside an answer, or alone."""

    log_bayes_factor: float  # against the same without it, averaged over manners and scales
    manner: str  # the likeliest, in words

    @property
    def p(self) -> float:
        """Return the bound on the probability of as much evidence by chance."""
        return chance_of(self.log_bayes_factor)


def weighed_unknown(
    problem: Problem,
    manners: Sequence[Manner],
    parts: Sequence[Candidate] = (),
    amounts: np.ndarray | None = None,
    left: np.ndarray | None = None,
) -> Weighed:
    """Return how much likelier all readings are with something unknown beside the parts, or alone.

    left (n,) [N]: what the parts leave of the readings at amounts (p,); the amounts stay free, to first order about these.
    """
    residual, covariance = problem.residual, problem.covariance
    if len(parts):
        covariance = problem.believing(parts, amounts).covariance
        residual = left + np.column_stack([part.columns for part in parts]) @ amounts
    without = log_evidence(residual, covariance, parts)
    found = {
        (manner.words, scale): log_evidence(residual, manner.beside(covariance, scale), parts) - without
        for manner in manners
        for scale in SCALES
    }
    return Weighed(float(logsumexp(list(found.values())) - np.log(len(found))), max(found, key=found.get)[0])


def manners_of(problem: Problem) -> list[Manner]:
    """Return the manners in which these readings may differ; flow is not among them."""
    labels = problem.labels
    pressing = np.abs(problem.base[labels["reading"], 2])
    flow = (labels["channel"] != "force").to_numpy() if "channel" in labels else np.zeros(len(labels), bool)
    own = np.where(flow, 0.0, problem.observations.flat(problem.base))
    pressing = np.where(flow, 0.0, pressing)
    axis = labels["axis"].to_numpy()
    press = np.where(flow, -1, np.unique(labels["press"], return_inverse=True)[1].ravel())
    found = []
    for words, profile, share, each in _profiles(labels):
        size = pressing if share else np.full(len(labels), np.sqrt(np.mean(pressing[pressing > 0] ** 2)))
        for name, axes in DIRECTIONS.items():
            if axes is None:
                directions = own[:, None] * profile
            else:
                directions = np.column_stack([(size * (axis == k))[:, None] * profile for k in axes])
            if np.any(directions):
                found.append(Manner(f"{name} {words}", PLAUSIBLE * directions, press if each else None))
    return found


def _profiles(labels: pd.DataFrame) -> Iterator[tuple[str, np.ndarray, bool, bool]]:
    """Yield words, functions (n, q) of unit size, whether they grow with the force, whether each press has one."""
    depth = labels["depth_mm"].to_numpy(float)
    over_depth = _modes(depth, BESIDE)
    yield "with depth", _modes(depth, MODES["depth"]), True, False
    if labels["site"].nunique() > 1:
        x, y = (_modes(labels[name].to_numpy(float), MODES["place"]) for name in ("x_mm", "y_mm"))
        yield "from place to place", _product(_product(x, y), over_depth), True, False
    if labels["press"].nunique() > 1:
        yield "from press to press", over_depth, True, True
    sessions, order = labels["session"].to_numpy(), labels["order"].to_numpy(float)
    if any(np.ptp(order[sessions == name]) > 0 for name in np.unique(sessions)):
        yield "over the session's time", _of_each(sessions, order, MODES["time"]), False, False
    phases = labels["phase"].to_numpy()
    held = np.log1p(np.maximum(np.nan_to_num(labels["press_time_s"].to_numpy(float)), 0.0))
    later = np.column_stack([phases == "dwell", phases == "unload"]).astype(float)
    if later.any():
        yield (
            "along a press's path",
            _product(_product(_modes(held, MODES["path"]), later), over_depth),
            True,
            False,
        )


def _of_each(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return such cosines of each group's own values, one group's beside the other's."""
    columns = []
    for name in np.unique(group):
        here = group == name
        own = np.zeros((len(values), count))
        modes = _modes(values[here], count)
        own[here, : modes.shape[1]] = modes
        columns.append(own)
    return np.column_stack(columns)


def _modes(values: np.ndarray, count: int) -> np.ndarray:
    """Return cosines (n, count) over the range of values (n,), the slower the larger, of mean square 1 together.

    A random function of them has a smooth covariance (Solin & Sarkka 2020, doi:10.1007/s11222-019-09886-w).
    """
    spread = np.ptp(values)
    if spread == 0:
        return np.ones((len(values), 1))
    k = np.arange(count)
    size = 1 / (1 + k**2 / 2)
    found = np.cos(np.pi * (values - values.min())[:, None] / spread * k) * size
    return found / np.sqrt(np.sum(size**2 * np.where(k, 0.5, 1.0)))


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return all products (n, p q) of the columns of a (n, p) and b (n, q)."""
    return (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)
