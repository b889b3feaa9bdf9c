"""Training and test sites, split by orbit: neither an image of an indentation nor its mirror image is on both sides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from gelforge.config import Sensor
from gelforge.indentation.paths.places import chained
from gelforge.indentation.paths.planned_cell import PlannedCell


def orbits(planned: Mapping[str, PlannedCell], sensor: Sensor) -> dict[str, str]:
    """Return for each site the first site of the plan that is of its orbit: itself where there is no other.

    A rectangular sensor is its own mirror image along both sides, a square one along its diagonals too. Sites within the
    plan's tolerance of each other (`PlannedCell.within_mm`), or of each other's mirror images, are of one orbit, and so are
    those that a chain of such sites joins, whatever their paths: a label and its mirror image on two sides of a split would
    be no test.
    """
    names = list(planned)
    first = chained(folded(_places(planned), sensor), _tolerance_mm(planned))
    return {name: names[number] for name, number in zip(names, first)}


def folded(places: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the distances (n, 2) [mm] of positions (n, 2) from the sensor's middle, the same for all mirror images.

    The distance of two folded positions is the least one of any two of their mirror images.
    """
    away = np.abs(np.reshape(places, (-1, 2)) - [sensor.width_x_mm / 2, sensor.width_y_mm / 2])
    square = abs(sensor.width_x_mm - sensor.width_y_mm) < 1e-9
    return np.sort(away, axis=1) if square else away


def _places(planned: Mapping[str, PlannedCell]) -> np.ndarray:
    return np.array([(cell.x_mm, cell.y_mm) for cell in planned.values()]).reshape(-1, 2)


def _tolerance_mm(planned: Mapping[str, PlannedCell]) -> float:
    return max((cell.within_mm for cell in planned.values()), default=0.0)


def nearest_mm(places: np.ndarray, others: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the distance of each position to the nearest of others, or of their mirror images.

    Parameters
    ----------
    places : numpy.ndarray
        (n, 2) [mm].
    others : numpy.ndarray
        (m, 2) [mm].
    sensor : Sensor
        Its symmetry gives the mirror images.

    Returns
    -------
    numpy.ndarray
        (n,) [mm].
    """
    return cKDTree(folded(others, sensor)).query(folded(places, sensor))[0]


@dataclass(frozen=True)
class Separation:
    """How far test sites lie from training sites [mm], and the usual spacing of the plan's sites."""

    smallest_mm: float
    test_site: str
    training_site: str
    spacing_mm: float

    @property
    def doubtful(self) -> bool:
        """Whether a test site lies nearer to training than half of the usual spacing: its images were almost trained on."""
        return self.smallest_mm < 0.5 * self.spacing_mm


def separation(
    planned: Mapping[str, PlannedCell], split: Mapping[str, str], sensor: Sensor
) -> Separation | None:
    """Return how far the test sites of a plan lie from its training sites, mirror images included.

    The usual spacing is that of a regular grid of as many positions over the same rectangle: sites that were meant to be one
    lie near each other, and their distance is not the plan's spacing.

    Parameters
    ----------
    planned : mapping of str to PlannedCell
        All sites of the plan.
    split : mapping of str to str
        "train" or "test" by site.
    sensor : Sensor
        Its symmetry gives the mirror images.

    Returns
    -------
    Separation or None
        Distances [mm]; None for a plan without test or without training sites.
    """
    names, places = np.array(list(planned)), folded(_places(planned), sensor)
    tests = np.array([split[name] == "test" for name in names], bool)
    if tests.all() or not tests.any():
        return None
    distance, nearest = cKDTree(places[~tests]).query(places[tests])
    k = int(distance.argmin())
    unfolded = _places(planned)
    positions = len(np.unique(chained(unfolded, _tolerance_mm(planned))))
    spacing = _spacing_mm(np.ptp(unfolded, axis=0), positions)
    return Separation(float(distance[k]), str(names[tests][k]), str(names[~tests][nearest[k]]), spacing)


def _spacing_mm(sides: np.ndarray, count: int) -> float:
    """Return the spacing s [mm] of a grid of `count` positions over a rectangle: (L / s + 1) (W / s + 1) = count."""
    (length, width), n = sides, max(count - 1, 1)
    return float((length + width + np.sqrt((length + width) ** 2 + 4 * n * length * width)) / (2 * n))


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
    """Return the split of a plan: an orbit of symmetric sites is in one part as a whole.

    Parameters
    ----------
    planned : mapping of str to PlannedCell
        All sites of the plan.
    sensor : Sensor
        Its symmetry makes the orbits.
    test_fraction : float
        Share of the orbits that test.
    seed : int
        Of the draw.

    Returns
    -------
    dict of str to str
        "train" or "test" by site.
    dict of str to str
        Orbit by site.
    """
    orbit = orbits(planned, sensor)
    places = {name: np.array([cell.x_mm, cell.y_mm]) for name, cell in planned.items()}
    return split_orbits(orbit, distances_from_wall(places, sensor), test_fraction, seed), orbit


def split_training(
    places: Mapping[str, np.ndarray], orbit: Mapping[str, str], sensor: Sensor, fraction: float, seed: int
) -> dict[str, str]:
    """Return whether each training site trains or validates.

    Parameters
    ----------
    places : mapping of str to numpy.ndarray
        (2,) [mm], of the training sites with rows.
    orbit : mapping of str to str
        By site, as `planned_split` returns it.
    sensor : Sensor
        Its walls and symmetry.
    fraction : float
        Share of the orbits that validate.
    seed : int
        Of the study.

    Returns
    -------
    dict of str to str
        "train" or "validation" by site.
    """
    split = split_orbits(orbit, distances_from_wall(places, sensor), fraction, seed + 1)
    return {cell: "validation" if side == "test" else "train" for cell, side in split.items()}


def distances_from_wall(places: Mapping[str, np.ndarray], sensor: Sensor) -> dict[str, float]:
    """Return the distance [mm] of each site's position (2,) [mm] from the nearest side of the sensor."""
    widths = np.array([sensor.width_x_mm, sensor.width_y_mm])
    return {name: float(np.minimum(place, widths - place).min()) for name, place in places.items()}
