"""What effects of the finite elements share: values of their catalogue, entry into a study, first-order forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from gelforge.config import Effects, Mechanics, Study, changed_study
from gelforge.indentation.effects.catalogue import CATALOGUE, Place, with_keys
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Parameter, Shape

ON = (-0.5, 1.5)  # bounds of what is off (0) or on (1)
LARGEST_MOVE = 0.3  # [mm]; beside a wall the pull sets in within half a millimetre
FAR_OUT = 0.3  # of the sensor's width from its middle: where the outermost indentations of usual plans are


def amount(
    effect: str, name: str, bounds: tuple[float, float], source: str, sign: int = 0, whole: bool = False
) -> Parameter:
    """Return a parameter with the unit and the plausible width that the catalogue of the finite elements gives."""
    known = CATALOGUE[effect]
    return Parameter(name, known.unit, known.width, bounds, source, sign, whole)


def half_an_element(study: Study) -> float:
    """Return half of the elements' size under an indentation [mm], or less: across it ripples from node to node cancel."""
    return min(study.mechanics.mesh.used.near_mm / 2, LARGEST_MOVE)


def half_an_element_far_out(study: Study) -> float:
    """Return the angle [rad] or the growth by which the outermost indentations move so far."""
    return half_an_element(study) / (FAR_OUT * study.sensor.width_x_mm)


def solver(
    name: str,
    present: Callable[[Study], float] | None = None,
    limit: tuple[float, float] = (-np.inf, np.inf),
    directed: bool = False,
) -> dict:
    """Return the fields of an Effect with one value that the catalogue of the finite elements adds to a study.

    present: what the base has of it already, for entries that replace a number; limit: beyond it more changes nothing;
    directed: it has a place, a direction or an order, so indentations of a square have no mirror images.
    """
    known = CATALOGUE[name]

    def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
        (a,) = amounts
        if a == 0 and not known.mesh_changes:
            return study
        a = float(np.clip(a + (present(study) if present else 0.0), *limit))
        place = Place(**{axis: float(value) for axis, value in shape.items()}) if shape else None
        return known(unmirrored(study) if directed else study, a, place)

    return {
        "enters": known.enters,
        "to_study": to_study,
        "to_forces": first_order(name),
        "binary": known.binary,
        "history": known.history,
        "mesh_changes": known.mesh_changes,
        "unloading": known.unloading,
        "step": known.step,
    }


def pair_of(
    family: str, read: Callable[[Study], Sequence[float]], keys: Callable[[Study, list[float]], dict]
):
    """Return the `to_study` of an effect with two directions.

    read gives the two numbers that the base has; keys gives the keys of mechanics.effects.<family> with two others.
    """

    def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
        if not any(amounts):
            return study
        both = [float(has + a) for has, a in zip(read(study), amounts, strict=True)]
        return with_keys(unmirrored(study), **{family: keys(study, both)})

    return to_study


def as_vector(turn: np.ndarray) -> np.ndarray:
    """Return how two values along x and y turn with the sensor under an element (2, 2) of D4."""
    return turn


def as_rotation(turn: np.ndarray) -> np.ndarray:
    """Return how small turns about x and y turn with the sensor: a mirror reverses them."""
    return np.linalg.det(turn) * turn


def as_spin(turn: np.ndarray) -> np.ndarray:
    """Return how a turn about z is changed: a mirror reverses it."""
    return np.array([[np.linalg.det(turn)]])


def inverted(changes: Callable[[Mechanics], dict]):
    """Return the `to_study` of a switch: 1 sets the keys of mechanics that `changes` gives for the base's own."""

    def to_study(study: Study, shape: Shape, amounts: Sequence[float]) -> Study:
        (a,) = amounts
        if a not in (0, 1):
            raise ValueError(f"a simplification is turned round (1) or kept (0), found {a:g}")
        if a == 0:
            return study
        return changed_study(study, {"mechanics": changes(study.mechanics)})

    return to_study


@dataclass(frozen=True)
class FirstOrder:
    """The `to_forces` of an effect whose own derivatives the solver gives: force + sum of amount x derivative."""

    keys: tuple[str, ...]

    def __call__(
        self, context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]
    ) -> np.ndarray:
        for key, a in zip(self.keys, amounts, strict=True):
            force = force + a * context.derivative(key)
        return force


def first_order(name: str, *parameters: str) -> FirstOrder:
    """Return the `to_forces` of an effect by its derivative, or by those to its parameters."""
    return FirstOrder(tuple(f"{name}.{parameter}" for parameter in parameters) or (name,))


def per_depth(context: Context) -> np.ndarray:
    """Return d force / d depth (R, 3) [N/mm]: the solver's where it is known, else the slope of the base's curves."""
    known = {*context.derivatives, *context.at_readings}
    return context.derivative("contact_zero") if "contact_zero" in known else context.slope()


def has(key: str) -> Callable[[Study], float]:
    """Return the function that reads a number of mechanics.effects."""
    read = attrgetter(key)
    return lambda study: read(study.mechanics.effects)


def has_none_of(*keys: str) -> Callable[[Study], bool]:
    """Return the test that a study leaves some keys of mechanics.effects as they are by default."""
    nothing = Effects()
    return lambda study: all(
        attrgetter(key)(study.mechanics.effects) == attrgetter(key)(nothing) for key in keys
    )


def is_block(study: Study) -> bool:
    """Whether the sensor is a block, as effects of the geometry need."""
    return study.sensor.shape.kind == "block"
