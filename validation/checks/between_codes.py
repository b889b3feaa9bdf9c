"""How far the base studies of the proof on concealed effects are from FElupe's presses of the same sensor.

usage: python -m validation.checks.between_codes [--kept results/concealed/sets/kept] [--sizes 0.3 0.6]

Needs the solutions of `python -m validation solve`. Solves twelve presses on the studies' own mesh, some six
minutes each; those that a set was judged with are taken from --kept. --sizes: near and far [mm] of another mesh.
Prints per base and place the ratio FElupe / gelforge of Fz over depth, off the middle that of Fx too, and the largest
difference of Fz.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from gelforge.config import load_study, study_from
from gelforge.config.basis.variants import merged
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
    parser.add_argument("--sizes", nargs=2, type=float, metavar=("NEAR", "FAR"))
    asked = parser.parse_args()
    kept = asked.kept
    libraries = load_libraries({BASES[base].sensor for base in asked.bases})
    print("FElupe / gelforge at the depths of each plan")
    for base in asked.bases:
        library = libraries[BASES[base].sensor]
        sensor, depths = library.sensor, library.sensor.plan.depths
        study = load_study(CONFIG / f"{base}.yaml")
        if asked.sizes:
            mesh = {"mesh": dict(zip(("near_mm", "far_mm"), asked.sizes))}
            study = study_from(merged(study.model_dump(mode="json"), {"mechanics": mesh}))
        solver = solver_of(study, kept, [], kept, 1, [])
        world, largest = base_world(library, base), 0.0
        for x, y in sensor.orbits:
            own = fine((solver, PlannedCell("", *(sensor.middle + (x, y)).tolist(), depths)))
            other = world.elastic(np.tile([x, y], (len(depths), 1)), np.array(depths))
            for axis in "xz" if x else "z":
                ratio = other[:, "xyz".index(axis)] / own[:, "xyz".index(axis)]
                print(
                    f"{base:12} ({x:g}, {y:g}) mm, F{axis}: {' '.join(f'{r:.4f}' for r in ratio)}", flush=True
                )
            largest = max(largest, float(np.abs(ratio - 1).max()))
        print(f"{base:12} largest difference {largest:.2%}")


if __name__ == "__main__":
    main()
