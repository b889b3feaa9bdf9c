"""What a verdict says of the images: verdict.json's section and flow.csv."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.mismatch.goodness.scan import global_test
from gelforge.mismatch.images.flow_images import region_middles
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.terms.problem import Problem


def after_of(joint: Problem, judgement: Judgement) -> np.ndarray | None:
    """Return forces and flow (R, 3) of all readings with the answer's effects; None without images or an answer."""
    if joint.flow is None or judgement.answer is None:
        return None
    fit = judgement.answer.fit
    parts = [joint.at_its_place(part) for part in fit.parts]
    return joint.forces_with(parts, fit.amounts, np.ones(len(joint.base), bool))


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
    found = {"measured": observations.force, "base": joint.base, "after": nothing if after is None else after}
    for name, values in found.items():
        table[f"{name}_u_px"], table[f"{name}_v_px"] = values[R:][shown, 0], values[R:][shown, 1]
    sigma = joint.covariance.standard_deviation[joint.flow.entries :].reshape(-1, 2)
    return table.assign(sigma_u_px=sigma[:, 0], sigma_v_px=sigma[:, 1]).reset_index(drop=True)
