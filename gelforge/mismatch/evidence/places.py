"""Where a located effect may sit, and how large it is: places spread over the soft layers are tried, refits move between."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Shape

RADIUS = "radius_mm"
AXES = ("x_mm", "y_mm", "z_mm", RADIUS)  # of a place: its size is one
SPACING = 4.2  # mm, at most; half the diagonal is 2.97: every point of a plane lies within 3 mm of a place
SIZES = (
    1.0,
    0.6,
)  # of balls, as shares of the largest, which fills the layers: refits find sizes between, and some smaller


def balls(study: Study) -> list[Shape]:
    """Return balls (x_mm, y_mm, z_mm, radius_mm) in the layers under the skin, at most SPACING apart in a plane."""
    sensor = study.sensor
    height = sum(layer.thickness_mm for layer in sensor.layers if layer.name in gel_layers(study))
    levels = _evenly(-sensor.height_mm, height - sensor.height_mm, max(1, round(height / SPACING)))
    radius = min(SPACING / 2, 0.45 * height)
    return [
        place | {"z_mm": z, "radius_mm": size * radius}
        for size in SIZES
        for z in levels
        for place in _plane(study, z)
    ]


def patches(study: Study) -> list[Shape]:
    """Return discs (x_mm, y_mm, z_mm, radius_mm) on the face between the layers under the skin and the skin."""
    sensor = study.sensor
    height = sum(layer.thickness_mm for layer in sensor.layers if layer.name in gel_layers(study))
    z = height - sensor.height_mm
    return [place | {"z_mm": z, "radius_mm": SPACING / 2} for place in _plane(study, z)]


@dataclass(frozen=True)
class FirstOrderAt:
    """The `to_forces` of an effect with derivatives "name@k", k the number of the shape; interpolated between places."""

    name: str
    shapes: Callable[[Study], list[Shape]]

    def __call__(
        self, context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]
    ) -> np.ndarray:
        (a,) = amounts
        for k, share in shares(shape, self.shapes(context.study)).items():
            force = force + share * a * context.derivative(f"{self.name}@{k}")
        return force


def shares(shape: Shape, tried: Sequence[Shape]) -> dict[int, float]:
    """Return the numbers of the shapes tried between which a shape lies, and their shares (linear by axis, 1 in all)."""
    if dict(shape) in tried:
        return {tried.index(dict(shape)): 1.0}
    if "x_mm" not in shape:
        raise ValueError(
            f"{dict(shape)} is none of the shapes that are tried: {[dict(one) for one in tried]}"
        )
    here, places = _point(shape), np.array([_point(place) for place in tried])
    shares = np.ones(len(places))
    for x, line in zip(here, places.T):
        spacing = np.diff(np.unique(line)).min(initial=np.inf)
        if np.isfinite(spacing):
            shares *= np.clip(1 - np.abs(np.clip(x, line.min(), line.max()) - line) / spacing, 0, None)
    if not shares.any():  # in the corner of a dome no place is next to it
        shares[np.argmin(np.linalg.norm(places - here, axis=1))] = 1.0
    return {int(k): float(shares[k] / shares.sum()) for k in np.flatnonzero(shares)}


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
    return _point(other) - _point(one)


def _point(shape: Shape) -> np.ndarray:
    return np.array([shape[axis] for axis in AXES])


def _plane(study: Study, z: float) -> list[dict[str, float]]:
    sensor = study.sensor
    prior_sd = sensor.width_x_mm, sensor.width_y_mm
    along_x, along_y = lines(study)
    found = [{"x_mm": x, "y_mm": y} for y in along_y for x in along_x]
    if sensor.shape.kind != "dome":
        return found
    up = 1 + z / sensor.height_mm  # inside the half-ellipsoid
    return [p for p in found if _away(p["x_mm"], prior_sd[0]) + _away(p["y_mm"], prior_sd[1]) + up**2 < 1]


def lines(study: Study) -> tuple[list[float], list[float]]:
    """Return x and y [mm] of places in a plane, inside the wall."""
    sensor = study.sensor
    wall = sensor.wall_mm if sensor.shape.kind == "block" else 0.0
    return _evenly(wall, sensor.width_x_mm - wall), _evenly(wall, sensor.width_y_mm - wall)


def _away(x: float, width: float) -> float:
    return (2 * x / width - 1) ** 2


def _evenly(low: float, high: float, count: int | None = None) -> list[float]:
    """Return the middles of equal parts, of at most SPACING where their count is not given."""
    count = count or math.ceil((high - low) / SPACING)
    return [float(v) for v in low + (high - low) * (np.arange(count) + 0.5) / count]
