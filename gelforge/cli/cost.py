"""What a study costs before it runs: minutes of finite elements, from measured cells, and disk.

cell_cost.csv holds the measurements; `python benchmarks/cell_cost.py --update` makes it anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.config import Mesh, Study, load_virtual_lab, variant_study
from gelforge.files import write_text

if TYPE_CHECKING:
    import pandas as pd

MEASURED = Path(__file__).with_name("cell_cost.csv")
DEPTHS = 8  # of every measured cell


def estimate(study: Study, cells: dict) -> list[str]:
    """Return lines with the number of cells, the minutes of finite elements and the disk that a study takes."""
    from gelforge.indentation.plan import variant_cells

    solved = [cell for cell in cells.values() if cell.source is None]
    presses = sum(len(cell.depths_mm) for cell in cells.values())
    unknowns, surface = mesh_size(study, study.mechanics.mesh, solved[0])
    depths = sum(len(cell.depths_mm) for cell in solved)
    mirrored = len(cells) - len(solved)
    measured = read_costs()
    seconds = cell_seconds(measured, unknowns) * depths / DEPTHS + mirrored * mirror_seconds(measured)
    if study.virtual_lab:
        lab = load_virtual_lab(study.virtual_lab)
        true_unknowns, _ = mesh_size(study, lab.mechanics.mesh, solved[0])
        more = depths + len(solved) * len(lab.unload_depths_mm)
        seconds += cell_seconds(measured, true_unknowns) * more / DEPTHS
    for name in study.variants:
        varied, chosen = variant_study(study, name), variant_cells(cells, study, name).values()
        size, _ = mesh_size(varied, varied.mechanics.mesh, next(iter(chosen)))
        seconds += cell_seconds(measured, size) * sum(len(cell.depths_mm) for cell in chosen) / DEPTHS
    # float64 forces (two of three components each) and float32 displacement on surface nodes, three sets of bins
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    disk = presses * (surface * (2 * 3 * 8 + 3 * 4 + 1) + bins * 3 * 3 * 8)
    return [
        f"cells      {len(cells)} positions, {presses} presses; {len(solved)} solved, {mirrored} mirrored",
        f"mesh       {unknowns} degrees of freedom at ({solved[0].x_mm:g}, {solved[0].y_mm:g}) mm",
        f"time       about {duration(seconds / 2)} on two cores for the finite elements (estimate; images and training add)",
        f"disk       at most {disk / 1e6:.1f} MB for the cells (before compression)",
    ]


def duration(seconds: float) -> str:
    """Return a time in words: seconds below two minutes."""
    return f"{max(round(seconds), 1)} seconds" if seconds < 120 else f"{seconds / 60:.0f} minutes"


def mesh_size(study: Study, sizes: Mesh, cell) -> tuple[int, int]:
    """Return the unknowns and the number of surface nodes of a cell's mesh."""
    from gelforge.indentation.sensor_mesh import sensor_mesh

    mesh = sensor_mesh(study.sensor, sizes, cell.x_mm, cell.y_mm)
    return 3 * int((~mesh.hanging).sum()), len(mesh.surface.nodes)


def read_costs(path: Path = MEASURED) -> pd.DataFrame:
    """Return measured cells: kind ("solved" or "mirrored"), degrees_of_freedom, cpu_s."""
    from gelforge.csv_table import read_csv

    return read_csv(path, numbers=("degrees_of_freedom", "cpu_s"), texts=("kind",))


def write_costs(rows: list[tuple[str, int, float]], where: str, path: Path = MEASURED) -> None:
    """Write measured cells (kind, degrees of freedom, CPU seconds); where says on which machine, in words."""
    lines = [
        f"# CPU seconds of a cell with {DEPTHS} depths on one thread, by `python benchmarks/cell_cost.py --update`",
        f"# {where}",
        "kind,degrees_of_freedom,cpu_s",
        *(f"{kind},{size},{seconds:.2f}" for kind, size, seconds in rows),
    ]
    write_text(path, "\n".join(lines) + "\n")


def cell_seconds(measured: pd.DataFrame, unknowns: int) -> float:
    """Return the CPU seconds of a solved cell with 8 depths: the power law through the measured ones."""
    import numpy as np

    solved = measured[measured["kind"] == "solved"]
    exponent, level = np.polyfit(np.log(solved["degrees_of_freedom"]), np.log(solved["cpu_s"]), 1)
    return float(np.exp(level) * unknowns**exponent)


def mirror_seconds(measured: pd.DataFrame) -> float:
    """Return the CPU seconds of a mirrored cell's job, mostly the start of its process."""
    return float(measured.loc[measured["kind"] == "mirrored", "cpu_s"].median())
