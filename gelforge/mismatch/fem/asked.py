"""Derivatives that the solver must give: their variations of the study, and the indentations that show them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import ConfigError
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.sensitivities import Variation
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters
from gelforge.mismatch.model.images_of_presses import carried, carried_derivative, numbers_at_image
from gelforge.mismatch.model.places import FirstOrder
from gelforge.mismatch.thresholds import REACH_MM

ALWAYS_SHOWN = ("base", "law ", "unloading ")


@dataclass(frozen=True)
class Asked:
    """A derivative that the solver must give: to parameter `which` of an effect at one point of its grid."""

    effect: Effect
    grid: Sequence[Hyperparameters]
    number: int
    which: int
    variation: Variation

    @property
    def hyperparameters(self) -> Hyperparameters:
        return self.grid[self.number]

    @property
    def key(self) -> str:
        return self.keys_of(self.number)[self.which]

    def keys_of(self, number: int) -> list[str]:
        """Return the keys of the effect at one point of its grid, one per value."""
        assert isinstance(self.effect.to_forces, FirstOrder)
        return self.effect.to_forces.keys(number)


def asked_of(
    solver: Solver, effects: Iterable[Effect], context: Context, at: PlannedCell | None = None
) -> Iterator[Asked]:
    """Yield every derivative that the solver must give, with the variation of the coarser study; those felt at a position.

    at: the indentation there; None: everywhere.
    """
    for effect in effects:
        if not isinstance(effect.to_forces, FirstOrder):
            continue
        grid = effect.grid(context)
        for number, hyperparameters in enumerate(grid):
            if at is not None and not reaches(hyperparameters, at.x_mm, at.y_mm):
                continue
            for which in range(len(effect.parameters)):
                try:
                    variation = _variation(solver, effect, hyperparameters, which)
                except ConfigError:  # this sensor does not have what the effect is about
                    continue
                yield Asked(effect, grid, number, which, variation)


def _variation(solver: Solver, effect: Effect, hyperparameters: Hyperparameters, which: int) -> Variation:
    """Return the coarser study a little next to itself along parameter `which` of an effect. Raises ConfigError.

    Of some its place is taken by a difference to either side of the base, wide enough that ripples from node to node cancel.
    """
    coarse, laws, to_study = solver.coarse, dict(solver.laws), effect.to_study
    assert to_study is not None  # its forces are first order in the solver's derivatives
    step, instead = effect.unit_step(which, effect.step), None
    if effect.across:
        wide = effect.across(coarse) * np.eye(len(step))[which]
        there, back = (solver.seen(to_study(coarse, hyperparameters, tuple(side * wide))) for side in (1, -1))
        instead = Variation(there, laws, 2 * wide[which], alone=True, without=back)
    varied = solver.seen(to_study(coarse, hyperparameters, step))
    alone = effect.mesh_changes or effect.binary or effect.history
    return Variation(varied, laws, step[which], alone, instead=instead)


def observed_by(asked: Sequence[Asked], planned: PlannedCell) -> dict[str, Variation]:
    """Return the variations that an indentation at a position can show."""
    x, y = planned.x_mm, planned.y_mm
    return {one.key: one.variation for one in asked if reaches(one.hyperparameters, x, y)}


def reaches(hyperparameters: Hyperparameters, x: float, y: float) -> bool:
    """Return whether an indentation at (x, y) [mm] shows an effect: one without a place acts everywhere."""
    if "x_mm" not in hyperparameters:
        return True
    return bool(np.hypot(float(hyperparameters["x_mm"]) - x, float(hyperparameters["y_mm"]) - y) <= REACH_MM)


def carried_derivatives(
    image: Mapping[str, np.ndarray], symmetry: str, asked: Sequence[Asked], width_mm: float
) -> dict[str, np.ndarray]:
    """Return vectors (D, ..., 3) solved at a mirror image as those here: forces, `law`s and the asked ones that it shows.

    The reason why one could not be had stays a reason.
    """
    here = {key: carried(image[key], symmetry) for key in image if key.startswith(ALWAYS_SHOWN)}
    numbers: dict[str, list[int]] = {}  # of each effect's grid, at the image
    for one in asked:
        name = one.effect.name
        if name not in numbers:
            numbers[name] = numbers_at_image(one.grid, symmetry, width_mm)
        keys = one.keys_of(numbers[name][one.number])
        if reasons := [image[f"reason {key}"] for key in keys if f"reason {key}" in image]:
            here[f"reason {one.key}"] = reasons[0]
        elif (along := carried_derivative(image, symmetry, one.effect, keys, one.which)) is not None:
            here[one.key] = along
    return here
