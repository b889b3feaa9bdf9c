"""How far the default mesh is from converged: near size, growth, far size and the wall refined separately and together.

Prints Fz [N] per depth, Fx at the deepest, and the difference to the finest mesh of the list.

usage: python benchmarks/convergence.py [--place centre|edge|corner] [--quick]      (one thread; minutes)
       python benchmarks/convergence.py --meshes 0.3,0.25,1.2 0.15,0.125,0.6 [--depths 0.5 1 1.5 2]

Meshes of one's own are near size, growth, far size and, if wanted, sizes through the wall and the radius of the fine region.
"""

from __future__ import annotations

import argparse

import numpy as np
import pandas as pd

from gelforge.api.studies import paper_study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of

DEPTHS = tuple(0.25 * (k + 1) for k in range(8))
PLACES = {"centre": (16.0, 16.0), "edge": (27.0, 16.0), "corner": (27.0, 27.0)}
SIZES = ("near_mm", "growth", "far_mm", "wall_parts", "near_radius_mm")
# (near [mm], growth [-], far [mm], sizes through the wall [-]); the default is the first row, the last the reference
MESHES = [
    (0.3, 0.25, 1.2, 2),
    (0.6, 0.25, 1.2, 2),
    (0.15, 0.25, 1.2, 2),
    (0.3, 0.25, 2.4, 2),
    (0.3, 0.25, 0.6, 2),
    (0.3, 0.5, 1.2, 2),
    (0.3, 0.12, 1.2, 2),
    (0.3, 0.25, 1.2, 1),
    (0.3, 0.25, 1.2, 4),
    (0.6, 0.25, 2.4, 1),
    (0.2, 0.25, 0.8, 3),
    (0.15, 0.25, 0.6, 4),
]
QUICK = [(0.3, 0.25, 1.2), (0.6, 0.25, 1.2), (0.6, 0.25, 2.4), (0.4, 0.25, 0.8)]


def forces(place: str, mesh: tuple[float, ...], depths: tuple[float, ...]) -> tuple[np.ndarray, dict]:
    """Return Fx at the deepest and -Fz (1 + D,) [N] of a cell, and its attributes; mesh: SIZES, the last may be missing."""
    study = paper_study()
    laws = laws_of(study, [])
    sizes = dict(zip(SIZES, mesh))
    mechanics = study.mechanics.model_copy(update={"mesh": study.mechanics.mesh.model_copy(update=sizes)})
    cell = simulate_cell(
        study.model_copy(update={"mechanics": mechanics}), laws, PlannedCell(place, *PLACES[place], depths)
    )
    force = cell.arrays["total_force_N"]
    return np.append(force[-1, 0], -force[:, 2]), cell.attributes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--place", choices=PLACES, default="centre")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument(
        "--meshes", nargs="+", type=lambda text: tuple(map(float, text.split(","))), metavar="N,G,F[,W[,R]]"
    )
    parser.add_argument("--depths", nargs="+", type=float, default=DEPTHS, help="mm")
    arguments = parser.parse_args()
    rows, curves, depths = [], [], tuple(arguments.depths)
    names = [f"Fx, {depths[-1]:g} mm", *(f"{d:g} mm" for d in depths)]
    for mesh in arguments.meshes or (QUICK if arguments.quick else MESHES):
        curve, attributes = forces(arguments.place, mesh, depths)
        curves.append(curve)
        sizes = {
            **dict(zip(("near", "growth", "far", "wall", "radius"), mesh)),
            "unknowns": int(attributes["degrees_of_freedom"]),
        }
        rows.append(
            sizes | {name: f"{f:.4f}" for name, f in zip(names, curve)} | {"s": round(attributes["seconds"])}
        )
        print(pd.DataFrame(rows[-1:]).to_markdown(index=False), flush=True)
    finest = curves[-1]
    print(f"\nFx and Fz [N] at the {arguments.place}; difference to the finest mesh in per cent:\n")
    for row, curve in zip(rows, curves):
        with np.errstate(divide="ignore", invalid="ignore"):  # Fx in the middle is nothing
            difference = 100 * (curve / finest - 1)
        row.update({name: f"{f:.4f} ({e:+.1f})" for name, f, e in zip(names, curve, difference)})
    print(pd.DataFrame(rows).to_markdown(index=False))


if __name__ == "__main__":
    main()
