"""The three qualities of the mesh on each shipped sensor: unknowns, errors of Fz and CPU seconds of a press with error bars.

usage: python benchmarks/qualities.py [--sensors NAME ...] [--qualities fast standard fine] [--repeat 1]

The studies of config/smoke, with the default sizes of hexahedra where the sensor is a block; four depths, evenly to the
deepest of the plan, at 0.4 of the width and the middle of the breadth. One thread. Printed: the largest standard deviation
that is stated for Fz, and the largest difference to the finest of the qualities.
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np
import pandas as pd

from gelforge.config import Mesh, Study, load_study
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import simulate_label
from gelforge.laws_of_study import laws_of

STUDIES = Path("config/smoke")
QUALITIES = ("fast", "standard", "fine")
ALONG, ACROSS = 0.4, 0.5  # place over width and breadth
DEPTHS = 4


def sized(study: Study, quality: str) -> Study:
    """Return a study on a mesh of this quality: of the default sizes for a block, of the study's for other shapes."""
    mesh = Mesh() if study.sensor.shape.kind == "block" else study.mechanics.mesh
    mechanics = study.mechanics.model_copy(update={"mesh": mesh.model_copy(update={"quality": quality})})
    return study.model_copy(update={"mechanics": mechanics})


def pressed(study: Study) -> Cell:
    """Return the label of the study's sensor at the place, DEPTHS depths."""
    deepest = max(study.plan.depths_mm)
    depths = tuple(deepest * (k + 1) / DEPTHS for k in range(DEPTHS))
    place = ALONG * study.sensor.width_x_mm, ACROSS * study.sensor.width_y_mm
    return simulate_label(study, laws_of(study, []), {}, PlannedCell("place", *place, depths))


def rows(name: str, study: Study, qualities: list[str], repeat: int) -> list[dict[str, str]]:
    """Return a sensor's rows, one for each quality."""
    cells = {quality: [pressed(sized(study, quality)) for _ in range(repeat)] for quality in qualities}
    forces = {quality: found[0].arrays["total_force_N"][:, 2] for quality, found in cells.items()}
    finest = forces[qualities[-1]]
    found = []
    for quality, same in cells.items():
        attributes, force = same[0].attributes, forces[quality]
        if not same[0].converged:
            print(f"{name}, {quality}: {attributes['reason']}")
            continue
        sigma = same[0].arrays["total_sigma_mesh_N"][:, 2]
        off = np.abs(force / finest - 1) if len(finest) == len(force) else np.array([np.nan])
        seconds = np.median([cell.attributes["cpu_seconds"] for cell in same])
        found.append(
            {
                "sensor": name,
                "quality": quality,
                "unknowns": str(attributes["degrees_of_freedom"]),
                "stated sigma of Fz [%]": f"{100 * (sigma / np.abs(force)).max():.1f}",
                f"off {qualities[-1]} [%]": f"{100 * off.max():.1f}" if quality != qualities[-1] else "",
                "CPU [s]": f"{seconds:.2g}" if seconds < 100 else f"{seconds:.0f}",
            }
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = sorted(path.stem for path in STUDIES.glob("*.yaml"))
    parser.add_argument("--sensors", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--qualities", nargs="+", choices=QUALITIES, default=list(QUALITIES))
    parser.add_argument("--repeat", type=int, default=1)
    options = parser.parse_args()
    table = []
    for name in options.sensors:
        study = load_study(STUDIES / f"{name}.yaml")
        pressed(sized(study, "fast"))  # loads the compiled kernels
        table += rows(name, study, options.qualities, options.repeat)
    print(pd.DataFrame(table).to_markdown(index=False, disable_numparse=True, colalign=("left",)))


if __name__ == "__main__":
    main()
