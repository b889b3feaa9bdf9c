"""The three qualities of the mesh on each shipped sensor: unknowns, errors of Fz and CPU seconds of a press with error bars.

usage: python benchmarks/qualities.py [--sensors NAME ...] [--update]

The studies of config/smoke, four depths, evenly to the deepest of the plan, one thread. Meshes of a block have the default
sizes (near 0.3 mm, far 1.2 mm) and those of its study, meshes of other shapes those of their study. The reference is a mesh
of half the default sizes, of other shapes half the study's, with the same steps of the indenter. Blocks are pressed at 0.4
of the width in the middle of the breadth and at the plan's margin from two sides, others at the first of these. Printed are
the largest error of Fz, the largest stated standard deviation, the largest error over its standard deviation, all over
depths and places, and the median of the CPU seconds.

--update writes the rows of these sensors to gelforge/cli/study/mesh_errors.csv, from which `gelforge check` and
`gelforge press` say what a mesh errs by.
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np
import pandas as pd
from cell_cost import machine

from gelforge.api.studies import sensor, sensors
from gelforge.cli.study.mesh_quality import (
    DEPTHS,
    MEASURED,
    NUMBERS,
    read_mesh_errors,
    reference_mesh,
    write_mesh_errors,
)
from gelforge.config import Mesh, Study
from gelforge.config.parts.mechanics import QUALITIES
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import simulate_label
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of

ALONG, ACROSS = 0.4, 0.5  # place over width and breadth


def places(study: Study) -> list[PlannedCell]:
    """Return where a sensor is pressed, and how deep."""
    deepest = max(study.plan.depths_mm)
    depths = tuple(deepest * (k + 1) / DEPTHS for k in range(DEPTHS))
    where = [(ALONG * study.sensor.width_x_mm, ACROSS * study.sensor.width_y_mm)]
    if study.sensor.shape.kind == "block":
        where += [(study.plan.grid.margin_mm,) * 2]
    return [PlannedCell(f"place{k}", *place, depths) for k, place in enumerate(where)]


def meshes(study: Study) -> list[Mesh]:
    """Return the sizes that are tested in all qualities."""
    own = study.mechanics.mesh
    return [Mesh(), own] if study.sensor.shape.kind == "block" else [own]


def with_mesh(study: Study, mesh: Mesh, step: float = 1.0) -> Study:
    """Return a study on another mesh; step: factor of the indenter's longest step over the element size."""
    solver = study.mechanics.solver
    solver = solver.model_copy(update={"longest_step": step * solver.longest_step})
    mechanics = study.mechanics.model_copy(update={"mesh": mesh, "solver": solver})
    return study.model_copy(update={"mechanics": mechanics})


def reference(study: Study, place: PlannedCell) -> np.ndarray:
    """Return Fz (D,) [N] on half the sizes, with steps as long as those of the default mesh."""
    cell = simulate_cell(with_mesh(study, reference_mesh(study), step=2.0), laws_of(study, []), place)
    return good(cell).arrays["total_force_N"][:, 2]


def good(cell: Cell) -> Cell:
    """Return a cell that converged; ends the command at another."""
    if not cell.converged:
        raise SystemExit(
            f"{cell.attributes['reason']} at {cell.attributes['x_mm'], cell.attributes['y_mm']} mm"
        )
    return cell


def rows(name: str) -> list[dict]:
    """Return a sensor's rows, one for each mesh and quality."""
    study = sensor(name)
    laws, pressed = laws_of(study, []), places(study)
    simulate_label(
        with_mesh(study, study.mechanics.mesh.coarser(2)), laws, {}, pressed[0]
    )  # loads compiled kernels
    true = np.array([reference(study, place) for place in pressed])
    found = []
    for mesh in meshes(study):
        for quality in QUALITIES:
            sized = mesh.model_copy(update={"quality": quality})
            cells = [good(simulate_label(with_mesh(study, sized), laws, {}, place)) for place in pressed]
            force = np.array([cell.arrays["total_force_N"][:, 2] for cell in cells])
            sigma = np.array([cell.arrays["total_sigma_mesh_N"][:, 2] for cell in cells])
            numbers = (
                sized.used.near_mm,
                sized.used.far_mm,
                max(cell.attributes["degrees_of_freedom"] for cell in cells),
                100 * np.abs(force / true - 1).max(),
                100 * np.abs(sigma / force).max(),
                (np.abs(force - true) / sigma).max(),
                np.median([cell.attributes["cpu_seconds"] for cell in cells]),
            )
            found.append({"sensor": name, "quality": quality} | dict(zip(NUMBERS, map(float, numbers))))
            print(table_of(found[-1:]), flush=True)
    return found


def table_of(found: list[dict]) -> str:
    """Return rows as Markdown."""
    table = pd.DataFrame(found)
    for name, decimals in NUMBERS.items():
        table[name] = [f"{value:.{decimals}f}" for value in table[name]]
    return table.to_markdown(index=False, disable_numparse=True, colalign=("left", "left"))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensors", nargs="+", choices=sensors(), default=sensors(), metavar="NAME")
    parser.add_argument("--update", action="store_true")
    options = parser.parse_args()
    table = [row for name in options.sensors for row in rows(name)]
    print(f"\n{table_of(table)}")
    if options.update:
        others = [
            row for row in read_mesh_errors().to_dict("records") if row["sensor"] not in options.sensors
        ]
        write_mesh_errors(sorted(others + table, key=lambda row: row["sensor"]), machine())
        print(f"written to {MEASURED}")


if __name__ == "__main__":
    main()
