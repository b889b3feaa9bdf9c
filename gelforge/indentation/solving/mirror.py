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

# Shear and tilt are zero: a site that shears or tilts is solved itself.
UNCHANGED = {"depth_mm", "shear_mm", "tilt_deg", "node_area_mm2", "node_state"}
POINTS = {"node_xy_mm", "indenter_mm"}
VECTORS = {"total_force_N", "reaction_N", "side_force_N", "bin_force_N", "bin_normal_N", "bin_shear_N"}
VECTORS |= {"node_normal_N", "node_shear_N", "node_displacement_mm"}


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
    arrays: dict[str, np.ndarray] = {}
    # An interpolated source has no nodes, a failed one perhaps nothing.
    for key, array in source.arrays.items():
        if key in UNCHANGED:
            arrays[key] = array
        elif key in POINTS:
            arrays[key] = transform_points(name, array, width)
        elif key in VECTORS | ERROR_BARS:
            moved = (
                transform_bins(name, array, n) if key.startswith("bin") else transform_vectors(name, array)
            )
            arrays[key] = np.abs(moved) if key in ERROR_BARS else moved
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
    kept = [key for key in source.attributes if not (key.startswith("sensitivity_") or key in TIMINGS)]
    return Cell(arrays, {key: source.attributes[key] for key in kept} | identity)
