"""The relaxation of the gel, and of the skin, as a smooth spectrum: what one relaxation time does not follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.linalg import block_diag

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers, skin_layer, with_keys
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.viscoelastic import STIFFNESS, grid, overstress
from gelforge.mismatch.evidence.kernels import FreeForm, Module, modes
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return spectra of the layers under the skin and of the skin; none where all was read at first touch."""
    effect, phases = CATALOGUE["viscoelastic"], context.observations.table["phase"]
    if not effect.applies(context.study) or not phases.isin(["dwell", "unload"]).any():
        return None
    times: dict[str, list[float]] = {}
    for hyperparameters in grid(context):
        if STIFFNESS[str(hyperparameters["part"])] in context.derivatives:
            times.setdefault(str(hyperparameters["part"]), []).append(float(hyperparameters["time_s"]))
    return _spectra(context, {part: np.array(taus) for part, taus in times.items()}) if times else None


def _spectra(context: Context, times: Mapping[str, np.ndarray]) -> Module:
    """Return relative moduli at relaxation times [s] by part: together as wide as the catalogue's one branch."""
    (branch,) = CATALOGUE["viscoelastic"].parameters
    flat, directions, basis, maps = context.observations.flat, [], [], []
    for part, taus in times.items():
        smooth = branch.width / np.sqrt(len(taus)) * modes(np.log(taus), min(5, len(taus)))
        columns = np.column_stack([flat(overstress(context, STIFFNESS[part], tau)) for tau in taus])
        directions.append(columns @ smooth)
        basis.append(smooth)
        maps.append(pd.DataFrame({"quantity": f"{part}'s relative modulus", "relaxation_time_s": taus}))
    return Module(
        words="relaxation over the time",
        directions=np.column_stack(directions),
        name="relaxation",
        says="the layers relax with a spectrum of times",
        map=pd.concat(maps, ignore_index=True),
        basis=block_diag(*basis),
        unit="1",
        of_labels=False,  # it depends on the time of a press, which labels by place and depth do not have
        where=lambda row: f"of what relaxes in {row['relaxation_time_s']:.3g} s",
        form_of=("viscoelastic",),
        to_study=lambda study, moduli: _with_branches(study, times, moduli),
    )


def _with_branches(study: Study, times: Mapping[str, np.ndarray], moduli: np.ndarray) -> Study:
    """Return the study with overstresses of relative moduli (G,), part by part; a negative one is none."""
    ends = np.cumsum([len(taus) for taus in times.values()])[:-1]
    branches: dict[str, dict[str, list[float]]] = {}
    for (part, taus), values in zip(times.items(), np.split(moduli, ends)):
        kept = values > 1e-4  # a smaller branch is none
        names = gel_layers(study) if part == "gel" else [skin_layer(study)]
        if kept.any():
            branch = {"relative_moduli": values[kept].tolist(), "times_s": taus[kept].tolist()}
            branches |= dict.fromkeys(names, branch)
    return with_keys(study, history={"viscoelastic": branches}) if branches else study


FREE_FORM = FreeForm("relaxation", module)
