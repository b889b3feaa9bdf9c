"""Where a located effect may sit: places spread over the soft layers, scanned and not fitted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers
from gelforge.mismatch.context import Context
from gelforge.mismatch.effect import Shape

SPACING = 4.2  # mm, at most; half the diagonal is 2.97: every point of a plane lies within 3 mm of a place


def balls(study: Study) -> list[Shape]:
    """Return balls (x_mm, y_mm, z_mm, radius_mm) in the layers under the skin, at most SPACING apart in a plane."""
    sensor = study.sensor
    height = sum(layer.thickness_mm for layer in sensor.layers if layer.name in gel_layers(study))
    levels = _evenly(-sensor.height_mm, height - sensor.height_mm, max(1, round(height / SPACING)))
    radius = min(SPACING / 2, 0.45 * height)
    return [place | {"z_mm": z, "radius_mm": radius} for z in levels for place in _plane(study, z)]


def patches(study: Study) -> list[Shape]:
    """Return discs (x_mm, y_mm, z_mm, radius_mm) on the face between the layers under the skin and the skin."""
    sensor = study.sensor
    height = sum(layer.thickness_mm for layer in sensor.layers if layer.name in gel_layers(study))
    z = height - sensor.height_mm
    return [place | {"z_mm": z, "radius_mm": SPACING / 2} for place in _plane(study, z)]


@dataclass(frozen=True)
class FirstOrderAt:
    """The `to_forces` of a located effect with derivatives "name@k", k the number of the place."""

    name: str
    places: Callable[[Study], list[Shape]]

    def __call__(
        self, context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]
    ) -> np.ndarray:
        (a,) = amounts
        return force + a * context.derivative(f"{self.name}@{self.places(context.study).index(dict(shape))}")


def _plane(study: Study, z: float) -> list[dict[str, float]]:
    sensor = study.sensor
    wall = sensor.wall_mm if sensor.shape.kind == "block" else 0.0
    widths = sensor.width_x_mm, sensor.width_y_mm
    found = [
        {"x_mm": x, "y_mm": y}
        for y in _evenly(wall, widths[1] - wall)
        for x in _evenly(wall, widths[0] - wall)
    ]
    if sensor.shape.kind != "dome":
        return found
    up = 1 + z / sensor.height_mm  # inside the half-ellipsoid
    return [p for p in found if _away(p["x_mm"], widths[0]) + _away(p["y_mm"], widths[1]) + up**2 < 1]


def _away(x: float, width: float) -> float:
    return (2 * x / width - 1) ** 2


def _evenly(low: float, high: float, count: int | None = None) -> list[float]:
    """Return the middles of equal parts, of at most SPACING where their count is not given."""
    count = count or math.ceil((high - low) / SPACING)
    return [float(v) for v in low + (high - low) * (np.arange(count) + 0.5) / count]
