"""Cells that are mirror images of solved ones."""

from __future__ import annotations

import time

import numpy as np

from gelforge.config import Study
from gelforge.indentation.cell_file import ERROR_BARS, TIMINGS, Cell
from gelforge.indentation.inputs import inputs_digest
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.symmetry import transform_bins, transform_points, transform_vectors
from gelforge.mechanics.laws import PrincipalLaw


def mirror_cell(source: Cell, study: Study, laws: dict[str, PrincipalLaw], planned: PlannedCell) -> Cell:
    """Return the cell that the symmetry of the plan makes of its source, without section, gel displacement and derivatives.

    Its seconds are those of the mirroring; the iterations and balances are its source's.
    """
    wall_clock, cpu_clock = time.perf_counter(), time.process_time()
    name, width, n = planned.symmetry, study.sensor.width_x_mm, study.sensor.bins.nx
    arrays = {"depth_mm": source.arrays["depth_mm"], "shear_mm": source.arrays["shear_mm"]}
    arrays["tilt_deg"] = source.arrays["tilt_deg"]  # both zero: a cell that shears or tilts is solved itself
    for key in (
        "total_force_N",
        "reaction_N",
        "side_force_N",
        "node_normal_N",
        "node_shear_N",
        "node_displacement_mm",
    ):
        arrays[key] = transform_vectors(name, source.arrays[key])
    for key in ("bin_force_N", "bin_normal_N", "bin_shear_N"):
        arrays[key] = transform_bins(name, source.arrays[key], n)
    for key in sorted(ERROR_BARS & set(source.arrays)):
        moved = transform_bins(name, source.arrays[key], n) if key.startswith("bin") else None
        arrays[key] = np.abs(transform_vectors(name, source.arrays[key]) if moved is None else moved)
    for key in ("node_xy_mm", "indenter_mm"):
        arrays[key] = transform_points(name, source.arrays[key], width)
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
    # Effects have places and directions: their derivatives are not mirrored.
    kept = {key: value for key, value in source.attributes.items() if not key.startswith("sensitivity_")}
    kept = {key: value for key, value in kept.items() if key not in TIMINGS}
    return Cell(arrays, kept | identity)
