"""Cost of one cell at several mesh sizes: unknowns, seconds, iterations, memory. Each size runs in a process of its own.

The far size is four times the near one.

usage: python benchmarks/cell_cost.py [--near 0.5 0.3 0.2 0.15] [--repeat 1] [--update]

One thread; prints a Markdown table.

--update writes the CPU seconds to gelforge/cli/study/cell_cost.csv, from which `gelforge check` estimates a study's minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory

THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


def one_cell(x: float, y: float, near: float) -> dict:
    from gelforge.api.studies import paper_study
    from gelforge.indentation.paths.planned_cell import PlannedCell
    from gelforge.indentation.solving.companion import simulate_label
    from gelforge.laws_of_study import laws_of

    study = paper_study()
    laws = laws_of(study, [])
    warm = study.mechanics.model_copy(
        update={"mesh": study.mechanics.mesh.model_copy(update={"near_mm": 3.0})}
    )
    simulate_label(
        study.model_copy(update={"mechanics": warm}), laws, {}, PlannedCell("warm", x, y, (0.1,))
    )  # loads kernels
    mesh = study.mechanics.mesh.model_copy(update={"near_mm": near, "far_mm": 4 * near})
    study = study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"mesh": mesh})})
    depths = tuple(0.25 * (k + 1) for k in range(8))
    cell = simulate_label(study, laws, {}, PlannedCell("bench", x, y, depths))
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


def mirrored_cell_seconds() -> float:
    """Return the CPU seconds of a mirrored cell where many are made: the source is read, the image made and written."""
    from gelforge.api.studies import paper_study
    from gelforge.indentation.cells.cell_file import read_cell, write_cell
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.companion import simulate_label
    from gelforge.indentation.solving.mirror import mirror_cell
    from gelforge.laws_of_study import laws_of

    study = paper_study()
    laws = laws_of(study, [])
    planned = plan_cells(study)
    image = next(cell for cell in planned.values() if cell.source)
    images = [cell for cell in planned.values() if cell.source == image.source]
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_cell(folder / "source.h5", simulate_label(study, laws, {}, planned[image.source]))
        before = time.process_time()
        for cell in images:
            source = read_cell(folder / "source.h5")
            write_cell(folder / f"{cell.name}.h5", mirror_cell(source, study, laws, cell))
    return (time.process_time() - before) / len(images)


def run(command: list[str]) -> str:
    """Return what a command prints; it has one thread."""
    done = subprocess.run(command, env=os.environ | THREADS, capture_output=True, text=True, check=True)
    return done.stdout


def machine() -> str:
    """Return the processor and the date, in words."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {date.today():%Y-%m}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--near", type=float, nargs="+", default=[0.5, 0.3, 0.2, 0.15])
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--update", action="store_true")
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
                rows.append(json.loads(run(command).splitlines()[-1]))
    print(pd.DataFrame(rows).to_markdown(index=False))
    if arguments.update:
        from gelforge.cli.study.cost import DEPTHS, MEASURED
        from gelforge.files import write_text

        measured = [("solved", row["unknowns"], row["CPU [s]"]) for row in rows]
        lines = [
            f"# CPU seconds of a cell with {DEPTHS} depths on one thread, by `python benchmarks/cell_cost.py --update`",
            f"# {machine()}",
            "kind,degrees_of_freedom,cpu_s",
            *(f"{kind},{size},{seconds:.2f}" for kind, size, seconds in measured),
            f"mirrored,0,{mirrored_cell_seconds():.2f}",
        ]
        write_text(MEASURED, "\n".join(lines) + "\n")
        print(f"written to {MEASURED}")


if __name__ == "__main__":
    main()
