"""A site with its error bars: the indentation itself, and a coarse-mesh solution that shows how uncertain its forces are."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.config.parts.effects import HistoryEffects
from gelforge.indentation.cells.binning import bin_forces, bin_shares
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.touching import untouched
from gelforge.indentation.solving.error_bars import AMOUNT, COARSER, Companion, error_bars, laws_moved
from gelforge.indentation.solving.model import model_of
from gelforge.indentation.solving.resolution import resolution_of
from gelforge.indentation.solving.sensitivities import sensitivities, variations_of, with_sensitivities
from gelforge.indentation.solving.simulate import simulate_cell, solved_cell
from gelforge.indentation.solving.site_contents import Solution
from gelforge.indentation.solving.stretch_range import Outside
from gelforge.mechanics.contact.forces import OPEN
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.sensitivities.direct import Varied, follow_with_slopes
from gelforge.mechanics.solving.equilibrium import NotConverged, Press
from gelforge.progress import tracked


def simulate_label(
    study: Study,
    laws: dict[str, PrincipalLaw],
    uncertain: Mapping[str, Sequence[PrincipalLaw]],
    planned: PlannedCell,
    outside: dict[str, Outside] | None = None,
) -> Cell:
    """Return the solved site of a plan with the error bars of its forces, unless mechanics.error_bars is false.

    A site that the indenter, or one of its parts, never touches has failed.

    Parameters
    ----------
    study : Study
        Sensor, indenter and mechanics.
    laws : dict of PrincipalLaw
        By material [MPa].
    uncertain : mapping of sequences of PrincipalLaw
        By material, its law moved by error_bars.AMOUNT of a standard deviation along each independent direction of its
        parameters (materials.fitting.law_file.moved_laws).
    planned : PlannedCell
        Position and path.
    outside : dict of Outside, optional
        See simulate_cell.

    Returns
    -------
    Cell
        Arrays by depth as in cell_file.DATASETS.

    Raises
    ------
    ConfigError
        A sensitivity that has no derivative or no meaning for this study; nothing is solved then.
    """
    variations_of(study, laws, study.mechanics.sensitivities)  # refused before anything is solved
    cell, solution = solved_cell(study, laws, planned, outside)
    cell = _with_derivatives(cell, solution, study, laws, planned)
    del solution  # and its factors
    if cell.converged and (reason := untouched(cell, study.indenter)):
        return Cell(cell.arrays, cell.attributes | {"status": "failed", "reason": reason})
    if not study.mechanics.error_bars or not len(cell.arrays["depth_mm"]):
        return cell
    wall_clock, cpu_clock = time.perf_counter(), time.process_time()
    bins = study.sensor.bins
    try:
        companion, reason, unknowns = solve_companion(study, laws, planned, uncertain)
    except (
        ConfigError,
        NotConverged,
    ) as failure:  # the site itself is solved: its bars are as large as its force
        companion, reason, unknowns = _unknown(bins.nx * bins.ny), str(failure), 0
    done = min(len(companion.total), len(cell.arrays["depth_mm"]))  # either may have ended early
    companion = companion.first(done)
    touched = (cell.arrays["node_state"] != OPEN).sum(axis=1)
    forces = cell.arrays["total_force_N"], cell.arrays["bin_force_N"]
    resolution = resolution_of(study.sensor, study.mechanics.mesh, laws, planned.x_mm, planned.y_mm)
    bars = error_bars(*forces, touched, (bins.ny, bins.nx), companion, resolution)
    attributes = {
        "companion_unknowns": unknowns,
        "companion_reason": reason,
        # a law that was given, and not fitted, has no covariance: its share is zero
        "uncertain_materials": sorted(uncertain),
        "error_bar_seconds": time.perf_counter() - wall_clock,
        "seconds": cell.attributes["seconds"] + time.perf_counter() - wall_clock,
        "cpu_seconds": cell.attributes["cpu_seconds"] + time.process_time() - cpu_clock,
    }
    return Cell(cell.arrays | bars, cell.attributes | attributes)


def _with_derivatives(
    cell: Cell, solution: Solution, study: Study, laws: dict[str, PrincipalLaw], planned: PlannedCell
) -> Cell:
    """Return a site with the derivatives asked for, or with the reason why they could not be followed."""
    names = study.mechanics.sensitivities
    if not (names and cell.converged):
        return cell
    try:
        return with_sensitivities(cell, sensitivities(study, laws, planned, names, solution))
    except (ConfigError, NotConverged) as failure:  # the site itself is solved
        return Cell(cell.arrays, cell.attributes | {"sensitivity_reason": str(failure)})


def _unknown(bins: int) -> Companion:
    """Return the coarse-mesh solution that reached no depth."""
    return Companion(np.empty((0, 3)), np.empty((0, bins, 3)), np.empty((0, 0, 3)), np.empty((0, 0, bins, 3)))


def solve_companion(
    study: Study,
    laws: dict[str, PrincipalLaw],
    planned: PlannedCell,
    uncertain: Mapping[str, Sequence[PrincipalLaw]],
) -> tuple[Companion, str, int]:
    """Return the coarse-mesh solution of a site, as far as it got.

    Effects that make the path another than a plain one (history, residual stretch, a machine that yields) are in its
    forces. How the forces follow the models is taken from the plain path, of which they change little.

    Parameters
    ----------
    study : Study
        As of the site; all sizes of its mesh are doubled.
    laws : dict of str to PrincipalLaw
        By material [MPa].
    planned : PlannedCell
        The site.
    uncertain : mapping of str to sequence of PrincipalLaw
        Moved models by material, as `laws_and_doubts` returns them.

    Returns
    -------
    Companion
        Forces [N] and their slopes [N per standard deviation].
    str
        Why it ended early; "" where it did not.
    int
        Number of unknowns.
    """
    effects = study.mechanics.effects
    coarser = study.with_values({"mechanics": {"mesh": study.mechanics.mesh.coarser(COARSER)}})
    kinematics = effects.kinematics
    yields = kinematics.frame_compliance_mm_per_N or kinematics.base_bending_mm_per_N
    if not (effects.history.any or effects.geometry.prestretch or yields):
        return _plain_companion(coarser, laws, planned, uncertain)
    cell = simulate_cell(coarser, laws, planned)
    total, bins = cell.arrays["total_force_N"], cell.arrays["bin_force_N"]
    plain, _, _ = _plain_companion(_without_path_effects(coarser), laws, planned, uncertain)
    companion = replace(plain, total=total, bins=bins).first(min(len(total), len(plain.total)))
    return companion, cell.attributes["reason"], int(cell.attributes["degrees_of_freedom"])


def _without_path_effects(study: Study) -> Study:
    still = {"frame_compliance_mm_per_N": 0.0, "base_bending_mm_per_N": 0.0}
    plain = {"history": HistoryEffects(), "geometry": {"prestretch": {}}, "kinematics": still}
    return study.with_values({"mechanics": {"effects": plain}})


def _plain_companion(study: Study, laws, planned, uncertain) -> tuple[Companion, str, int]:
    mechanics, sensor = study.mechanics, study.sensor
    trajectory, by_layer = Trajectory.of(planned, study.plan.approach), sensor.by_layer(laws)
    model = model_of(sensor, study.indenter, mechanics, by_layer, trajectory)
    press = Press(model.body, model.shape, model.settings, mechanics.solver.linear_solver)
    varied = []
    for moved in laws_moved(uncertain, by_layer, {layer.name: layer.material for layer in sensor.layers}):
        other = model_of(sensor, study.indenter, mechanics, moved, trajectory, model)
        varied.append(Varied(other.body, other.shape, other.settings, other.start, other.centres, AMOUNT))
    forces, slopes, reason = [], [], ""
    try:
        start = press.start_at(model.start)
        states = follow_with_slopes(press, start, model.centres, varied, forces_only=True)
        for state, slope in tracked(states, "steps of the indenter, on the coarser mesh", len(model.centres)):
            forces.append(state.normal_force + state.friction_force)
            slopes.append(slope.force)
    except NotConverged as failure:
        reason = str(failure)
    D, n, S = len(forces), len(varied), len(model.mesh.surface.nodes)
    nodal = np.array(forces).reshape(D, S, 3)
    along = np.moveaxis(np.array(slopes).reshape(D, n, S, 3), 1, 0)
    shares = bin_shares(model.mesh, sensor, mechanics.binning)
    binned = bin_forces(along.reshape(n * D, S, 3), shares).reshape(n, D, shares.shape[0], 3)
    companion = Companion(nodal.sum(axis=1), bin_forces(nodal, shares), along.sum(axis=2), binned)
    return companion, reason, model.body.pattern.size
