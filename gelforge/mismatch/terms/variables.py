"""What a refit varies: the values of effects, and how far what has a place lies from where it was tried."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.places import displaced
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.terms.problem import Problem

SEEN_SNR = 0.5  # of a way half to the next place: what the readings see less of is not fitted
ENOUGH_OF_A_WAY = 0.1  # half-way to the next place: smaller steps of a place, some 0.2 mm, are not waited for
FARTHEST = 0.6  # half-way to the next place: a longer step is shortened, with all that goes along with it
INSIDE = 1e-3  # of a bound's distance from zero that values keep from it, but for all that there can be


@dataclass(frozen=True, eq=False)
class Move:
    """A part's way along an axis from the place that was tried."""

    part: int
    axis: str
    slope: np.ndarray  # (n,) [N/mm] of the change by the part
    half: float  # mm, half-way to the next place
    low: float  # mm
    high: float
    at: float = 0.0  # mm, where it starts


@dataclass(frozen=True, eq=False)
class Variables:
    """q numbers: the values of an answer's parts in turn, and then the moves [mm] of those that have a place."""

    problem: Problem
    start: Screened
    moves: tuple[Move, ...]
    mask: np.ndarray  # (n,) bool, the m entries that are fitted

    @property
    def amounts(self) -> int:
        """Return how many of them are values."""
        return int(self.ends[-1])

    @cached_property
    def ends(self) -> np.ndarray:
        return np.cumsum([part.columns.shape[1] for part in self.start.parts])

    @cached_property
    def binary(self) -> np.ndarray:
        """Return (q,) bool: what is on and not fitted."""
        return self._each("binary", [False for _ in self.moves]).astype(bool)

    @property
    def free(self) -> np.ndarray:
        """Return (q,) bool: what is fitted."""
        return ~self.binary

    @property
    def ways(self) -> np.ndarray:
        """Return the linear change (n, q - p) [N/mm] of all entries along the moves."""
        return np.array([move.slope for move in self.moves]).reshape(len(self.moves), len(self.mask)).T

    @cached_property
    def prior_sd(self) -> np.ndarray:
        """Return the standard deviations (q,) of the priors; of a place that of an even spread half-way to the next."""
        return self._each("prior_sd", [move.half / np.sqrt(3) for move in self.moves])

    @cached_property
    def signs(self) -> np.ndarray:
        """Return (q,) 1 or -1: the only physical sign; 0: both."""
        return self._each("signs", [0.0 for _ in self.moves])

    @cached_property
    def enough(self) -> np.ndarray:
        """Return the steps (q,) below which there is nothing to wait for, whatever the readings could tell."""
        return np.array([0.0] * self.amounts + [ENOUGH_OF_A_WAY * move.half for move in self.moves])

    @cached_property
    def farthest(self) -> np.ndarray:
        """Return the longest steps (q,): of values any."""
        return np.array([np.inf] * self.amounts + [FARTHEST * move.half for move in self.moves])

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds (q,)."""
        low, high = [], []
        for part in self.start.parts:
            for parameter in self.problem.effects[part.name].parameters:
                lo, hi = parameter.bounds
                lo = max(lo, 0.0) if parameter.sign > 0 else lo
                hi = min(hi, 0.0) if parameter.sign < 0 else hi
                inside = 0.0 if parameter.closed else INSIDE
                low.append(lo * (1 - inside) if np.isfinite(lo) else lo)
                high.append(hi * (1 - inside) if np.isfinite(hi) else hi)
        low += [move.low for move in self.moves]
        high += [move.high for move in self.moves]
        return np.array(low), np.array(high)

    def first(self) -> np.ndarray:
        """Return (q,) the numbers of the screened answer, within their bounds."""
        a = np.concatenate([self.start.amounts, [move.at for move in self.moves]])
        return np.where(self.binary, 1.0, np.clip(a, *self.bounds))

    def columns(self) -> np.ndarray:
        """Return the screen's columns (m, q) [N per unit, N/mm]."""
        every = [part.columns for part in self.start.parts] + [move.slope[:, None] for move in self.moves]
        return np.column_stack(every)[self.mask]

    def split(self, a: np.ndarray) -> tuple[tuple[Candidate, ...], tuple[np.ndarray, ...]]:
        """Return the parts at their places, with their linear change there, and the values of each."""
        parts = list(self.start.parts)
        for k in {move.part for move in self.moves}:
            by = {move.axis: x for move, x in zip(self.moves, a[self.amounts :]) if move.part == k}
            part = displaced(parts[k], by)
            parts[k] = replace(part, columns=self.problem.columns_at(part))
        return tuple(parts), tuple(np.split(a[: self.amounts], self.ends[:-1]))

    def change(self, a: np.ndarray) -> np.ndarray:
        """Return the change (m,) [N] of the fitted entries at a (q,). Raises NotConverged."""
        parts, amounts = self.split(a)
        forces = self.problem.forces_with(parts, amounts, self.problem.readings_of(self.mask))
        return self.problem.observations.flat(forces - self.problem.base)[self.mask]

    def covariance(self, a: np.ndarray) -> Covariance:
        """Return the covariance of the fitted entries, errors of the change at a (q,) included."""
        uncertain = self.problem.with_model_error(self.split(a)[0], a[: self.amounts])
        return uncertain.covariance.restricted(self.mask)

    def _each(self, name: str, of_moves: list) -> np.ndarray:
        of_parts = [np.broadcast_to(getattr(part, name), part.columns.shape[1]) for part in self.start.parts]
        return np.concatenate([*of_parts, of_moves])


def variables_of(problem: Problem, start: Screened, mask: np.ndarray, placing: bool = False) -> Variables:
    """Return what is varied in a refit of a screened answer: of places the ways that the fitted entries see.

    What an earlier refit has placed stays there, and its value alone is fitted, unless it is placing: it then goes on.
    """
    parts = tuple(_tried(problem, part) if placing else part for part in start.parts)
    moves, at, covariance = [], 0, problem.covariance.restricted(mask)
    for k, (part, before) in enumerate(zip(parts, start.parts)):
        own = start.amounts[at : at + part.columns.shape[1]]
        at += len(own)
        slopes = problem.slopes_of(part) if part.moved_from is None else {}
        for axis, slope in slopes.items():
            way = slope.columns @ own
            moved = float(before.shape[axis]) - float(part.shape[axis])
            if moved or np.linalg.norm(covariance.whiten(way[mask])) * slope.half > SEEN_SNR:
                moves.append(Move(k, axis, way, slope.half, slope.low, slope.high, moved))
    return Variables(problem, replace(start, parts=parts), tuple(moves), mask)


def _tried(problem: Problem, part: Candidate) -> Candidate:
    """Return a part that a refit has moved, at the place that was tried."""
    if part.moved_from is None:
        return part
    there = replace(part, shape=part.moved_from)
    return replace(there, moved_from=None, columns=problem.columns_at(there))
