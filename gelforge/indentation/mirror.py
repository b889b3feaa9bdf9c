"""Cells that are mirror images of solved ones."""

from __future__ import annotations

import time

from gelforge.config import Study
from gelforge.indentation.cell_file import Cell
from gelforge.indentation.inputs import inputs_digest
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.symmetry import transform_bins, transform_points, transform_vectors
from gelforge.mechanics.laws import Ogden


def mirror_cell(source: Cell, study: Study, laws: dict[str, Ogden], planned: PlannedCell) -> Cell:
    """Return the cell that the symmetry of the plan makes of its source, without section and gel displacement.

    Its seconds are those of the mirroring; the iterations and balances are its source's.
    """
    wall_clock, cpu_clock = time.perf_counter(), time.process_time()
    name, width, n = planned.symmetry, study.sensor.width_x_mm, study.sensor.bins.nx
    arrays = {"depth_mm": source.arrays["depth_mm"]}
    for key in ("total_force_N", "reaction_N", "node_normal_N", "node_shear_N", "node_displacement_mm"):
        arrays[key] = transform_vectors(name, source.arrays[key])
    for key in ("bin_force_N", "bin_normal_N", "bin_shear_N"):
        arrays[key] = transform_bins(name, source.arrays[key], n)
    arrays["node_xy_mm"] = transform_points(name, source.arrays["node_xy_mm"], width)
    arrays["node_area_mm2"], arrays["node_state"] = (
        source.arrays["node_area_mm2"],
        source.arrays["node_state"],
    )
    identity = {
        "cell": planned.name,
        "x_mm": planned.x_mm,
        "y_mm": planned.y_mm,
        "source": planned.source,
        "symmetry": name,
        "inputs_digest": inputs_digest(study, laws, planned),
        "source_inputs_digest": source.attributes["inputs_digest"],
        "seconds": time.perf_counter() - wall_clock,
        "cpu_seconds": time.process_time() - cpu_clock,
    }
    return Cell(arrays, source.attributes | identity)
