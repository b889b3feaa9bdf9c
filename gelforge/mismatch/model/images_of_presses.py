"""Indentations that are mirror images of one another on a square sensor: one is solved, the others are carried from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from gelforge.config import Study
from gelforge.indentation.paths.places import DIGITS
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.sensor.symmetry import D4, transform_points, transform_vectors
from gelforge.mismatch.model.effect import Effect, Hyperparameters

Path = TypeVar("Path", PlannedCell, Trajectory)


def solved_for_all(
    study: Study, paths: Sequence[Path], solve: Callable[[list[Path]], list]
) -> tuple[list, list[str]]:
    """Return what solve gives for each path, or for the image that stands for it, and the symmetry that carries it here."""
    images = [image_of(study, path) for path in paths]
    distinct = list(dict.fromkeys(image for image, _ in images))
    number = {image: k for k, image in enumerate(distinct)}
    solutions = solve(distinct)
    return [solutions[number[image]] for image, _ in images], [symmetry for _, symmetry in images]


def image_of(study: Study, path: Path) -> tuple[Path, str]:
    """Return the image of a straight path in one eighth of the sensor and the element of D4 that carries it back.

    Where the study does not look the same from all sides that is the path itself.
    """
    path = replace(path, name="") if isinstance(path, PlannedCell) else path
    if not study.has_symmetry_of_square or path.shears_mm or path.tilts_deg or path.twists_deg:
        return path, "identity"
    width, here = study.sensor.width_x_mm, np.array([path.x_mm, path.y_mm])
    places = {name: tuple(np.round(transform_points(name, here, width), DIGITS) + 0.0) for name in D4}
    name = max(D4, key=lambda name: places[name])
    x, y = places[name]
    return replace(path, x_mm=float(x), y_mm=float(y)), inverse(name)


def inverse(symmetry: str) -> str:
    """Return the element of D4 that undoes another."""
    return next(name for name, D in D4.items() if np.array_equal(D, D4[symmetry].T))


def carried(total: np.ndarray, symmetry: str) -> np.ndarray:
    """Return forces (..., 3) of the image as those of the path itself; the image's own where it is the path."""
    return total if symmetry == "identity" else transform_vectors(symmetry, total)


def carried_derivative(
    found: Mapping[str, np.ndarray], symmetry: str, effect: Effect, keys: Sequence[str], which: int
) -> np.ndarray | None:
    """Return d force / d theta (D, 3) for parameter `which` of an effect from those for all its values at the image.

    keys: names of the image's derivatives, one per value. None where the image does not show the effect.
    """
    turn = effect.turned(D4[inverse(symmetry)])[:, which]
    parts = [share * found[key] for share, key in zip(turn, keys) if share and key in found]
    return carried(np.sum(parts, axis=0), symmetry) if parts else None


def numbers_at_image(grid: Sequence[Hyperparameters], symmetry: str, width: float) -> list[int]:
    """Return for each point of a grid at the path its number at the image: a place, or a side of the sensor, moves."""
    if symmetry == "identity":
        return [*range(len(grid))]
    rest = [{k: v for k, v in one.items() if k not in ("x_mm", "y_mm", "side")} for one in grid]
    here = np.array([_place_of(one, width) for one in grid])
    there = transform_points(inverse(symmetry), here, width)
    numbers = []
    for number, (one, place) in enumerate(zip(rest, there)):
        if np.isfinite(place).all():
            same = np.array([other == one for other in rest])
            number = int(np.argmin(np.where(same, np.abs(here - place).max(axis=1), np.inf)))
        numbers.append(number)
    return numbers


def _place_of(hyperparameters: Hyperparameters, width: float) -> tuple[float, float]:
    """Return the place (x, y) [mm] of hyperparameters, of a side of the sensor its middle; nan without."""
    if "side" not in hyperparameters:
        return float(hyperparameters.get("x_mm", np.nan)), float(hyperparameters.get("y_mm", np.nan))
    axis, end = str(hyperparameters["side"]).split("_")
    at = width * (end == "high")
    return (at, width / 2) if axis == "x" else (width / 2, at)
