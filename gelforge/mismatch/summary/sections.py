"""What is modelled without a known cause, and what a verdict says of the images: sections of verdict.json and tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.images.flow_images import region_middles
from gelforge.mismatch.inference.discrepancy import Modelled
from gelforge.mismatch.inference.fits import solved_or_linear
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.inference.scan import global_test
from gelforge.mismatch.result import verdict as form
from gelforge.recording.readings import AXES


def model_section(problem: Problem, judgement: Judgement) -> form.Model | None:
    """Return what verdict.json says of the model; None where there is none."""
    model = judgement.model
    if model is None:
        return None
    held, labels, named = model.held, problem.in_newtons.labels, model.kernel.is_cause
    depth, change = labels["depth_mm"], np.abs(model.change[problem.of_force])
    if model.with_effects and judgement.answered.proof is not None:  # before: the effects alone
        held = held.model_copy(update={"before": judgement.answered.proof.held[0].after})
    changes = [change[labels["axis"] == k] for k in range(3)]
    return form.Model(
        cause=model.module.name if model.module is not None and named else None,
        probability=model.probability if named else None,
        words=f"a change of {model.kernel.words}" if model.module is None else in_words(model),
        with_effects=[part.name for part in judgement.answered.fit.parts] if model.with_effects else [],
        largest_N=[float(along.max()) if len(along) else None for along in changes],
        depth_mm=(float(depth.min()), float(depth.max())),
        sites=len(labels.drop_duplicates(["x_mm", "y_mm"])),
        corrects_labels=model.kernel.of_labels,
        held_out=held,
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
    if model is None or not model.kernel.of_labels:
        return None
    forces, of_force = problem.in_newtons, problem.of_force
    place, table = ["x_mm", "y_mm", "depth_mm"], forces.observations.table
    rows = table[table["phase"] == "load"].drop_duplicates(place).sort_values(["y_mm", "x_mm", "depth_mm"])
    both = np.full((2, *forces.base.shape), np.nan)  # nan where an axis was not read
    both[:, forces.observations.read] = model.change[of_force], model.spread[of_force]
    force, (change, sigma) = forces.base[rows.index], both[:, rows.index]
    corrections = rows[place].reset_index(drop=True)
    for k, axis in enumerate(AXES):
        for name, values in (("base", force), ("change", change), ("sigma", sigma)):
            corrections[f"{name}_{axis}_N"] = values[:, k]
    return corrections


def after_of(joint: Problem, judgement: Judgement) -> np.ndarray | None:
    """Return forces and flow (R, 3) of all readings with the answer's effects; None without images or an answer."""
    if joint.flow is None or judgement.answer is None:
        return None
    terms = [(joint.at_its_place(part), a) for part, a in judgement.answer.fit.terms]
    return solved_or_linear(joint, terms)[0]


def flow_section(joint: Problem, judgement: Judgement, after: np.ndarray | None) -> form.Flow | None:
    """Return what verdict.json says of the images, after (R, 3) by `after_of`; None without images.

    judgement of the joint problem, or of the forces alone.
    """
    if joint.flow is None:
        return None
    fitted = len(judgement.blocks.train) == len(joint.labels)
    mask = np.arange(len(joint.labels)) >= joint.flow.entries

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(joint.observations.flat(joint.observations.force - values)[mask] ** 2)))

    return form.Flow(
        used="fitted" if fitted else "predicted",
        p=global_test(joint.residual[mask], joint.covariance.restricted(mask)).p,
        rmse_before_px=rms(joint.base),
        rmse_after_px=None if after is None else rms(after),
    )


def flow_table(joint: Problem, after: np.ndarray | None) -> pd.DataFrame | None:
    """Return the rows of flow.csv, after (R, 3) by `after_of`: one per indentation with images and region that shows the
    gel.

    None without images.
    """
    if joint.flow is None:
        return None
    observations, R = joint.observations, len(joint.flow.forces.base)
    shown = np.isfinite(observations.force[R:, 0])
    rows = observations.table.iloc[R:].loc[shown, ["session", "press", "x_mm", "y_mm", "depth_mm"]]
    middles = np.concatenate([region_middles(press.eye) for press in joint.flow.model.seen])
    table = rows.assign(middle_u_px=middles[shown, 0], middle_v_px=middles[shown, 1])
    nothing = np.full_like(joint.base, np.nan)
    flows = {"measured": observations.force, "base": joint.base, "after": nothing if after is None else after}
    for name, values in flows.items():
        table[f"{name}_u_px"], table[f"{name}_v_px"] = values[R:][shown, 0], values[R:][shown, 1]
    sigma = joint.covariance.standard_deviation[joint.flow.entries :].reshape(-1, 2)
    return table.assign(sigma_u_px=sigma[:, 0], sigma_v_px=sigma[:, 1]).reset_index(drop=True)
