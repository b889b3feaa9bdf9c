"""The soft layers lose stiffness where they have been strained more before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers, with_keys
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mechanics.laws import softening
from gelforge.mismatch.model.effect import Context, Hyperparameters
from gelforge.mismatch.model.solver_effects import has_none_of, solved

BETA = 0.1  # of the peak, added to m: how early a return loses stress (judgement)
LARGEST = 0.95  # share of the stress
WIDER = 0.1  # of the height: how far the energy reaches beyond the contact (validation/checks/softening_formula.py)


def grid(context: Context) -> list[Hyperparameters]:
    """Return the energy densities [kPa] that may scale the softening: shares of the largest one of these indentations."""
    deepest = context.observations.table.groupby("site")["deepest_mm"].max()
    energies = Energies(context)
    largest = max(float(energies.density(s, d, np.zeros(()))) for s, d in deepest.items())
    # a loss at the slightest return, and one in proportion
    return [{"m_kPa": float(f"{scale * largest:.2g}")} for scale in (0.1, 1.0)]


def to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
    """Return the study with soft layers that soften."""
    (a,) = theta
    if a == 0:
        return study
    softening = {"amount": float(np.clip(a, 0.0, LARGEST)), "m_kPa": hyperparameters["m_kPa"], "beta": BETA}
    return with_keys(unmirrored(study), history={"mullins": {name: softening for name in gel_layers(study)}})


def to_forces(
    context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
) -> np.ndarray:
    """Return the forces of softened layers to first order: the gel's stiffness times 1 - theta x `lost_share`."""
    (a,) = theta
    return force - a * lost_share(context, float(hyperparameters["m_kPa"]))[:, None] * context.derivative(
        "gel_stiffness"
    )


def lost_share(context: Context, m: float) -> np.ndarray:
    """Return erf((peak - W) / (m + beta peak)) (R,) at each reading, the mean over points about the indentation.

    Ogden & Roxburgh 1999 (doi 10.1098/rspa.1999.0431). m [kPa]. The points share the reading's energy evenly. Their peak is
    the largest that an earlier press left there, or this indentation so far.
    """
    lost = np.zeros(len(context.observations.table))
    for rows, W, peak in histories(context, Energies(context)):
        lost[rows] = softening.lost_share(W, peak, m, BETA).mean(axis=1)
    return lost


def histories(context: Context, energies: Energies) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield press by press the readings' numbers (r,), energy densities and largest so far (r, points) [kPa]."""
    table, sites = context.observations.table, context.observations.sites
    depth, site = table["depth_mm"].to_numpy(float).clip(0), table["site"].to_numpy()
    deepest = np.zeros(len(sites))  # before, at each site
    for rows in table.groupby("press", sort=False).indices.values():
        s, d = site[rows[0]], depth[rows][:, None]
        at = energies.reach_at(d)[..., None] * POINTS  # (rows, points, 2) from the indentation's axis
        r = np.linalg.norm(at, axis=-1)
        W, peak = energies.density(s, d, r), energies.density(s, np.maximum.accumulate(d), r)
        for other in np.flatnonzero(deepest):
            r = np.linalg.norm(at + sites[s] - sites[other], axis=-1)
            peak = np.maximum(peak, energies.density(int(other), deepest[other], r))
        yield rows, W, peak
        deepest[s] = max(deepest[s], float(table["deepest_mm"].iloc[rows[0]]))


class Energies:
    """Energy densities under presses: all of an indentation's work, even over the height, falling away from its axis.

    As (1 + (r / b)^2)^-2: far away as r^-4, as under a point force on a half-space (Boussinesq); b is the contact's radius
    and some heights.
    """

    def __init__(self, context: Context, wider: float = WIDER):
        table = context.observations.table
        self.height = context.study.sensor.height_mm
        R = min(part.radius_mm for part in context.study.indenter.shapes)
        self.depths = np.linspace(0.0, max(table["depth_mm"].max(), table["deepest_mm"].max()), 65)
        contact = np.sqrt(np.clip(2 * R * self.depths - self.depths**2, (0.1 * R) ** 2, R**2))
        self.reach = contact + wider * self.height  # mm
        pushing = [-context.curves.at(s, self.depths)[:, 2] for s in range(len(context.observations.sites))]
        self.work = cumulative_trapezoid(pushing, self.depths, initial=0.0)  # (sites, knots) [mJ]

    @property
    def largest(self) -> float:
        """Return the largest energy density [kPa] of all sites' curves."""
        return float(max(self.density(s, self.depths[-1], np.zeros(())) for s in range(len(self.work))))

    def reach_at(self, depth: np.ndarray) -> np.ndarray:
        """Return b [mm] at depths [mm]."""
        return np.interp(depth, self.depths, self.reach)

    def density(self, site: int, depth: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Return the energy density [kPa] at distances [mm] from the axis of an indentation at a site, at depths [mm]."""
        b = self.reach_at(depth)
        middle = np.interp(depth, self.depths, self.work[site]) / (np.pi * b**2 * self.height) * 1e3
        return middle / (1 + (r / b) ** 2) ** 2


def _points(rings: int = 6, spokes: int = 8) -> np.ndarray:
    """Return points (rings x spokes, 2) [b] about an indentation that share its energy evenly."""
    inside = (np.arange(rings) + 0.5) / rings  # share of the energy, (r / b)^2 / (1 + (r / b)^2)
    r, angle = np.sqrt(inside / (1 - inside)), 2 * np.pi * np.arange(spokes) / spokes
    return np.column_stack([np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()])


POINTS = _points()
EFFECT = solved(
    "mullins",
    "largest_loss",
    (0.0, LARGEST),
    "width: unfilled silicones lose little, filled rubbers up to half of their stress at the second loading"
    " (judgement); bounds: a share of the stress",
    means=("the material softens where it has been strained before",),
    signature="softer where deeper indentations have been before, neighbours included, and during unloading; first"
    " indentations clean",
    separated_by="random order, with a return to one site at every ninth indentation, and first indentations on a"
    " fresh sensor",
    depends_on=("gel_stiffness",),
    applies=lambda study: has_none_of("history.mullins")(study) and study.mechanics.strain == "finite",
    to_study=to_study,
    to_forces=to_forces,
    grid=grid,
    path_dependent=True,
)
