"""Effects as linear changes of what was read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Effect

UNIT = 1e-3  # of a width: a step at which every first-order change is a straight line


def effects_of_forces(study: Study) -> dict[str, Effect]:
    """Return the effects that forces can show on a study's sensor, but for those that it leaves out.

    Raises ConfigError where it leaves out what there is not.
    """
    left_out = set(study.mismatch.leave_out)
    unknown = left_out - set(CATALOGUE)
    if unknown:
        raise ConfigError(
            f"mismatch.leave_out: no effect {sorted(unknown)}; the catalogue has {sorted(CATALOGUE)}"
        )
    tried = {name: effect for name, effect in CATALOGUE.items() if name not in left_out}
    return {name: e for name, e in tried.items() if e.to_forces is not None and e.applies(study)}


def candidates_of(context: Context, effects: Mapping[str, Effect], failed: dict[str, str]) -> list[Candidate]:
    """Return every effect at every shape as a linear change of what was read; what is not known goes to failed."""
    found = []
    for name, effect in effects.items():
        for shape in effect.shapes(context):
            try:
                columns = columns_of(context, effect, shape)
            except KeyError as missing:  # its derivative could not be had
                why = failed.setdefault(str(missing.args[0]), "no derivative of this sensor's nominal model")
                failed.setdefault(name, why)
                continue
            if not np.any(columns):
                continue
            found.append(Candidate(name, shape, columns, effect.prior_sd, effect.signs, effect.binary))
    return found


def columns_of(context: Context, effect: Effect, shape: Mapping) -> np.ndarray:
    """Return the change of what was read (n, P) [N] per unit of the parameter."""
    if effect.to_forces is None:
        raise ValueError(f"{effect.name} changes no forces; it has no columns among them")
    columns = []
    for k in range(len(effect.parameters)):
        step = effect.unit_step(k, UNIT)
        change = effect.to_forces(context, shape, context.force, step) - context.force
        columns.append(context.observations.flat(change) / step[k])
    return np.column_stack(columns)
