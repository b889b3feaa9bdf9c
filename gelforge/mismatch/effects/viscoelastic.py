"""The soft layers relax: overstresses that fade with one relaxation time, next to the law, which holds at rest."""

from collections.abc import Sequence

import numpy as np

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers, skin_layer, with_keys
from gelforge.mismatch.model.effect import Context, Hyperparameters
from gelforge.mismatch.model.solver_effects import has_none_of, solved

STIFFNESS = {"gel": "gel_stiffness", "skin": "skin_stiffness"}


def grid(context: Context) -> list[Hyperparameters]:
    """Return relaxation times on a log grid, of the layers under the skin and of the skin.

    What relaxes within 0.1 s has done so when an indentation arrives (judgement); ten times the longest one acts as a
    stiffness.
    """
    shortest = 0.1
    longest = 10.0 * max(float(context.observations.table["press_time_s"].max()), shortest)
    times = np.geomspace(shortest, longest, int(np.ceil(2 * np.log10(longest / shortest))) + 1)
    parts = ["gel", "skin"] if len(context.study.sensor.layers) > 1 else ["gel"]
    return [{"part": part, "time_s": float(f"{t:.3g}")} for part in parts for t in times]


def to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
    """Return the study with overstresses of one branch."""
    (a,) = theta
    if a == 0:
        return study
    names = gel_layers(study) if hyperparameters["part"] == "gel" else [skin_layer(study)]
    branch = {"relative_moduli": [float(a)], "times_s": [hyperparameters["time_s"]]}
    return with_keys(study, history={"viscoelastic": {name: branch for name in names}})


def to_forces(
    context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
) -> np.ndarray:
    """Return the forces with overstresses to first order: the hereditary integral of what stiffness would add."""
    (a,) = theta
    return force + a * overstress(
        context, STIFFNESS[str(hyperparameters["part"])], float(hyperparameters["time_s"])
    )


def overstress(context: Context, stiffness: str, tau: float, steps: int = 6) -> np.ndarray:
    r"""Return the force (R, 3) [N] per relative modulus: h(t) = int exp(-(t - s) / tau) dD(s), from touch on.

    D is the derivative of the force to a stiffness of the layers at the depth of the time s; between readings depth is
    linear in time, and D within each of `steps` parts. Simo 1987 (doi 10.1016/0045-7825(87)90107-1), in forces.
    """
    table = context.observations.table
    time, depth = table["press_time_s"].to_numpy(float), table["depth_mm"].to_numpy(float)
    site, h = table["site"].to_numpy(), np.zeros((len(table), 3))
    for rows in table.groupby("press", sort=False).indices.values():
        t = np.maximum.accumulate(np.concatenate([[0.0], time[rows]]))
        fine = np.interp(np.arange(steps * len(rows) + 1) / steps, np.arange(len(t)), t)
        d = np.interp(np.arange(steps * len(rows) + 1) / steps, np.arange(len(t)), np.r_[0.0, depth[rows]])
        D = context.derivatives[stiffness].at(site[rows[0]], d)
        x = np.diff(fine) / tau
        # of an even rise, at its end
        kept = np.where(x > 1e-9, -np.expm1(-x) / np.where(x > 1e-9, x, 1.0), 1.0)
        end = t[1:, None] - fine[None, 1:]  # (rows, parts) since the end of each part
        fading = np.where(end >= 0, np.exp(-np.maximum(end, 0) / tau), 0.0)
        # Parts of no duration lie at the same time as the reading before them too; they belong to those after.
        fading *= np.arange(len(d) - 1)[None, :] < steps * np.arange(1, len(t))[:, None]
        h[rows] = fading @ (kept[:, None] * np.diff(D, axis=0))
    return h


EFFECT = solved(
    "viscoelastic",
    "relative_modulus",
    (0.0, 3.0),
    "width: soft silicones lose 5 to 30 % of their stress within minutes (judgement); bounds: a modulus; more than"
    " three times that at rest is no silicone gel",
    means=("the material relaxes under load",),
    signature="harder when fast, falling during a dwell, lower during unloading than during loading at the same depth",
    separated_by="a long dwell at one depth, and the same indentation at speeds ten times apart",
    depends_on=("gel_stiffness", "skin_stiffness"),
    to_study=to_study,
    to_forces=to_forces,
    grid=grid,
    applies=lambda study: has_none_of("history.viscoelastic")(study) and study.mechanics.strain == "finite",
)
