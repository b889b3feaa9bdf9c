"""What no effect of the catalogue is: readings that differ by a smooth random function, weighed next to the known effects.

Its change is a random function: of depth, of place, of the session's time, of the indentation's own path, or one for each
indentation; of the pressing force, of the sideways forces, or of all in proportion. Such a function can follow anything of
its kernel and pays for that (Kennedy & O'Hagan 2001, doi:10.1111/1467-9868.00294): an effect that is right does the same
with a value or two and is likelier; effects that only happen to fit are not.

A module is a kernel with a cause: physics with a free form, a map that no single value describes. Its directions are changes
by that cause, with the plausible width of the catalogue's effect that it generalises. The causes are in `free_forms`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.config import Study
from gelforge.mismatch.evidence.covariance import Covariance, Draws
from gelforge.mismatch.evidence.gaussian import normalised
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.screen import (
    Candidate,
    Screened,
    chance_of,
    judged_by,
    log_evidence,
    whitened,
)
from gelforge.mismatch.model.effect import Context, Effect
from gelforge.mismatch.thresholds import PLAUSIBLE, SCALES, TEMPERING

AXES = "xyz"
# Cosines along each coordinate; next to: over depth, with those of place, path or indentation
MODES = {"depth": 6, "depth_at_place": 3, "place": 4, "time": 8, "path": 3}


@dataclass(frozen=True, eq=False)
class Kernel:
    """One kernel in which readings may differ for an unknown reason."""

    words: str
    directions: np.ndarray  # (n, q) [N], a standard deviation of PLAUSIBLE together
    # (n,) int, groups of entries that differ each by itself; None: all together
    groups: np.ndarray | None = None
    form_of: tuple[str, ...] = ()  # effects of the catalogue that are the same cause in another form
    of_labels: bool = False  # simulated forces change by it, as a function of place and depth

    @property
    def is_cause(self) -> bool:
        """Return whether it is physics that can be claimed, with a form of its own."""
        return False

    def added_to(self, covariance: Covariance, scale: float) -> Covariance:
        """Return the covariance of n entries with this kernel at a scale of its plausible size."""
        if self.groups is None:
            return covariance.extended(scale * self.directions)
        *finer, solved, common = covariance.levels  # presses lie in the groups of the last two
        group = np.where(self.groups < 0, self.groups.max() + 1 + solved.group, self.groups)
        return replace(covariance, levels=(*finer, Draws(group, scale * self.directions), solved, common))


@dataclass(frozen=True, eq=False, kw_only=True)
class Module(Kernel):
    """A cause with a free form: directions, and the map that its coefficients describe."""

    name: str
    says: str  # the cause, in words that follow "; "
    map: pd.DataFrame  # (G) rows of module.csv: quantity, and what it is a function of
    basis: np.ndarray  # (G, q) the map per unit coefficient
    unit: str
    where: Callable[[Mapping[str, Any]], str]  # a row of the map, in words
    to_study: Callable[[Study, np.ndarray], Study] | None = None  # with a map (G,) of it
    # False: another known cause changes the readings in such a way; it is modelled and never named
    named: bool = True
    replaces: str = ""  # words of the kernel without a cause that is this one without its name

    @property
    def is_cause(self) -> bool:
        return self.named

    def values(self, mean: np.ndarray, covariance: np.ndarray) -> pd.DataFrame:
        """Return the rows of module.csv: the map with columns mean and sigma, of coefficients (q,) and (q, q)."""
        sigma = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", self.basis, covariance, self.basis), 0.0))
        return self.map.assign(unit=self.unit, mean=self.basis @ mean, sigma=sigma)


@dataclass(frozen=True)
class FreeForm:
    """What a file of `free_forms` defines."""

    name: str  # of the file
    # The module, if readings may show it, of the changes of the readings by the derivatives that they show at all
    module: Callable[[Context, Sequence[Candidate]], Module | None]
    derivatives: tuple[Effect, ...] = ()  # solved for it alone: none of these is an answer


@dataclass(frozen=True)
class Weighed:
    """The unknown next to an answer, or alone."""

    kernels: Sequence[Kernel]
    factors: Mapping[str, float]  # by kernel: log, against the same without it, averaged over scales

    @cached_property
    def priors(self) -> dict[str, float]:
        """Return by kernel the log prior: each cause is as likely as all kernels without one together."""
        return log_priors(self.kernels)

    @property
    def log_bayes_factor(self) -> float:
        """Return the log evidence against the same without it, averaged over kernels."""
        return float(logsumexp([factor + self.priors[words] for words, factor in self.factors.items()]))

    @cached_property
    def shares(self) -> dict[str, float]:
        """Return the probability of each kernel if one of them is there; evidence counts for TEMPERING."""
        weights = {words: TEMPERING * one + self.priors[words] for words, one in self.factors.items()}
        return normalised(weights)

    def share_of(self, names: set[str]) -> float:
        """Return the probability that it is a cause which is one of some effects in another form, if it is there."""
        return sum(self.shares[kernel.words] for kernel in self.kernels if names & set(kernel.form_of))

    @property
    def p(self) -> float:
        """Return the bound on the probability of as much evidence by chance."""
        return chance_of(self.log_bayes_factor)


def weighed_unknown(problem: Problem, kernels: Sequence[Kernel], judged: Screened | None = None) -> Weighed:
    """Return how much likelier all readings are with a discrepancy added to what was judged, or alone.

    The values of what was judged stay free, to first order about those found.
    """
    residual, covariance = problem.residual, problem.covariance
    parts: tuple[Candidate, ...] = ()
    if judged is not None:
        parts = judged.parts
        covariance = problem.with_model_error(judged.terms).covariance
    r, white = covariance.whiten(residual), whitened(covariance, parts)
    alone = judged_by(r, parts, white).log_bayes_factor if parts else 0.0
    without, by_kernel = covariance.log_density(residual) + alone, {}
    for kernel in kernels:
        if kernel.groups is None:
            directions, q = covariance.whiten(kernel.directions), kernel.directions.shape[1]
            drawn = Candidate(kernel.words, {}, kernel.directions, np.ones(q), np.zeros(q))
            scaled = [replace(drawn, prior_sd=np.full(q, scale)) for scale in SCALES]
            with_it = [judged_by(r, (*parts, one), [*white, directions]).log_bayes_factor for one in scaled]
            factors = [factor - alone for factor in with_it]
        else:
            wider = [kernel.added_to(covariance, scale) for scale in SCALES]
            factors = [log_evidence(one, residual, parts) - without for one in wider]
        by_kernel[kernel.words] = float(logsumexp(factors) - np.log(len(factors)))
    return Weighed(kernels, by_kernel)


def log_priors(kernels: Sequence[Kernel]) -> dict[str, float]:
    """Return log priors of kernels: one share for each cause, and one that all kernels without a cause have together."""
    plain = sum(not kernel.is_cause for kernel in kernels)
    share = -np.log(len(kernels) - plain + (plain > 0))
    return {kernel.words: float(share if kernel.is_cause else share - np.log(plain)) for kernel in kernels}


def kernels_of(problem: Problem) -> list[Kernel]:
    """Return the kernels in which these readings may differ, physics with a free form among them; flow is not."""
    labels, of_force, kernels = problem.labels, problem.of_force, []
    axes_of = {"the pressing force": (2,), "the sideways forces": (0, 1), "all forces in proportion": None}
    axis, named = labels["axis"].to_numpy(), {module.replaces for module in problem.modules}
    nominal = np.where(of_force, problem.observations.flat(problem.base), 0.0)
    pressing = np.where(of_force, np.abs(problem.base[labels["reading"], 2]), 0.0)
    press = np.where(of_force, np.unique(labels["press"], return_inverse=True)[1].ravel(), -1)
    for over, profile, share, by_press in _profiles(labels):
        size = pressing if share else np.full(len(labels), np.sqrt(np.mean(pressing[pressing > 0] ** 2)))
        for name, axes in axes_of.items():
            if axes is None:
                directions = nominal[:, None] * profile
            else:
                directions = np.column_stack([(size * (axis == k))[:, None] * profile for k in axes])
            if np.any(directions) and f"{name} {over}" not in named:
                groups, of_labels = press if by_press else None, over in ("with depth", "from place to place")
                kernels.append(Kernel(f"{name} {over}", PLAUSIBLE * directions, groups, (), of_labels))
    for module in problem.modules:  # forces are the first entries; the flow of images it does not change
        directions = np.zeros((len(labels), module.directions.shape[1]))
        directions[: len(module.directions)] = module.directions
        kernels.append(replace(module, directions=directions))
    return kernels


def _profiles(labels: pd.DataFrame) -> Iterator[tuple[str, np.ndarray, bool, bool]]:
    """Yield words, functions (n, q) of unit size, whether they grow with the force, whether each indentation has one."""
    depth = labels["depth_mm"].to_numpy(float)
    over_depth = modes(depth, MODES["depth_at_place"])
    yield "with depth", modes(depth, MODES["depth"]), True, False
    if several_places(labels):
        yield "from place to place", product(plane_modes(labels), over_depth), True, False
    if labels["press"].nunique() > 1:
        yield "from one indentation to the next", over_depth, True, True
    sessions, order = labels["session"].to_numpy(), labels["order"].to_numpy(float)
    if any(np.ptp(order[sessions == name]) > 0 for name in np.unique(sessions)):
        yield "over the session's time", modes_by_group(sessions, order, MODES["time"]), False, False
    phases = labels["phase"].to_numpy()
    later = np.column_stack([phases == "dwell", phases == "unload"]).astype(float)
    if later.any():
        # since the indentation's first touch; 0 where no times are known
        held = np.log1p(np.maximum(np.nan_to_num(labels["press_time_s"].to_numpy(float)), 0.0))
        yield (
            "along an indentation's path",
            product(product(modes(held, MODES["path"]), later), over_depth),
            True,
            False,
        )


def modes_by_group(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return such cosines of each group's own values, one group's next to the other's."""
    columns = []
    for name in np.unique(group):
        here = group == name
        block = np.zeros((len(values), count))
        cosines = modes(values[here], count)
        block[here, : cosines.shape[1]] = cosines
        columns.append(block)
    return np.column_stack(columns)


def modes(values: np.ndarray, count: int) -> np.ndarray:
    """Return cosines (n, count) over the range of values (n,), the slower the larger, of mean square 1 together.

    A random function of them has a smooth covariance (Solin & Sarkka 2020, doi:10.1007/s11222-019-09886-w).
    """
    low, high = values.min(), values.max()
    if low == high:
        return np.ones((len(values), 1))
    k = np.arange(count)
    size = 1 / (1 + k**2 / 2)
    cosines = np.cos(np.pi * (values - low)[:, None] / (high - low) * k) * size
    return cosines / np.sqrt(np.sum(size**2 * np.where(k, 0.5, 1.0)))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return all products (n, p q) of the columns of a (n, p) and b (n, q)."""
    return (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)


def plane_modes(at: pd.DataFrame) -> np.ndarray:
    """Return cosines (n, q) over the plane, of mean square 1 together, at places x_mm, y_mm."""
    x, y = (modes(at[name].to_numpy(float), MODES["place"]) for name in ("x_mm", "y_mm"))
    return product(x, y)


def several_places(table: pd.DataFrame) -> bool:
    """Return whether readings were taken at more than one place."""
    return table[["x_mm", "y_mm"]].drop_duplicates().shape[0] > 1


def sites(table: pd.DataFrame) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the places x_mm, y_mm of the readings, and the number of the first reading at each."""
    first = table.drop_duplicates(["x_mm", "y_mm"])
    return first[["x_mm", "y_mm"]].reset_index(drop=True), first.index.to_numpy()


def near(row: Mapping[str, Any]) -> str:
    """Return the place of a map's row in words."""
    return f"near ({row['x_mm']:.4g}, {row['y_mm']:.4g}) mm"
