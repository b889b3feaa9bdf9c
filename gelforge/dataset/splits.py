"""Training and test sites, split by orbit: neither an image of an indentation nor its mirror image is on both sides."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gelforge.config import Sensor
from gelforge.indentation.paths.planned_cell import PlannedCell


def orbits(planned: Mapping[str, PlannedCell], sensor: Sensor) -> dict[str, str]:
    """Return for each site the first site of the plan that its sensor's symmetry carries it to: itself where there is none.

    A rectangular sensor is its own mirror image along both sides, a square one along its diagonals too. Sites at one place
    are one orbit, whatever their paths: a label and its mirror image on two sides of a split would be no test.
    """
    first: dict[tuple, str] = {}
    return {
        name: first.setdefault(_folded(cell.x_mm, cell.y_mm, sensor), name) for name, cell in planned.items()
    }


def _folded(x: float, y: float, sensor: Sensor) -> tuple[float, ...]:
    """Return a position's distances [mm] from the sensor's middle, the same for all of its mirror images."""
    away = abs(x - sensor.width_x_mm / 2), abs(y - sensor.width_y_mm / 2)
    square = abs(sensor.width_x_mm - sensor.width_y_mm) < 1e-9
    return tuple(round(d, 6) + 0.0 for d in (sorted(away) if square else away))


def split_orbits(
    orbit: Mapping[str, str], from_wall: Mapping[str, float], test_fraction: float, seed: int
) -> dict[str, str]:
    """Return "train" or "test" for each cell: a seeded draw of test_fraction of the orbits, at least one of two or more.

    orbit: of each site; from_wall: the distance of each site from the nearest wall [mm]. Orbits are put in the order of that
    distance, cut into as many parts as are to be drawn, and one is drawn of each part: indentations near walls and in the
    middle are both tested. The draw depends on orbits, distances and seed only, not on the order of the sites.
    """
    distance: dict[str, float] = {}
    for cell in sorted(orbit):
        distance.setdefault(orbit[cell], from_wall[cell])
    ordered = sorted(distance, key=lambda name: (round(distance[name], 6), name))
    count = max(min(max(round(test_fraction * len(ordered)), 1), len(ordered) - 1), 0)
    rng = np.random.default_rng(seed)
    parts = np.array_split(np.array(ordered), count) if count else []
    test = {str(part[rng.integers(len(part))]) for part in parts}
    return {cell: "test" if orbit[cell] in test else "train" for cell in sorted(orbit)}


def planned_split(
    planned: Mapping[str, PlannedCell], sensor: Sensor, test_fraction: float, seed: int
) -> tuple[dict[str, str], dict[str, str]]:
    """Return "train" or "test" of every site of a plan, and its orbit."""
    orbit = orbits(planned, sensor)
    places = {name: np.array([cell.x_mm, cell.y_mm]) for name, cell in planned.items()}
    return split_orbits(orbit, distances_from_wall(places, sensor), test_fraction, seed), orbit


def split_training(
    places: Mapping[str, np.ndarray], orbit: Mapping[str, str], sensor: Sensor, fraction: float, seed: int
) -> dict[str, str]:
    """Return "train" or "validation" of each training site; places (2,) [mm]: of sites with rows, seed: of the study."""
    split = split_orbits(orbit, distances_from_wall(places, sensor), fraction, seed + 1)
    return {cell: "validation" if side == "test" else "train" for cell, side in split.items()}


def distances_from_wall(places: Mapping[str, np.ndarray], sensor: Sensor) -> dict[str, float]:
    """Return the distance [mm] of each site's position (2,) [mm] from the nearest side of the sensor."""
    widths = np.array([sensor.width_x_mm, sensor.width_y_mm])
    return {name: float(np.minimum(place, widths - place).min()) for name, place in places.items()}
