"""The soft layers lose stiffness where they have been strained more before."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import erf

from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.indentation.sensitivities import unmirrored
from gelforge.mismatch.context import Context
from gelforge.mismatch.effect import Effect, Shape
from gelforge.mismatch.solver_effects import amount, has_none_of, solver

KNOTS = 65  # of the work over depth
SPREAD = 0.5  # of the height: how far strain reaches beyond the contact


def to_forces(context: Context, shape: Shape, force: np.ndarray, amounts: Sequence[float]) -> np.ndarray:
    """Return the forces of softened layers to first order: the gel's stiffness times 1 - amount x `lost_share`."""
    (a,) = amounts
    return force - a * lost_share(context)[:, None] * context.derivative("gel_stiffness")


def lost_share(context: Context) -> np.ndarray:
    """Return erf((peak - W) / (m + beta peak)) (R,) of each reading, Ogden & Roxburgh 1999 (doi 10.1098/rspa.1999.0431).

    One energy density W stands for all of a press: its work over a cylinder of all layers, SPREAD heights wider than the
    contact. The peak is the largest that earlier presses left at the place, falling as a Gaussian over that radius, or this
    press so far.
    """
    table, sites = context.observations.table, context.observations.sites
    depth, site = table["depth_mm"].to_numpy(float), table["site"].to_numpy()
    height = context.study.sensor.height_mm
    radius = min(part.radius_mm for part in context.study.indenter.shapes)
    softening = CATALOGUE["mullins"](unmirrored(context.study), 0.5).mechanics.effects.history.mullins
    m, beta = next((s.m_kPa, s.beta) for s in softening.values())
    grid = np.linspace(0.0, max(depth.max(), table["deepest_mm"].max()), KNOTS)
    contact = np.sqrt(np.clip(2 * radius * grid - grid**2, (0.1 * radius) ** 2, radius**2))  # mm
    pushing = [-context.curves.at(s, grid)[:, 2] for s in range(len(sites))]
    reach = contact + SPREAD * height
    work = [np.r_[0.0, np.cumsum((f[1:] + f[:-1]) / 2 * np.diff(grid))] for f in pushing]  # mJ
    density = [w / (np.pi * reach**2 * height * 1e-3) for w in work]  # kPa
    apart = np.linalg.norm(sites[:, None] - sites[None], axis=-1)
    W, peak = np.zeros(len(table)), np.zeros(len(table))
    left = np.zeros(len(sites))
    for rows in table.groupby("press", sort=False).indices.values():
        s = site[rows[0]]
        W[rows] = np.interp(depth[rows], grid, density[s])
        peak[rows] = np.maximum(left[s], np.maximum.accumulate(W[rows]))
        deepest = float(table["deepest_mm"].iloc[rows[0]])
        felt = np.exp(-((apart[s] / np.interp(deepest, grid, reach)) ** 2))
        left = np.maximum(left, np.interp(deepest, grid, density[s]) * felt)
    return erf((peak - W) / (m + beta * peak))


EFFECT = Effect(
    name="mullins",
    family="history",
    parameters=(
        amount(
            "mullins", "largest_loss", (0.0, 0.95),
            "width: unfilled silicones lose little, filled rubbers up to half of their stress at the second loading"
            " (judgement); bounds: a share of the stress", sign=1,
        ),
    ),
    signature="softer where deeper presses have been before, neighbours included, and on the way up; first presses clean",
    confused_with=("ageing", "viscoelastic", "force_drift", "adhesion", "force_hysteresis"),
    separated_by="random order, with a sentinel press at one place every ninth one, and first presses on a fresh sensor",
    takes=("gel_stiffness",),
    applies=lambda study: has_none_of("history.mullins")(study) and study.mechanics.strain == "finite",
    **solver("mullins", limit=(0.0, 0.95), directed=True) | {"to_forces": to_forces, "in_order": True},
)  # fmt: skip
