"""Derivatives that the solver must give: their variations of the study, and the indentations that show them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import ConfigError
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.sensitivities import Variation
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.model.effect import Context, Effect, Shape
from gelforge.mismatch.model.images_of_presses import carried, carried_derivative, numbers_at_image
from gelforge.mismatch.model.places import FirstOrder
from gelforge.mismatch.thresholds import REACH_MM

ALWAYS_SHOWN = ("base", "law ", "unloading ")


@dataclass(frozen=True)
class Asked:
    """A derivative that the solver must give: to amount `which` of an effect at one of its shapes."""

    effect: Effect
    shapes: Sequence[Shape]
    number: int
    which: int
    variation: Variation

    @property
    def shape(self) -> Shape:
        return self.shapes[self.number]

    @property
    def key(self) -> str:
        return self.keys_of(self.number)[self.which]

    def keys_of(self, number: int) -> list[str]:
        """Return the keys of the effect at one of its shapes, one per value."""
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
        shapes = effect.shapes(context)
        for number, shape in enumerate(shapes):
            if at is not None and not reaches(shape, at.x_mm, at.y_mm):
                continue
            for which in range(len(effect.parameters)):
                try:
                    variation = _variation(solver, effect, shape, which)
                except ConfigError:  # this sensor does not have what the effect is about
                    continue
                yield Asked(effect, shapes, number, which, variation)


def _variation(solver: Solver, effect: Effect, shape: Shape, which: int) -> Variation:
    """Return the coarser study a little next to itself along amount `which` of an effect. Raises ConfigError.

    Of some its place is taken by a difference to either side of the base, wide enough that ripples from node to node cancel.
    """
    coarse, laws, to_study = solver.coarse, dict(solver.laws), effect.to_study
    assert to_study is not None  # its forces are first order in the solver's derivatives
    step, instead = effect.unit_step(which, effect.step), None
    if effect.across:
        wide = effect.across(coarse) * np.eye(len(step))[which]
        there, back = (solver.seen(to_study(coarse, shape, tuple(side * wide))) for side in (1, -1))
        instead = Variation(there, laws, 2 * wide[which], alone=True, without=back)
    varied = solver.seen(to_study(coarse, shape, step))
    alone = effect.mesh_changes or effect.binary or effect.history
    return Variation(varied, laws, step[which], alone, instead=instead)


def observed_by(asked: Sequence[Asked], planned: PlannedCell) -> dict[str, Variation]:
    """Return the variations that an indentation at a position can show."""
    return {one.key: one.variation for one in asked if reaches(one.shape, planned.x_mm, planned.y_mm)}


def reaches(shape: Shape, x: float, y: float) -> bool:
    """Return whether an indentation at (x, y) [mm] shows an effect of this shape: one without a place acts everywhere."""
    if "x_mm" not in shape:
        return True
    return bool(np.hypot(float(shape["x_mm"]) - x, float(shape["y_mm"]) - y) <= REACH_MM)


def carried_derivatives(
    image: Mapping[str, np.ndarray], symmetry: str, asked: Sequence[Asked], width_mm: float
) -> dict[str, np.ndarray]:
    """Return vectors (D, ..., 3) solved at a mirror image as those here: forces, `law`s and the asked ones that it shows.

    The reason why one could not be had stays a reason.
    """
    own = {key: carried(image[key], symmetry) for key in image if key.startswith(ALWAYS_SHOWN)}
    numbers: dict[str, list[int]] = {}  # of each effect's shapes, at the image
    for one in asked:
        name = one.effect.name
        if name not in numbers:
            numbers[name] = numbers_at_image(one.shapes, symmetry, width_mm)
        keys = one.keys_of(numbers[name][one.number])
        if reasons := [image[f"reason {key}"] for key in keys if f"reason {key}" in image]:
            own[f"reason {one.key}"] = reasons[0]
        elif (along := carried_derivative(image, symmetry, one.effect, keys, one.which)) is not None:
            own[one.key] = along
    return own
