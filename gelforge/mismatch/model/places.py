"""Where a located effect may sit, and how large it is; and first-order forces by derivatives at what was tried."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers
from gelforge.mismatch.model.effect import Context, Hyperparameters

RADIUS = "radius_mm"
AXES = ("x_mm", "y_mm", "z_mm", RADIUS)  # of a place: its size is one
# mm, at most; half the diagonal is 2.97: every point of a plane lies within 3 mm of a place. From there fits find defects to
# 0.15 to 0.32 mm in the median (docs/results/verdicts.md).
SPACING = 4.2
SIZES = (1.0, 0.6)  # of balls, as shares of the largest, which fills the layers: refits find sizes between


def balls(study: Study) -> list[Hyperparameters]:
    """Return balls (x_mm, y_mm, z_mm, radius_mm) in the layers under the skin, at most SPACING apart in a plane."""
    bottom, height = -study.sensor.height_mm, _height_of_gel(study)
    levels = _evenly(bottom, bottom + height, max(1, round(height / SPACING)))
    radius = min(SPACING / 2, 0.45 * height)
    return [
        place | {"z_mm": z, "radius_mm": size * radius}
        for size in SIZES
        for z in levels
        for place in _plane(study, z)
    ]


def patches(study: Study) -> list[Hyperparameters]:
    """Return discs (x_mm, y_mm, z_mm, radius_mm) on the face between the layers under the skin and the skin."""
    z = _height_of_gel(study) - study.sensor.height_mm
    return [place | {"z_mm": z, "radius_mm": SPACING / 2} for place in _plane(study, z)]


def _height_of_gel(study: Study) -> float:
    return sum(layer.thickness_mm for layer in study.sensor.layers if layer.name in gel_layers(study))


@dataclass(frozen=True)
class FirstOrder:
    """The `to_forces` of an effect whose own derivatives the solver gives: force + sum of theta x derivative.

    Derivatives are named as the effect, or "effect.parameter" by parameter, and "@k" at the k-th point of the grid that is
    scanned; between places they are interpolated.
    """

    name: str
    parameters: tuple[str, ...] = ()
    scanned: Callable[[Study], list[Hyperparameters]] | None = None

    def keys(self, number: int | None) -> list[str]:
        """Return the names of the derivatives, one per value, at a point of the grid of some number."""
        at = "" if self.scanned is None else f"@{number}"
        return [f"{self.name}{key}{at}" for key in [f".{name}" for name in self.parameters] or [""]]

    def __call__(
        self, context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
    ) -> np.ndarray:
        tried = {0: 1.0} if self.scanned is None else shares(hyperparameters, self.scanned(context.study))
        for number, share in tried.items():
            for key, a in zip(self.keys(number), theta, strict=True):
                force = force + share * a * context.derivative(key)
        return force


def shares(hyperparameters: Hyperparameters, tried: Sequence[Hyperparameters]) -> dict[int, float]:
    """Return the numbers of the grid's points between which a point lies, and their shares (linear by axis, 1 in all)."""
    if dict(hyperparameters) in tried:
        return {tried.index(dict(hyperparameters)): 1.0}
    if "x_mm" not in hyperparameters:
        raise ValueError(
            f"{dict(hyperparameters)} is none of the hyperparameters that are tried: {[dict(one) for one in tried]}"
        )
    here, places = point(hyperparameters), np.array([point(place) for place in tried])
    shares = np.ones(len(places))
    for x, line in zip(here, places.T):
        spacing = np.diff(np.unique(line)).min(initial=np.inf)
        if np.isfinite(spacing):
            shares *= np.clip(1 - np.abs(np.clip(x, line.min(), line.max()) - line) / spacing, 0, None)
    if not shares.any():  # in the corner of a dome no place is next to it
        shares[np.argmin(np.linalg.norm(places - here, axis=1))] = 1.0
    return {int(k): float(shares[k] / shares.sum()) for k in np.flatnonzero(shares)}


def point(hyperparameters: Hyperparameters) -> np.ndarray:
    """Return a place as numbers (4,) [mm], its radius last."""
    return np.array([hyperparameters[axis] for axis in AXES])


def _plane(study: Study, z: float) -> list[dict[str, float]]:
    sensor = study.sensor
    widths = np.array([sensor.width_x_mm, sensor.width_y_mm])
    along_x, along_y = lines(study)
    places = [{"x_mm": x, "y_mm": y} for y in along_y for x in along_x]
    if sensor.shape.kind != "dome":
        return places
    up = 1 + z / sensor.height_mm  # inside the half-ellipsoid
    return [p for p in places if np.sum((2 * np.array([*p.values()]) / widths - 1) ** 2) + up**2 < 1]


def lines(study: Study) -> tuple[list[float], list[float]]:
    """Return x and y [mm] of places in a plane, inside the wall."""
    sensor = study.sensor
    wall = sensor.wall_mm if sensor.shape.kind == "block" else 0.0
    return _evenly(wall, sensor.width_x_mm - wall), _evenly(wall, sensor.width_y_mm - wall)


def _evenly(low: float, high: float, count: int | None = None) -> list[float]:
    """Return the middles of equal parts, of at most SPACING where their count is not given."""
    count = count or math.ceil((high - low) / SPACING)
    return [float(v) for v in low + (high - low) * (np.arange(count) + 0.5) / count]
