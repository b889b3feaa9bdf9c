"""What effects of the finite elements share: values of their catalogue, entry into a study, first-order forces."""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from gelforge.config import Effects, Mechanics, Study, changed_study
from gelforge.indentation.effects.catalogue import CATALOGUE, Place, gel_layers, with_keys
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters, Parameter
from gelforge.mismatch.model.places import FirstOrder

LARGEST_MOVE = 0.3  # [mm]; next to a wall the pull sets in within half a millimetre
FAR_OUT = 0.3  # of the sensor's width from its middle: where the outermost indentations of usual plans are


def solved(
    name: str,
    parameters: str | tuple[str, ...],
    bounds: tuple[float, float],
    source: str,
    present: Callable[[Study], Any] | None = None,
    closed: bool = False,
    directed: bool = False,
    scanned: Callable[[Study], list[Hyperparameters]] | None = None,
    keys: Callable[[Study, list[float]], dict] | None = None,
    **fields,
) -> Effect:
    """Return an effect that the catalogue of the finite elements adds to a study.

    Parameters
    ----------
    name : str
        Of the catalogue's entry: it gives unit, plausible width, family and keys.
    parameters : str or tuple of str
        One parameter, or one for each of two directions.
    bounds, source : pair of float, str
        Of each parameter (see `Parameter`).
    present : callable, optional
        What a study has of it already, for entries that replace a number, or two.
    closed : bool
        Whether a bound is physical: beyond it more changes nothing.
    directed : bool
        Whether it has a place, a direction or an order, so that indentations of a square have no mirror images.
    scanned : callable, optional
        The hyperparameters that are tried, each with a derivative of its own.
    keys : callable, optional
        Of two directions: the keys of mechanics.effects that two numbers set.
    **fields
        Of the Effect, in place of those that follow from the catalogue.

    Returns
    -------
    Effect
    """
    entry, names = CATALOGUE[name], (parameters,) if isinstance(parameters, str) else parameters
    limit = bounds if closed else (-np.inf, np.inf)

    def to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
        if not any(theta) and (keys or not entry.mesh_changes):
            return study
        values = np.clip(np.add(theta, present(study) if present else 0.0), *limit).tolist()
        if keys:
            return with_keys(unmirrored(study), **keys(study, values))
        located = "x_mm" in hyperparameters
        place = Place(**{axis: float(x) for axis, x in hyperparameters.items()}) if located else None
        return entry(unmirrored(study) if directed else study, values[0], place)

    scan = {"grid": lambda context: scanned(context.study)} if scanned else {}
    about = {
        "parameters": tuple(
            Parameter(p, entry.unit, entry.width, bounds, source, closed=closed) for p in names
        ),
        "to_study": to_study,
        "to_forces": FirstOrder(name, names if keys else (), scanned),
    }
    return Effect(**_of_entry(name) | about | scan | fields)


def _of_entry(name: str) -> dict:
    """Return the fields of an Effect that an entry of the finite elements' catalogue gives."""
    names = ("name", "family", "binary", "history", "mesh_changes", "step")
    return {field: getattr(CATALOGUE[name], field) for field in names}


def switch(source: str) -> Parameter:
    """Return the parameter of what is off (0) or on (1)."""
    return Parameter("on", "1", 1.0, (0.0, 1.5), f"on or off: {source}, no quantity")


def simplification(name: str, changes: Callable[[Mechanics, Hyperparameters], dict], **fields) -> Effect:
    """Return a choice of the study that may be wrong.

    changes: the keys of mechanics that 1 sets, of the study's mechanics and the hyperparameters.
    """

    def to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
        (a,) = theta
        if a not in (0, 1):
            raise ValueError(f"a simplification is turned round (1) or kept (0), found {a:g}")
        return changed_study(study, {"mechanics": changes(study.mechanics, hyperparameters)}) if a else study

    about = {
        "family": "simplification",
        "parameters": (switch("a choice of the study"),),
        "to_study": to_study,
        "to_forces": FirstOrder(name),
    }
    return Effect(**_of_entry(name) | about | fields)


def circumstance(name: str, source: str, key: str, reference: str, column: str, **fields) -> Effect:
    """Return a growth of the gel's stiffness with a circumstance of the sessions, beyond a reference of the study.

    At one age, or one temperature, it is another name for a stiffer gel: it is tried where readings differ in it. Sessions
    that do not say theirs stay as they are.
    """

    def present(study: Study) -> float:
        circumstances = study.mechanics.effects.material.circumstances
        return getattr(circumstances, key).get(gel_layers(study)[0], 0.0)

    def grid(context: Context) -> list[Hyperparameters]:
        table = context.observations.table
        return [{}] if table.empty or table[column].nunique() > 1 else []

    def to_forces(
        context: Context, _: Hyperparameters, force: np.ndarray, theta: Sequence[float]
    ) -> np.ndarray:
        (a,) = theta
        here = getattr(context.study.mechanics.effects.material.circumstances, reference)
        beyond = np.nan_to_num(context.observations.table[column].to_numpy(float) - here)
        return force + a * beyond[:, None] * context.derivative("gel_stiffness")

    fields |= {"depends_on": ("gel_stiffness",), "grid": grid, "to_forces": to_forces}
    return solved(name, "rate", (-0.1, 0.1), source, present, **fields)


def data_entry_error(
    name: str,
    key: str,
    alternatives: Sequence[str],
    default: str,
    read: Callable[[np.ndarray, str], np.ndarray],
    **words,
) -> Effect:
    """Return a mistake of the analyst that is there or not; each alternative is a point of the grid {key: alternative}.

    read gives what is read (R, 3) [N] of forces on the sensor (R, 3) by one of them.
    """

    def to_forces(
        context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
    ) -> np.ndarray:
        (a,) = theta
        return force + a * (read(force, str(hyperparameters.get(key, default))) - force)

    return Effect(
        name,
        "analyst",
        (switch("a data-entry error of the session"),),
        to_forces=to_forces,
        grid=lambda context: [{key: one} for one in alternatives],
        binary=True,
        **words,
    )


def on_each_axis(unit: str, width: float, bounds: tuple[float, float], source: str) -> tuple[Parameter, ...]:
    """Return a parameter for each axis of the force sensor."""
    return tuple(Parameter(axis, unit, width, bounds, source) for axis in "xyz")


def half_an_element(study: Study) -> float:
    """Return half of the elements' size under an indentation [mm], or less: across it ripples from node to node cancel."""
    return min(study.mechanics.mesh.used.near_mm / 2, LARGEST_MOVE)


def half_an_element_far_out(study: Study) -> float:
    """Return the angle [rad] or the growth by which the outermost indentations move so far."""
    return half_an_element(study) / (FAR_OUT * study.sensor.width_x_mm)


def as_vector(turn: np.ndarray) -> np.ndarray:
    """Return how two values along x and y turn with the sensor under an element (2, 2) of D4."""
    return turn


def as_rotation(turn: np.ndarray) -> np.ndarray:
    """Return how small turns about x and y turn with the sensor: a mirror reverses them."""
    return np.linalg.det(turn) * turn


def as_spin(turn: np.ndarray) -> np.ndarray:
    """Return how a turn about z is changed: a mirror reverses it."""
    return np.array([[np.linalg.det(turn)]])


def per_depth(context: Context) -> np.ndarray:
    """Return d force / d depth (R, 3) [N/mm]: the solver's where it is known, else the slope of the base's curves."""
    known = {*context.derivatives, *context.at_readings}
    return context.derivative("contact_zero") if "contact_zero" in known else context.slope()


def has(key: str) -> Callable[[Study], Any]:
    """Return the function that reads a number, or two, of mechanics.effects."""
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


def has_wall(study: Study) -> bool:
    """Whether the sensor is a block with a wall around the gel: without a second layer the wall is gel."""
    return study.sensor.wall_mm > 0 and len(study.sensor.layers) > 1 and is_block(study)


def pressed_by_balls(study: Study) -> bool:
    """Whether all parts of the indenter are spheres."""
    return all(part.kind == "sphere" for part in study.indenter.shapes)
