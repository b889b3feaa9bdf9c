"""How far the base studies of the proof on concealed effects are from FElupe's presses of the same sensor.

usage: python -m validation.checks.between_codes [--kept results/concealed/sets/kept]

Needs the solutions of `python -m validation solve`. Solves twelve presses on the studies' own mesh, some six
minutes each; those that a set was judged with are taken from --kept. Prints per base and place the ratio FElupe /
gelforge of Fz over depth, and the largest difference of all.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from gelforge.config import load_study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.mismatch.fem.solutions import fine
from gelforge.mismatch.pipeline.stage import solver_of
from validation.draw import BASES, base_world
from validation.library import load_libraries
from validation.sets import CONFIG


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kept", type=Path, default=Path("results/concealed/sets/kept"))
    parser.add_argument("--bases", nargs="+", default=list(BASES))
    asked = parser.parse_args()
    kept = asked.kept
    libraries = load_libraries({BASES[base].sensor for base in asked.bases})
    print("FElupe / gelforge of Fz at the depths of each plan")
    for base in asked.bases:
        library = libraries[BASES[base].sensor]
        sensor, depths = library.sensor, library.sensor.plan.depths
        solver = solver_of(load_study(CONFIG / f"{base}.yaml"), kept, [], kept, 1, [])
        world, largest = base_world(library, base), 0.0
        for x, y in sensor.orbits:
            own = fine((solver, PlannedCell("", *(sensor.middle + (x, y)).tolist(), depths)))
            ratio = world.elastic(np.tile([x, y], (len(depths), 1)), np.array(depths))[:, 2] / own[:, 2]
            largest = max(largest, float(np.abs(ratio - 1).max()))
            print(f"{base:12} ({x:g}, {y:g}) mm: {' '.join(f'{r:.4f}' for r in ratio)}", flush=True)
        print(f"{base:12} largest difference {largest:.2%}")


if __name__ == "__main__":
    main()
