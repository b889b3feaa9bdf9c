"""Sites that are mirror images of solved ones."""

from __future__ import annotations

import time

import numpy as np

from gelforge.config import Study
from gelforge.indentation.cells.cell_file import ERROR_BARS, TIMINGS, Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import transform_bins, transform_points, transform_vectors
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.mechanics.laws.law import PrincipalLaw


def mirror_cell(source: Cell, study: Study, laws: dict[str, PrincipalLaw], planned: PlannedCell) -> Cell:
    """Return the site that the plan's symmetry makes of another one, without section, gel displacement and derivatives.

    Its seconds are those of the mirroring; iterations and balances are those of its source.

    Parameters
    ----------
    source : Cell
        The solved site.
    study : Study
        Its sensor and bins.
    laws : dict of str to PrincipalLaw
        By material [MPa], for the digest of the inputs.
    planned : PlannedCell
        The mirrored site; `symmetry` names a key of D4.

    Returns
    -------
    Cell
        Forces [N] by bin and by node, and totals.

    Raises
    ------
    ValueError
        For a site that mirrors no other.
    """
    wall_clock, cpu_clock = time.perf_counter(), time.process_time()
    name, width, n = planned.symmetry, study.sensor.width_x_mm, study.sensor.bins.nx
    if name is None:
        raise ValueError(f"site {planned.name} mirrors no other; solve it")
    # Shear and tilt are zero: a site that shears or tilts is solved itself.
    plain = ("depth_mm", "shear_mm", "tilt_deg")
    arrays = {key: source.arrays[key] for key in plain if key in source.arrays}
    for key in (
        "total_force_N",
        "reaction_N",
        "side_force_N",
        "node_normal_N",
        "node_shear_N",
        "node_displacement_mm",
    ):
        if key not in source.arrays:  # an interpolated source has no nodes, a failed one perhaps nothing
            continue
        arrays[key] = transform_vectors(name, source.arrays[key])
    for key in [key for key in ("bin_force_N", "bin_normal_N", "bin_shear_N") if key in source.arrays]:
        arrays[key] = transform_bins(name, source.arrays[key], n)
    for key in sorted(ERROR_BARS & set(source.arrays)):
        moved = transform_bins(name, source.arrays[key], n) if key.startswith("bin") else None
        arrays[key] = np.abs(transform_vectors(name, source.arrays[key]) if moved is None else moved)
    for key in {"node_xy_mm", "indenter_mm"} & set(source.arrays):
        arrays[key] = transform_points(name, source.arrays[key], width)
    arrays |= {key: source.arrays[key] for key in ("node_area_mm2", "node_state") if key in source.arrays}
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
