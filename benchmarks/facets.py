"""What making up for the mean gap of faces on a curved indenter wins: errors of Fz at first touch and deeper, by its share.

usage: python benchmarks/facets.py [--shares 0 0.5 0.75 1]      (one thread; some minutes)

A block of 24 x 24 x 12 mm (mu 42 kPa, no friction, no walls) is pressed off its middle by a ball, a flat cylinder, a
cylinder on its side and a box with rounded edges. Errors in per cent of a mesh of 0.08 mm under the contact, no share.
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np
import pandas as pd

from gelforge.config import study_from
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of

DEPTHS = (0.05, 0.1, 0.2, 0.4)
PLACE = (12.03, 11.9)
INDENTERS = {
    "ball, 4 mm": {"kind": "sphere", "radius_mm": 4.0},
    "flat cylinder, 2 mm, edge 0.3": {"kind": "cylinder", "radius_mm": 2.0, "edge_radius_mm": 0.3},
    "lying cylinder, 2 mm": {
        "kind": "cylinder", "radius_mm": 2.0, "length_mm": 4.0, "edge_radius_mm": 0.3, "orientation_deg": [90, 0, 0],
    },
    "box, 3 x 2 mm, edge 0.3": {"kind": "box", "size_mm": [3.0, 2.0, 4.0], "edge_radius_mm": 0.3},
}  # fmt: skip
MESHES = {"0.25": (0.25, 2.0, 0.2), "0.4": (0.4, 2.0, 0.2)}  # near, far [mm], growth
REFERENCE = (0.08, 1.2, 0.25)


def forces(indenter: dict, mesh: tuple[float, float, float], share: float) -> np.ndarray:
    """Return Fz (D,) [N] at DEPTHS."""
    near, far, growth = mesh
    study = study_from(
        {
            "study": "facets",
            "materials": {"gel": {"parameters": {"mu_kPa": [42.0], "alpha": [2.0]}}},
            "sensor": {
                "width_x_mm": 24.0,
                "width_y_mm": 24.0,
                "layers": [{"name": "gel", "thickness_mm": 12.0, "material": "gel"}],
                "wall_mm": 0.0,
                "bins": {"nx": 24, "ny": 24},
            },
            "indenter": indenter,
            "mechanics": {
                "friction": 0.0,
                "contact": {"facets": share},
                "mesh": {"near_mm": near, "near_radius_mm": 1.5, "growth": growth, "far_mm": far},
            },
            "plan": {"grid": {"spacing_mm": 4.0, "margin_mm": 6.0}, "depths_mm": list(DEPTHS)},
            "sessions": [],
        }
    )
    cell = simulate_cell(study, laws_of(study, []), PlannedCell("place", *PLACE, DEPTHS))
    if not cell.converged:
        raise SystemExit(f"{indenter['kind']}: {cell.attributes['reason']}")
    return cell.arrays["total_force_N"][:, 2]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shares", nargs="+", type=float, default=[0.0, 0.5, 0.75, 1.0])
    shares = parser.parse_args().shares
    rows = []
    for name, indenter in INDENTERS.items():
        reference = forces(indenter, REFERENCE, 0.0)
        for near, mesh in MESHES.items():
            for share in shares:
                error = 100 * (forces(indenter, mesh, share) / reference - 1)
                by_depth = {f"{depth:g} mm": f"{e:+.1f}" for depth, e in zip(DEPTHS, error)}
                rows.append({"indenter": name, "near [mm]": near, "share": f"{share:g}"} | by_depth)
                print(rows[-1], flush=True)
    print(pd.DataFrame(rows).to_markdown(index=False, disable_numparse=True))


if __name__ == "__main__":
    main()
