"""The paper's sensor on quadratic tetrahedra against hexahedra: forces at the centre and what they cost.

Sizes are distances between nodes for both. Differences are to a finer hexahedral mesh. Each mesh runs in a process of its
own. The mesher's seconds are part of a cell's.

usage: python benchmarks/tetrahedra.py [--near 0.5 0.3] [--reference 0.2]      (one thread; minutes)
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys

import numpy as np

DEPTHS = tuple(0.25 * (k + 1) for k in range(8))
CENTRE = (16.0, 16.0)
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


def one_cell(elements: str, near: float, far: float) -> dict:
    from gelforge.cli.bench import laws_of, paper_study
    from gelforge.indentation.plan import PlannedCell
    from gelforge.indentation.sensor_mesh import sensor_mesh
    from gelforge.indentation.simulate import simulate_cell

    study = paper_study()
    laws = laws_of(study, [])

    def with_mesh(**sizes):
        mesh = study.mechanics.mesh.model_copy(update={"elements": elements, **sizes})
        return study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"mesh": mesh})})

    coarse = with_mesh(near_mm=1.5, far_mm=3.0)
    simulate_cell(coarse, laws, PlannedCell("warm", *CENTRE, (0.3,)))  # loads kernels
    fine = with_mesh(near_mm=near, far_mm=far)
    mesh = sensor_mesh(fine.sensor, fine.mechanics.mesh, *CENTRE)
    cell = simulate_cell(fine, laws, PlannedCell("bench", *CENTRE, DEPTHS))
    a = cell.attributes
    return {
        "elements": elements,
        "near [mm]": near,
        "far [mm]": far,
        "number": len(mesh.elements),
        "unknowns": int(a["degrees_of_freedom"]),
        "CPU [s]": round(a["cpu_seconds"], 1),
        "wall [s]": round(a["seconds"], 1),
        "iterations": int(sum(a["iterations"])),
        "factorisations": int(sum(a["factorisations"])),
        "worst balance": f"{max(a['force_balance'], default=np.nan):.0e}",
        "peak [MiB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "status": a["status"],
        "force": [-float(force) for force in cell.arrays["total_force_N"][:, 2]],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--near", type=float, nargs="+", default=[0.5, 0.3])
    parser.add_argument("--reference", type=float, default=0.2, help="size of the finer hexahedral mesh [mm]")
    parser.add_argument("--one", nargs=3, metavar=("ELEMENTS", "NEAR", "FAR"))
    arguments = parser.parse_args()
    if arguments.one:
        elements, near, far = arguments.one
        print(json.dumps(one_cell(elements, float(near), float(far))))
        return
    import pandas as pd

    sizes = [("hexahedra", arguments.reference)]
    sizes += [(elements, near) for near in arguments.near for elements in ("hexahedra", "tetrahedra")]
    rows = []
    for elements, near in sizes:
        command = [sys.executable, __file__, "--one", elements, str(near), str(4 * near)]
        done = subprocess.run(command, env=os.environ | THREADS, capture_output=True, text=True, check=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    forces = [np.array(row.pop("force")) for row in rows]
    differences = [
        {"elements": row["elements"], "near [mm]": row["near [mm]"]}
        | {f"{d:g} mm": f"{f:.4f} ({100 * (f / r - 1):+.2f} %)" for d, f, r in zip(DEPTHS, force, forces[0])}
        for row, force in zip(rows, forces)
    ]
    print("Fz [N] and its difference to the first row:\n")
    print(pd.DataFrame(differences).to_markdown(index=False))
    print("\nCost:\n")
    print(pd.DataFrame(rows).to_markdown(index=False))


if __name__ == "__main__":
    main()
