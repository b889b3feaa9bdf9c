"""The answer as keys of the configuration: a study run with them has the effect in its sites."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.mismatch.evidence.kernels import Module
from gelforge.mismatch.evidence.refit import Refitted
from gelforge.mismatch.model.effect import Effect


def patch_of(
    study: Study,
    effects: Mapping[str, Effect],
    fit: Refitted | None,
    module: Module | None = None,
    map_: pd.DataFrame | None = None,
) -> dict[str, Any]:
    """Return the keys that differ with the fitted effects.

    What the finite elements know becomes keys of mechanics (and `plan.symmetry: none` instead of `d4`, where mirror images
    no longer hold); what belongs to force sensor, clock or single indentations goes to mismatch.known, which the judge
    adds to the base. The map of a module goes to mechanics where a study can have it, and nowhere else.
    """
    with_effects, known = study, []
    for part, amounts in () if fit is None else zip(fit.parts, fit.amounts):
        effect = effects[part.name]
        if effect.to_study is not None:
            with_effects = effect.to_study(with_effects, part.shape, tuple(amounts))
        else:
            values = {p.name: float(a) for p, a in zip(effect.parameters, np.asarray(amounts))}
            known.append({"effect": part.name, "amounts": values, "shape": dict(part.shape)})
    if module is not None and module.to_study is not None and map_ is not None:
        with_effects = module.to_study(with_effects, map_["mean"].to_numpy())
    changes = differences(study.model_dump(mode="json"), with_effects.model_dump(mode="json"))
    if known:
        changes.setdefault("mismatch", {})["known"] = [
            *study.model_dump(mode="json")["mismatch"]["known"],
            *known,
        ]
    return changes


def differences(before: Mapping, after: Mapping) -> dict[str, Any]:
    """Return the keys of nested mappings whose values differ, with the values after."""
    changed = {}
    for key, value in after.items():
        old = before.get(key)
        if value == old:
            continue
        if isinstance(value, dict) and isinstance(old, dict):
            changed[key] = differences(old, value)
        else:
            changed[key] = value
    return changed
