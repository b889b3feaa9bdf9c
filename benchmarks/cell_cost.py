"""Cost of one cell at several mesh sizes: unknowns, seconds, iterations, memory. Each size runs in a process of its own.

usage: python benchmarks/cell_cost.py [--near 0.5 0.3] [--repeat 1]      (one thread; prints a Markdown table)
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys

THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


def one_cell(x: float, y: float, near: float) -> dict:
    from gelforge.cli.bench import laws_of, paper_study
    from gelforge.indentation.plan import PlannedCell
    from gelforge.indentation.simulate import simulate_cell

    study = paper_study()
    laws = laws_of(study, [])
    warm = study.mechanics.model_copy(
        update={"mesh": study.mechanics.mesh.model_copy(update={"near_mm": 3.0})}
    )
    simulate_cell(
        study.model_copy(update={"mechanics": warm}), laws, PlannedCell("warm", x, y, (0.1,))
    )  # loads kernels
    mesh = study.mechanics.mesh.model_copy(update={"near_mm": near})
    study = study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"mesh": mesh})})
    depths = tuple(0.25 * (k + 1) for k in range(8))
    cell = simulate_cell(study, laws, PlannedCell("bench", x, y, depths))
    a = cell.attributes
    return {
        "position": f"({x:g}, {y:g})",
        "near [mm]": near,
        "unknowns": int(a["degrees_of_freedom"]),
        "wall [s]": round(a["seconds"], 1),
        "CPU [s]": round(a["cpu_seconds"], 1),
        "iterations": int(sum(a["iterations"])),
        "factorisations": int(sum(a["factorisations"])),
        "worst balance": f"{max(a['force_balance']):.0e}",
        "peak [MiB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "status": a["status"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--near", type=float, nargs="+", default=[0.5, 0.3])
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--one", nargs=3, type=float, metavar=("X", "Y", "NEAR"))
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(one_cell(*arguments.one)))
        return
    import pandas as pd

    rows = []
    for near in arguments.near:
        for x, y in ((16.0, 16.0), (27.0, 27.0)):
            for _ in range(arguments.repeat):
                command = [sys.executable, __file__, "--one", str(x), str(y), str(near)]
                done = subprocess.run(
                    command, env=os.environ | THREADS, capture_output=True, text=True, check=True
                )
                rows.append(json.loads(done.stdout.splitlines()[-1]))
    print(pd.DataFrame(rows).to_markdown(index=False))


if __name__ == "__main__":
    main()
