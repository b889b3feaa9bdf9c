"""Places of located effects as candidates: those next to one that was tried, and how its columns change between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Shape
from gelforge.mismatch.model.places import AXES, RADIUS, point


@dataclass(frozen=True, eq=False)
class Slope:
    """How a located effect's columns change along an axis, and how far its place may lie from the one that was tried."""

    columns: np.ndarray  # (n, p) [N per unit and mm]
    half: float  # mm, half-way to the next place
    low: float  # mm, to the place before; half-way to the one after where there is none
    high: float  # the same to the other side; a radius grows no further than what was tried


def slopes(part: Candidate, others: Sequence[Candidate]) -> dict[str, Slope]:
    """Return the slopes by axis, but for axes along which no other place was tried.

    Differences of the columns at the places to either side, or to one where there is but one.
    """
    found, near = {}, [(other, between(part.tried, other.tried)) for other in next_to(part, others)]
    for k, axis in enumerate(AXES):
        along = {0.0: part} | {float(way[k]): other for other, way in near if way[k]}
        before = max((d for d in along if d < 0), default=0.0)
        after = min((d for d in along if d > 0), default=0.0)
        if after > before:
            slope = (along[after].columns - along[before].columns) / (after - before)
            half = min(abs(d) for d in (before, after) if d) / 2
            beyond = 0.0 if axis == RADIUS else half
            found[axis] = Slope(slope, half, before or -half, after or beyond)
    return found


def displaced(part: Candidate, by: dict[str, float]) -> Candidate:
    """Return a located effect as far [mm] from the place that was tried, axis by axis; its columns stay as they are."""
    place = {axis: float(part.tried[axis]) + float(offset) for axis, offset in by.items()}
    return replace(part, shape={**part.shape, **place}, moved_from=part.tried)


def next_to(part: Candidate, others: Sequence[Candidate]) -> list[Candidate]:
    """Return those of other places that lie nearest to a part's to either side along one axis."""
    ways = np.array([between(part.tried, other.tried) for other in others]).reshape(-1, len(AXES))
    found = []
    for k in range(len(AXES)):
        for side in (-1, 1):
            along = (side * ways[:, k] > 0) & ~np.delete(ways, k, axis=1).any(axis=1)
            if along.any():
                found.append(others[int(np.argmin(np.where(along, np.abs(ways[:, k]), np.inf)))])
    return found


def between(one: Shape, other: Shape) -> np.ndarray:
    """Return the way (4,) [mm] from one place to another, the growth of its radius last."""
    return point(other) - point(one)
