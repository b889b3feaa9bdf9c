"""Where one cell's time goes: CPU seconds by stage, of the press itself and of the companion that gives its error bars.

usage: python benchmarks/where_time_goes.py [--x 27 --y 27] [--repeat 3]

The paper's sensor, default mesh, 8 depths, one thread; prints a Markdown table of medians. Measured with cProfile on the
process's own clock, whose cost is small next to calls that take a millisecond and more.
"""

from __future__ import annotations

import argparse
import cProfile
import os
import pstats
import time

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import pandas as pd  # noqa: E402

from gelforge.api.studies import paper_study  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.indentation.solving.companion import solve_companion  # noqa: E402
from gelforge.indentation.solving.simulate import simulate_cell  # noqa: E402
from gelforge.laws_of_study import laws_of  # noqa: E402

DEPTHS = tuple(0.25 * (k + 1) for k in range(8))
# stage: (file, function, caller or None for all); none of them calls another one
STAGES = {
    "mesh and checks of the path": [("model.py", "meshes_of", None), ("model.py", "_path", None)],
    "body: gradients, pattern": [("model.py", "_body", None)],
    "order of elimination (symbolic)": [("sparse.py", "direct_solver", None)],
    "elements: forces, with and without tangent": [("body.py", "response", None)],
    "factorisation": [("sparse.py", "factor", None)],
    "back-substitution": [("sparse.py", "solve", None), ("sparse.py", "solve_many", None)],
    "distances and contact": [
        ("surface.py", "forces", None),
        ("surface.py", "corrected", None),
        ("forces.py", "add_node_blocks", None),
    ],
    "arrays of the file": [
        ("cell_arrays.py", "force_arrays", None),
        ("cell_arrays.py", "section_arrays", None),
        ("stretch_range.py", "element_stretches", None),
    ],
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--x", type=float, default=27.0)
    parser.add_argument("--y", type=float, default=27.0)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    study = paper_study()
    laws = laws_of(study, [])
    planned = PlannedCell("bench", options.x, options.y, DEPTHS)
    work = {
        "press": lambda: simulate_cell(study, laws, planned),
        "companion": lambda: solve_companion(study, laws, planned, {}),
    }
    work["companion"]()  # loads kernels
    columns = {}
    for part, run in work.items():
        seconds = pd.DataFrame([profiled(run) for _ in range(options.repeat)]).median()
        columns[f"{part} [s]"] = seconds.round(2)
        columns[f"{part} [%]"] = (100 * seconds / seconds["all"]).round(0).astype(int)
    print(f"({options.x:g}, {options.y:g}) mm, CPU seconds, medians of {options.repeat}\n")
    print(pd.DataFrame(columns).rename_axis("stage").to_markdown())


def profiled(run) -> dict[str, float]:
    """Return the CPU seconds of every stage, of all, and of what no stage holds."""
    profile = cProfile.Profile(time.process_time)
    profile.runcall(run)
    stats = pstats.Stats(profile).stats
    found = {stage: sum(cumulative(stats, *one) for one in parts) for stage, parts in STAGES.items()}
    everything = max(row[3] for row in stats.values())
    rest = everything - sum(found.values())
    return found | {"rest: line search, products, Python": rest, "all": everything}


def cumulative(stats: dict, file: str, function: str, caller: str | None) -> float:
    """Return the cumulative seconds of a function, of all its calls or of those from one caller."""
    seconds = 0.0
    for (path, _, name), (_, _, _, total, callers) in stats.items():
        if os.path.basename(path) != file or name != function:
            continue
        if caller is None:
            seconds += total
        else:
            seconds += sum(row[3] for (_, _, by), row in callers.items() if by == caller)
    return seconds


if __name__ == "__main__":
    main()
