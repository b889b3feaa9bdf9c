"""How far labels are from a finer mesh, and whether their error bars say so: three sensors, two indenters, drawn places.

usage: python benchmarks/error_bars.py [--places 20] [--seed 7102] [--cases NAME ...] [--solve | --calibration]

The reference is a mesh of half the sizes (near, far and walls) with the same steps of the indenter. Places are drawn by the
seed; those of --calibration are the ones on which the parts in gelforge/indentation/solving/error_bars.py were found.
Solutions are kept in results/error_bars and are read again: remove them after a change of the solver. --solve: solve what is
missing and print nothing. A place takes one to two CPU minutes on one thread, most of it the reference.

Printed per case: the root mean square of the error of Fz and of its bar, how often 95 % intervals hold, and 95 % intervals of
these shares over places (bootstrap of whole places).
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np
import pandas as pd
from sensors import ARTICLE, GELSIGHT

from gelforge.config import Study, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import solve_companion
from gelforge.indentation.solving.error_bars import error_bars
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of

KEPT = Path("results/error_bars")
CALIBRATION_SEED = 2026
WITHIN = 1.96  # standard deviations of a 95 % interval
MARGIN = 5.0  # mm from a sensor's edges to the places
STIFF_GEL = {"mu_kPa": [565.2, 21.95], "alpha": [1.2769, 3.5676]}  # 0.4 MPa, 71 times the article's
NU_049 = 2 * (1 + 0.49) / (3 * (1 - 2 * 0.49))  # K/mu
STIFF = merged(
    ARTICLE,
    {
        "materials": {"ecoflex_gel": {"parameters": STIFF_GEL}},
        "mechanics": {"friction": 0.8, "bulk_to_shear": NU_049},
    },
)
PUNCH = {"kind": "cylinder", "radius_mm": 3.0, "edge_radius_mm": 0.8}


@dataclass(frozen=True)
class Case:
    """A sensor with an indenter, and the depths [mm] to which it is pressed."""

    study: dict
    deepest_mm: float
    indenter: dict | None = None

    @property
    def depths(self) -> tuple[float, ...]:
        """Eight depths, evenly."""
        return tuple(round(self.deepest_mm * (k + 1) / 8, 6) for k in range(8))

    def described(self) -> Study:
        """Return the study."""
        study = {
            key: value for key, value in self.study.items() if self.indenter is None or key != "indenter"
        }
        plan = {"grid": {"spacing_mm": 5.0, "margin_mm": MARGIN}, "depths_mm": list(self.depths)}
        return study_from(study | {"plan": plan} | ({"indenter": self.indenter} if self.indenter else {}))


CASES = {
    "article, ball": Case(ARTICLE, 2.0),
    "article, punch": Case(ARTICLE, 1.2, PUNCH),
    "stiff, friction 0.8, nu 0.49, ball": Case(STIFF, 2.0),
    "stiff, friction 0.8, nu 0.49, punch": Case(STIFF, 1.2, PUNCH),
    "GelSight-like, ball": Case(GELSIGHT, 1.0),
    "GelSight-like, punch": Case(GELSIGHT, 0.8, PUNCH),
}


def places(study: Study, count: int, seed: int) -> np.ndarray:
    """Return places (count, 2) [mm], drawn evenly over the sensor but for its margin."""
    size = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm])
    return np.round(MARGIN + np.random.default_rng(seed).random((count, 2)) * (size - 2 * MARGIN), 2)


def solved(name: str, case: Case, x: float, y: float) -> dict[str, np.ndarray] | None:
    """Return forces of the label, of its coarse-mesh solution and of the reference at a place; None where one failed."""
    path = KEPT / f"{name}_{x:g}_{y:g}.npz".replace(", ", "-").replace(" ", "_")
    if not path.is_file():
        study = case.described()
        laws, planned = laws_of(study, []), PlannedCell("place", x, y, case.depths)
        label, reference = (
            simulate_cell(study, laws, planned),
            simulate_cell(of_half_size(study), laws, planned),
        )
        companion, reason, _ = solve_companion(study, laws, planned, {})
        for failed in filter(None, (label.attributes["reason"], reference.attributes["reason"], reason)):
            print(f"{name} at ({x:g}, {y:g}) mm: {failed}", flush=True)
            return None
        KEPT.mkdir(parents=True, exist_ok=True)
        np.savez(
            path,
            total=label.arrays["total_force_N"],
            bins=label.arrays["bin_force_N"],
            touched=(label.arrays["node_state"] > 0).sum(axis=1),
            true_total=reference.arrays["total_force_N"],
            true_bins=reference.arrays["bin_force_N"],
            coarse_total=companion.total,
            coarse_bins=companion.bins,
            seconds=[c.attributes["cpu_seconds"] for c in (label, reference)],
        )
    with np.load(path) as kept:
        return dict(kept)


def of_half_size(study: Study) -> Study:
    """Return a study on half the sizes, with steps as long as before."""
    mechanics = study.mechanics
    solver = mechanics.solver.model_copy(update={"longest_step": 2 * mechanics.solver.longest_step})
    mechanics = mechanics.model_copy(update={"mesh": mechanics.mesh.coarser(1 / 2), "solver": solver})
    return study.model_copy(update={"mechanics": mechanics})
