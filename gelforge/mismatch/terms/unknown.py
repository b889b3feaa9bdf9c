"""What no effect of the catalogue is: readings that differ by a smooth random function, weighed next to the known effects.

Its change is a random function: of depth, of place, of the session's time, of the indentation's own path, or one for each
indentation; of the pressing force, of the sideways forces, or of all in proportion. Such a function can follow anything of
its kernel and pays for that (Kennedy & O'Hagan 2001, doi:10.1111/1467-9868.00294): an effect that is right does the same
with a value or two and is likelier; effects that only happen to fit are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.mismatch.evidence.alternatives import normalised
from gelforge.mismatch.evidence.covariance import Covariance, Draws
from gelforge.mismatch.evidence.screen import Candidate, chance_of, judged_by, log_evidence, whitened
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.thresholds import PLAUSIBLE, SCALES, TEMPERING

MODES = {"depth": 6, "place": 4, "time": 8, "path": 3}  # cosines along each coordinate
WITH_DEPTH, FROM_PLACE_TO_PLACE = "with depth", "from place to place"
BESIDE = 3  # cosines over depth beside those of place, path or press
DIRECTIONS = {
    "the pressing force": (2,),
    "the sideways forces": (0, 1),
    "all forces in proportion": None,
}


@dataclass(frozen=True, eq=False)
class Kernel:
    """One kernel in which readings may differ for an unknown reason."""

    words: str
    directions: np.ndarray  # (n, q) [N], a standard deviation of PLAUSIBLE together
    # (n,) int, groups of entries that differ each by itself; None: all together
    groups: np.ndarray | None = None
    form_of: tuple[str, ...] = ()  # effects of the catalogue that are the same cause in another form

    @property
    def is_cause(self) -> bool:
        """Return whether it is physics that can be claimed, with a form of its own."""
        return False

    def beside(self, covariance: Covariance, scale: float) -> Covariance:
        """Return the covariance of n entries with this kernel at a scale of its plausible size."""
        if self.groups is None:
            return covariance.extended(scale * self.directions)
        *finer, alike, common = covariance.levels  # presses lie in the groups of the last two
        group = np.where(self.groups < 0, self.groups.max() + 1 + alike.group, self.groups)
        return replace(covariance, levels=(*finer, Draws(group, scale * self.directions), alike, common))


@dataclass(frozen=True)
class Weighed:
    """The unknown beside an answer, or alone."""

    factors: Mapping[str, float]  # by kernel: log, against the same without it, averaged over scales
    priors: Mapping[str, float]  # by kernel, log: each cause is as likely as all kernels without one together
    forms: Mapping[str, tuple[str, ...]]  # by kernel: effects that are the same cause in another form

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
        return sum(share for words, share in self.shares.items() if names & set(self.forms[words]))

    @property
    def p(self) -> float:
        """Return the bound on the probability of as much evidence by chance."""
        return chance_of(self.log_bayes_factor)


def weighed_unknown(
    problem: Problem,
    kernels: Sequence[Kernel],
    parts: Sequence[Candidate] = (),
    amounts: np.ndarray | None = None,
    left: np.ndarray | None = None,
) -> Weighed:
    """Return how much likelier all readings are with a discrepancy beside the parts, or alone.

    left (n,) [N]: what the parts leave of the readings at amounts (p,); the values stay free, to first order about these.
    """
    residual, covariance = problem.residual, problem.covariance
    if len(parts):
        if amounts is None or left is None:
            raise ValueError("what the parts leave is not given; give amounts and left with parts")
        covariance = problem.with_model_error(parts, amounts).covariance
        residual = left + np.column_stack([part.columns for part in parts]) @ amounts
    r, white = covariance.whiten(residual), whitened(covariance, parts)
    judged = judged_by(r, parts, white).log_bayes_factor if parts else 0.0
    without, found = covariance.log_density(residual) + judged, {}
    for kernel in kernels:
        if kernel.groups is None:
            directions, q = covariance.whiten(kernel.directions), kernel.directions.shape[1]
            drawn = Candidate(kernel.words, {}, kernel.directions, np.ones(q), np.zeros(q))
            scaled = [replace(drawn, prior_sd=np.full(q, scale)) for scale in SCALES]
            with_it = [judged_by(r, (*parts, one), [*white, directions]).log_bayes_factor for one in scaled]
            factors = [factor - judged for factor in with_it]
        else:
            wider = [kernel.beside(covariance, scale) for scale in SCALES]
            factors = [log_evidence(one, residual, parts) - without for one in wider]
        found[kernel.words] = float(logsumexp(factors) - np.log(len(factors)))
    return Weighed(found, log_priors(kernels), {kernel.words: kernel.form_of for kernel in kernels})


def log_priors(kernels: Sequence[Kernel]) -> dict[str, float]:
    """Return log priors of kernels: one share for each cause, and one that all kernels without a cause have together."""
    plain = sum(not kernel.is_cause for kernel in kernels)
    share = -np.log(len(kernels) - plain + (plain > 0))
    return {kernel.words: float(share if kernel.is_cause else share - np.log(plain)) for kernel in kernels}


@dataclass(frozen=True)
class Span:
    """The ranges over which an unknown change is a smooth function: those of the readings that it is learnt from."""

    depth_mm: tuple[float, float]
    x_mm: tuple[float, float]
    y_mm: tuple[float, float]
    held: tuple[float, float]  # logarithm of 1 + seconds since the indentation's first touch

    @classmethod
    def of(cls, labels: pd.DataFrame) -> Span:
        """Return the ranges of some readings."""
        own = {name: labels[name].to_numpy(float) for name in ("depth_mm", "x_mm", "y_mm")} | {
            "held": _held(labels)
        }
        return cls(**{name: (float(values.min()), float(values.max())) for name, values in own.items()})


def kernels_of(problem: Problem) -> list[Kernel]:
    """Return the kernels in which these readings may differ, physics with a free form among them; flow is not."""
    labels = problem.labels
    flow = ~problem.of_force
    own = np.where(flow, 0.0, problem.observations.flat(problem.base))
    pressing = np.where(flow, 0.0, np.abs(problem.base[labels["reading"], 2]))
    press = np.where(flow, -1, np.unique(labels["press"], return_inverse=True)[1].ravel())
    found = kernels(labels, own, pressing, Span.of(labels), press)
    named = {module.replaces for module in problem.modules}
    return [one for one in found if one.words not in named] + [
        _padded(module, len(labels)) for module in problem.modules
    ]


def _padded(module: Kernel, entries: int) -> Kernel:
    """Return a module that changes the first of so many entries, the forces; the flow of images it does not change."""
    directions = np.zeros((entries, module.directions.shape[1]))
    directions[: len(module.directions)] = module.directions
    return replace(module, directions=directions)


def kernels(
    labels: pd.DataFrame, own: np.ndarray, pressing: np.ndarray, span: Span, press: np.ndarray
) -> list[Kernel]:
    """Return the kernels at n entries: labels as in Observations.labels, own (n,) [N] base force along the entry's axis.

    pressing (n,) [N]: size of the pressing force of its reading; press (n,): number of its press.
    """
    axis, found = labels["axis"].to_numpy(), []
    for words, profile, share, each in _profiles(labels, span):
        size = pressing if share else np.full(len(labels), np.sqrt(np.mean(pressing[pressing > 0] ** 2)))
        for name, axes in DIRECTIONS.items():
            if axes is None:
                directions = own[:, None] * profile
            else:
                directions = np.column_stack([(size * (axis == k))[:, None] * profile for k in axes])
            if np.any(directions):
                found.append(Kernel(f"{name} {words}", PLAUSIBLE * directions, press if each else None))
    return found


def _profiles(labels: pd.DataFrame, span: Span) -> Iterator[tuple[str, np.ndarray, bool, bool]]:
    """Yield words, functions (n, q) of unit size, whether they grow with the force, whether each indentation has one."""
    depth = labels["depth_mm"].to_numpy(float)
    over_depth = modes(depth, BESIDE, span.depth_mm)
    yield WITH_DEPTH, modes(depth, MODES["depth"], span.depth_mm), True, False
    if span.x_mm[0] < span.x_mm[1] or span.y_mm[0] < span.y_mm[1]:
        x = modes(labels["x_mm"].to_numpy(float), MODES["place"], span.x_mm)
        y = modes(labels["y_mm"].to_numpy(float), MODES["place"], span.y_mm)
        yield FROM_PLACE_TO_PLACE, product(product(x, y), over_depth), True, False
    if labels["press"].nunique() > 1:
        yield "from one indentation to the next", over_depth, True, True
    sessions, order = labels["session"].to_numpy(), labels["order"].to_numpy(float)
    if any(np.ptp(order[sessions == name]) > 0 for name in np.unique(sessions)):
        yield "over the session's time", of_each(sessions, order, MODES["time"]), False, False
    phases = labels["phase"].to_numpy()
    later = np.column_stack([phases == "dwell", phases == "unload"]).astype(float)
    if later.any():
        held = modes(_held(labels), MODES["path"], span.held)
        yield "along an indentation's path", product(product(held, later), over_depth), True, False


def _held(labels: pd.DataFrame) -> np.ndarray:
    """Return the logarithm (n,) of 1 + seconds since the indentation's first touch; 0 where no times are known."""
    return np.log1p(np.maximum(np.nan_to_num(labels["press_time_s"].to_numpy(float)), 0.0))


def of_each(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return such cosines of each group's own values, one group's beside the other's."""
    columns = []
    for name in np.unique(group):
        here = group == name
        own = np.zeros((len(values), count))
        found = modes(values[here], count)
        own[here, : found.shape[1]] = found
        columns.append(own)
    return np.column_stack(columns)


def modes(values: np.ndarray, count: int, span: tuple[float, float] | None = None) -> np.ndarray:
    """Return cosines (n, count) over a range of values (n,), the slower the larger, of mean square 1 together.

    span: the range, that of the values where none is given. A random function of them has a smooth covariance (Solin &
    Sarkka 2020, doi:10.1007/s11222-019-09886-w).
    """
    low, high = (values.min(), values.max()) if span is None else span
    if low == high:
        return np.ones((len(values), 1))
    k = np.arange(count)
    size = 1 / (1 + k**2 / 2)
    found = np.cos(np.pi * (values - low)[:, None] / (high - low) * k) * size
    return found / np.sqrt(np.sum(size**2 * np.where(k, 0.5, 1.0)))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return all products (n, p q) of the columns of a (n, p) and b (n, q)."""
    return (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)
