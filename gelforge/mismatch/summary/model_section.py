"""What is modelled without a known cause, as it stands in verdict.json and in correction.csv."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.mismatch.inference.discrepancy import Modelled
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.terms.problem import Problem
from gelforge.recording.readings import AXES


def model_section(problem: Problem, judgement: Judgement) -> form.Model | None:
    """Return what verdict.json says of the model, of problem and judgement of the forces alone; None where there is none."""
    model = judgement.model
    if model is None:
        return None
    mask, named = judgement.blocks.held_out, model.module is not None and model.module.named
    proof = judgement.answer.proof if judgement.answer is not None and model.beside else None
    changes = [np.abs(model.change[problem.labels["axis"] == k]) for k in range(3)]
    return form.Model(
        cause=model.module.name if model.module is not None and named else None,
        probability=model.probability if named else None,
        words=f"a change of {model.kernel}" if model.module is None else in_words(model),
        beside=[part.name for part in judgement.answered.fit.parts] if model.beside else [],
        largest_N=[float(change.max()) if len(change) else None for change in changes],
        depth_mm=model.span.depth_mm,
        sites=len(model.sites),
        corrects_labels=model.of_place,
        held_out=form.HeldOut(
            block="all",
            before=form.score(problem.labels, problem.residual if proof is None else proof.left, mask),
            after=form.score(problem.labels, model.left, mask),
            gain=model.gain.total,
            standard_error=model.gain.standard_error,
        ),
    )


def in_words(model: Modelled) -> str:
    """Return a cause with its free form, and the map where it is surest."""
    table, module = model.map(), model.module
    assert table is not None and module is not None  # of a cause
    best = table.loc[(table["mean"].abs() / table["sigma"]).idxmax()]
    unit, share = (" %", 100.0) if best["unit"] == "1" else (f" {best['unit']}", 1.0)
    size = f"{share * best['mean']:+.2g} ± {share * best['sigma']:.1g}{unit}"
    return f"{module.says}: {best['quantity']} {size} {module.where(best)}"


def correction_table(problem: Problem, model: Modelled | None) -> pd.DataFrame | None:
    """Return the rows of correction.csv: the change of simulated forces at every judged place and depth while loading.

    None where nothing is modelled, or what is modelled is no function of place and depth.
    """
    if model is None or not model.of_place:
        return None
    place, table = ["x_mm", "y_mm", "depth_mm"], problem.observations.table
    rows = table[table["phase"] == "load"].drop_duplicates(place).sort_values(["y_mm", "x_mm", "depth_mm"])
    force = problem.base[rows.index]
    if model.module is None:
        x, y, depth = rows[place].to_numpy(float).T
        change, sigma, _ = model.at(x, y, depth, force)
    else:
        both = np.full((2, *problem.base.shape), np.nan)  # nan where an axis was not read
        both[:, problem.observations.read] = model.change, model.spread
        change, sigma = both[:, rows.index]
    found = rows[place].reset_index(drop=True)
    for k, axis in enumerate(AXES):
        for name, values in (("base", force), ("change", change), ("sigma", sigma)):
            found[f"{name}_{axis}_N"] = values[:, k]
    return found
