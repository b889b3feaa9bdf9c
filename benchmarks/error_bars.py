"""How far labels are from a finer mesh, and whether their error bars say so: four sensors, two indenters, drawn places.

usage: python benchmarks/error_bars.py [--places 20] [--seed 7102] [--corner] [--cases NAME ...] [--solve | --calibration]

The reference is a mesh of half the sizes (near, far and walls) with the same steps of the indenter. Places are drawn by the
seed; those of --calibration are the ones on which the parts in gelforge/indentation/solving/error_bars.py were found.
--corner: one place more, 5 mm from two sides, where the walls stiffen the gel most.
Solutions are kept in results/error_bars and are read again: remove them after a change of the solver. --solve: solve what is
missing and print nothing. A place takes one to two CPU minutes on one thread, most of it the reference.

Printed per case and of all: the root mean square of the error of Fz and of its bar, how often 95 % intervals hold, and 95 %
intervals of these shares over places (bootstrap of whole places).
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from itertools import chain
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
from gelforge.indentation.solving.error_bars import Companion, error_bars
from gelforge.indentation.solving.resolution import resolution_of
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of
from gelforge.progress import Progress, show

KEPT = Path("results/error_bars")
CALIBRATION_SEED = 2026
FEWEST = 5  # places for an interval over places
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
THIN = merged(
    GELSIGHT, {"materials": {"gel": {"parameters": {"mu_kPa": [145.0]}}}, "indenter": {"radius_mm": 7.5}}
)
THIN["sensor"] = GELSIGHT["sensor"] | {"layers": [{"name": "gel", "thickness_mm": 2.5, "material": "gel"}]}
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
    "thin, ball": Case(THIN, 0.8),
}


def places(study: Study, count: int, seed: int, corner: bool = False) -> np.ndarray:
    """Return places (count, 2) [mm], drawn evenly over the sensor but for its margin, and the margin's corner if asked."""
    size = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm])
    drawn = np.round(MARGIN + np.random.default_rng(seed).random((count, 2)) * (size - 2 * MARGIN), 2)
    return np.vstack([drawn, [[MARGIN, MARGIN]]]) if corner else drawn


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


def at_places(name: str, chosen: np.ndarray) -> list[dict[str, np.ndarray]]:
    """Return errors and bars of totals (D, 3) and of loaded bins (n, 3), place by place, with today's parts."""
    case, study = CASES[name], CASES[name].described()
    bins, laws = study.sensor.bins, laws_of(study, [])
    found = []
    for x, y in chosen:
        forces = solved(name, case, float(x), float(y))
        if forces is None:
            continue
        no_slopes = np.empty((0, *forces["coarse_total"].shape)), np.empty((0, *forces["coarse_bins"].shape))
        companion = Companion(forces["coarse_total"], forces["coarse_bins"], *no_slopes)
        shape = bins.ny, bins.nx
        resolution = resolution_of(study.sensor, study.mechanics.mesh, laws, float(x), float(y))
        bars = error_bars(forces["total"], forces["bins"], forces["touched"], shape, companion, resolution)
        loaded = np.maximum(np.abs(forces["bins"]), np.abs(forces["true_bins"])).max(axis=-1) > 0
        found.append(
            {
                "size": np.abs(forces["true_total"][:, 2]),
                "total": forces["total"] - forces["true_total"],
                "total bar": bars["total_sigma_mesh_N"],
                "bins": (forces["bins"] - forces["true_bins"])[loaded],
                "bins bar": bars["bin_sigma_mesh_N"][loaded],
            }
        )
    return found


def row(name: str, found: list[dict[str, np.ndarray]]) -> dict[str, str]:
    """Return the row of a case: errors of Fz and bars [%], and shares of intervals that hold."""
    error = np.array([100 * one["total"][:, 2] / one["size"] for one in found])
    bar = np.array([100 * one["total bar"][:, 2] / one["size"] for one in found])

    def holds(what: str, axes: list[int]) -> str:
        inside = [(np.abs(one[what]) <= WITHIN * one[f"{what} bar"])[..., axes] for one in found]
        return share_over_places([(i.sum(), i.size) for i in inside])

    return {
        "case": name,
        "places": str(len(found)),
        "Fz, rms error [%]": f"{rms(error):.2f}",
        "rms sigma [%]": f"{rms(bar):.2f}",
        "ratio": f"{rms(bar) / rms(error):.1f}",
        "Fz holds [%]": holds("total", [2]),
        "Fx, Fy hold [%]": holds("total", [0, 1]),
        "bins z hold [%]": holds("bins", [2]),
        "bins x, y hold [%]": holds("bins", [0, 1]),
    }


def rms(values: np.ndarray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def share_over_places(counts: list[tuple[int, int]]) -> str:
    """Return a share in per cent with its 95 % interval by drawing whole places; counts: (inside, all) of each."""
    inside, every = np.array(counts, dtype=float).T
    if len(counts) < FEWEST:
        return f"{100 * inside.sum() / every.sum():.0f}"
    drawn = np.random.default_rng(1).integers(len(counts), size=(2000, len(counts)))
    low, high = np.quantile(inside[drawn].sum(axis=1) / every[drawn].sum(axis=1), [0.025, 0.975])
    return f"{100 * inside.sum() / every.sum():.0f} ({100 * low:.0f} to {100 * high:.0f})"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--places", type=int, default=20, help="of each case")
    parser.add_argument("--seed", type=int, default=7102)
    parser.add_argument("--corner", action="store_true", help="a place in a corner too")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES), metavar="NAME")
    parser.add_argument("--calibration", action="store_true", help="the places on which the parts were found")
    parser.add_argument("--solve", action="store_true", help="solve what is missing, print no table")
    options = parser.parse_args()
    seed = CALIBRATION_SEED if options.calibration else options.seed
    chosen = {
        name: places(CASES[name].described(), options.places, seed, options.corner) for name in options.cases
    }
    show()
    with Progress("places", sum(map(len, chosen.values()))) as progress:
        for k in range(options.places + options.corner):
            for name in options.cases:
                solved(name, CASES[name], *map(float, chosen[name][k]))
                progress.advance(note=name)
    if not options.solve:
        found = {name: at_places(name, chosen[name]) for name in options.cases}
        rows = [row(name, found[name]) for name in found] + [row("all", list(chain(*found.values())))]
        print(pd.DataFrame(rows).to_markdown(index=False, disable_numparse=True))


if __name__ == "__main__":
    main()
