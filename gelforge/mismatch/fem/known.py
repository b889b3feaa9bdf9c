"""What a study takes as known of force sensor, clock, camera or indentations (mismatch.known) becomes part of the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.config.parts.mismatch import Known
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem.solutions import Solver, SolverFailed
from gelforge.mismatch.fem.solver import Amounts, Base, forces_with
from gelforge.mismatch.model.context import Context, Curves
from gelforge.mismatch.model.effect import Effect, Shape


def with_known(base: Base, solver: Solver) -> Base:
    """Return the base with the effects that the study takes as known (the camera's: flow.py).

    What changes the force is then read as a known force sensor does.

    Raises ConfigError for an effect, a parameter or a shape that there is not, SolverFailed.
    """
    chosen = []
    for known in solver.study.mismatch.known:
        effect = _effect_of(known)
        if effect.to_forces is None:
            continue
        _check_shape(known, effect.shapes(base.context))
        amounts = np.array([known.amounts.get(p.name, 0.0) for p in effect.parameters])
        chosen.append((effect, known.shape, amounts))
    if not chosen:
        return base
    try:
        force = forces_with(solver, base, chosen)
    except NotConverged as failure:
        names = ", ".join(effect.name for effect, *_ in chosen)
        raise SolverFailed(
            f"mismatch.known: the nominal model with {names} does not converge: {failure}"
        ) from None
    return _as_read(
        replace(base, context=replace(base.context, force=force)), _sensor_of(base.context, chosen)
    )


def _sensor_of(context: Context, chosen: Sequence[Amounts]) -> np.ndarray:
    """Return the matrix (3, 3) by which known effects read one newton more along each axis; what only adds: as it is."""

    def read(force):
        for effect, shape, amounts in chosen:
            if not effect.solved and effect.to_forces is not None:
                force = effect.to_forces(replace(context, force=force), shape, force, tuple(amounts))
        return force

    alone = read(context.force)
    return np.column_stack([(read(context.force + axis) - alone)[0] for axis in np.eye(3)])


def _as_read(base: Base, sensor: np.ndarray) -> Base:
    """Return the base whose derivatives, laws and mesh's errors are read by a force sensor (3, 3), as its forces are."""

    def read(curves: Curves) -> Curves:
        return replace(curves, values=tuple(values @ sensor.T for values in curves.values))

    own = base.context
    context = replace(
        own,
        curves=read(own.curves),
        derivatives={name: read(curves) for name, curves in own.derivatives.items()},
        at_readings={name: values @ sensor.T for name, values in own.at_readings.items()},
    )
    law, floor = np.einsum("ij,rjq->riq", sensor, base.law), np.sqrt(base.floor**2 @ (sensor**2).T)
    return replace(base, context=context, law=law, floor=floor, sensor=sensor)


def _effect_of(known: Known) -> Effect:
    effect = CATALOGUE.get(known.effect)
    if effect is None or (effect.to_forces is None and effect.to_camera is None):
        raise ConfigError(
            f"mismatch.known: no effect {known.effect!r} of forces or camera; the catalogue has {sorted(CATALOGUE)}"
        )
    unknown = set(known.amounts) - {p.name for p in effect.parameters}
    if unknown:
        names = [p.name for p in effect.parameters]
        raise ConfigError(f"mismatch.known, {known.effect}: no parameter {sorted(unknown)}; it has {names}")
    return effect


def _check_shape(known: Known, offered: Sequence[Shape]) -> None:
    """Raise ConfigError where it is not said which shape is meant; numbers may lie between those offered, words not.

    Of effects that these readings cannot show, nothing is offered and nothing checked.
    """
    if not offered:
        return
    ways = {key: sorted({shape[key] for shape in offered}) for key in offered[0]}
    tried = "; ".join(f"{key}: {', '.join(map(str, values))}" for key, values in ways.items()) or "none"
    if set(known.shape) != set(ways):
        raise ConfigError(
            f"mismatch.known, {known.effect}: its shape has {sorted(known.shape)} and must have {sorted(ways)};"
            f" those tried are {tried}"
        )
    for key, value in known.shape.items():
        if isinstance(value, str) and value not in ways[key]:
            raise ConfigError(f"mismatch.known, {known.effect}: no {key} {value!r}; those tried are {tried}")
