"""What a study takes as known of force sensor, clock, camera or presses (mismatch.known) becomes part of the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.config.mismatch import Known
from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.effect import Effect, Shape
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.solutions import Solver, SolverFailed
from gelforge.mismatch.solver import Base, forces_with


def with_known(base: Base, solver: Solver) -> Base:
    """Return the base with the effects that the study takes as known (the camera's: flow.py).

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
        raise SolverFailed(f"mismatch.known: the base with {names} does not converge: {failure}") from None
    return replace(base, context=replace(base.context, force=force))


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
    told = "; ".join(f"{key}: {', '.join(map(str, values))}" for key, values in ways.items()) or "none"
    if set(known.shape) != set(ways):
        raise ConfigError(
            f"mismatch.known, {known.effect}: its shape has {sorted(known.shape)} and must have {sorted(ways)};"
            f" the judge tries {told}"
        )
    for key, value in known.shape.items():
        if isinstance(value, str) and value not in ways[key]:
            raise ConfigError(f"mismatch.known, {known.effect}: no {key} {value!r}; there is {told}")
