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
    mask = judgement.blocks.held_out
    proof = judgement.answer.proof if judgement.answer is not None and model.beside else None
    before = problem.residual if proof is None else proof.left
    axis = problem.labels["axis"].to_numpy()
    largest = [float(np.abs(model.change[axis == k]).max()) if (axis == k).any() else None for k in range(3)]
    return form.Model(
        cause=None if model.module is None or not model.module.named else model.module.name,
        probability=None if model.module is None or not model.module.named else model.probability,
        words=f"a change of {model.kernel}" if model.module is None else in_words(model),
        beside=[part.name for part in judgement.answered.fit.parts] if model.beside else [],
        largest_N=largest,
        depth_mm=model.span.depth_mm,
        sites=len(model.sites),
        corrects_labels=model.of_place,
        held_out=form.HeldOut(
            block="all",
            before=form.score(problem.labels, before, mask, model.scores["before"]["score"].sum()),
            after=form.score(problem.labels, model.left, mask, model.scores["after"]["score"].sum()),
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


def _of_readings(problem: Problem, entries: np.ndarray) -> np.ndarray:
    """Return entries (n,) as (R, 3), nan where an axis was not read."""
    found = np.full(problem.base.shape, np.nan)
    found[problem.observations.read] = entries
    return found


def correction_table(problem: Problem, model: Modelled | None) -> pd.DataFrame | None:
    """Return the rows of correction.csv: the change of simulated forces at every judged place and depth while loading.

    None where nothing is modelled, or what is modelled is no function of place and depth.
    """
    if model is None or not model.of_place:
        return None
    table = problem.observations.table
    rows = table[table["phase"] == "load"].drop_duplicates(["x_mm", "y_mm", "depth_mm"])
    rows = rows.sort_values(["y_mm", "x_mm", "depth_mm"])
    force = problem.base[rows.index]
    if model.module is None:
        x, y, depth = (rows[name].to_numpy(float) for name in ("x_mm", "y_mm", "depth_mm"))
        change, sigma, _ = model.at(x, y, depth, force)
    else:
        assert model.spread is not None  # of a cause
        change, sigma = (_of_readings(problem, own)[rows.index] for own in (model.change, model.spread))
    found = rows[["x_mm", "y_mm", "depth_mm"]].reset_index(drop=True)
    for k, axis in enumerate(AXES):
        found[f"base_{axis}_N"], found[f"change_{axis}_N"], found[f"sigma_{axis}_N"] = (
            force[:, k],
            change[:, k],
            sigma[:, k],
        )
    return found
