"""True solutions of the virtual sensor's sites, read for what is recorded of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gelforge.indentation.cells.cell_file import Cell, read_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.virtual_lab.particles import VirtualLabError

TRUTH = ["depth_mm", "total_force_N", "gel_node_mm", "gel_hex", "gel_displacement_mm"]


def read_truth(folder: Path, planned: PlannedCell, arrays: list[str] = TRUTH) -> Cell:
    """Return the true solution of a planned site, or of the one that it mirrors, which must be converged and deep enough."""
    path = folder / f"{planned.source or planned.name}.h5"
    cell = read_cell(path, arrays)
    if not cell.converged:
        raise VirtualLabError(
            f"{path}: the true solution of the site failed ({cell.attributes['reason']}); change the virtual lab's mesh"
        )
    if planned.follows_a_path:
        depths = cell.arrays["depth_mm"]
        if len(depths) != len(planned.depths_mm) or np.abs(depths - planned.depths_mm).max() > 1e-9:
            raise VirtualLabError(
                f"{path}: the truth has depths {depths.tolist()} mm, the path of site {planned.name} "
                f"{list(planned.depths_mm)}; solve the site's truth again"
            )
        return cell
    deepest = float(cell.arrays["depth_mm"].max())
    if deepest < planned.depths_mm[-1] - 1e-9:
        raise VirtualLabError(
            f"{path}: the truth ends at {deepest} mm, but site {planned.name} is pressed to "
            f"{planned.depths_mm[-1]} mm; solve the site's truth again"
        )
    return cell
