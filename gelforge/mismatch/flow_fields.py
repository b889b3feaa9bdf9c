"""How the gel moves: displacement of the layers with particles by the finite elements, and how it follows each effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from gelforge.config import ConfigError, Study
from gelforge.files import digest, source_digest
from gelforge.indentation.error_bars import AMOUNT as LAW_AMOUNT
from gelforge.indentation.inputs import inputs_digest
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.sensitivities import Variation, unmirrored
from gelforge.indentation.simulate import Model, model_of, simulate_cell
from gelforge.indentation.trajectory import Trajectory
from gelforge.mechanics.equilibrium import NotConverged, Press
from gelforge.mechanics.sensitivity import Neighbour, follow_beside
from gelforge.mismatch.solutions import Solver, SolverFailed, found_before, keep
from gelforge.virtual_lab.particles import interpolation


@dataclass(frozen=True)
class Moved:
    """Displacement of the layers with particles at some depths of a press, on a mesh of boxes."""

    nodes: np.ndarray  # (G, 3) undeformed [mm]
    boxes: np.ndarray  # (E, 8)
    base: np.ndarray  # (D, G, 3) [mm]
    along: Mapping[str, np.ndarray]  # (D, G, 3) [mm per unit] by derivative

    def weights(self, points: np.ndarray) -> csr_array:
        """Return the weights (P, G) of the nodes at points (P, 3)."""
        return interpolation(self.nodes, self.boxes, points)


def storing(study: Study) -> Study:
    """Return the study with displacements kept."""
    return unmirrored(
        study.model_copy(
            update={"mechanics": study.mechanics.model_copy(update={"store_displacement": True})}
        )
    )


def moved_by(task: tuple[Solver, Study, PlannedCell]) -> Moved | str:
    """Return how a press moves the gel in a study, or why it could not be solved."""
    solver, study, planned = task
    study, laws = storing(study), dict(solver.laws)
    name = digest(["moved", inputs_digest(study, laws, planned)])
    kept = found_before(solver, name)
    if kept is None:
        cell = simulate_cell(study, laws, planned)
        if not cell.converged:
            return str(cell.attributes["reason"])
        names = ("gel_node_mm", "gel_hex", "gel_displacement_mm")
        kept = keep(solver, name, {key: cell.arrays[key] for key in names})
    return Moved(kept["gel_node_mm"], kept["gel_hex"], kept["gel_displacement_mm"], {})


def moved_along(task: tuple[Solver, PlannedCell, dict[str, Variation]]) -> Moved:
    """Return how a press moves the gel on the coarser mesh, with derivatives along variations and the laws' directions.

    Variations that could not be solved are missing. Raises SolverFailed where the base could not.
    """
    solver, planned, variations = task
    study, laws = storing(solver.coarse), dict(solver.laws)
    moved_laws = {
        f"law {material} {k}": {**laws, material: law}
        for material, directions in sorted(solver.uncertain.items())
        for k, law in enumerate(directions)
    }
    settings = {
        key: [
            v.study.model_dump(mode="json"),
            v.amount,
            v.alone,
            v.without and v.without.model_dump(mode="json"),
        ]
        for key, v in variations.items()
    }
    moved = {key: {m: law.description() for m, law in own.items()} for key, own in moved_laws.items()}
    own = [inputs_digest(study, laws, planned), settings, moved, source_digest("mismatch/flow_fields.py")]
    name = digest(["moved along", own])
    kept = found_before(solver, name)
    if kept is None:
        kept = keep(solver, name, _followed(study, laws, planned, variations, moved_laws))
    along = {key: field for key, field in kept.items() if key not in ("nodes", "boxes", "base")}
    return Moved(kept["nodes"], kept["boxes"], kept["base"], along)


def _followed(study: Study, laws, planned: PlannedCell, variations, moved_laws) -> dict[str, np.ndarray]:
    whole = moved_or_fail(study, laws, planned)
    found = {"nodes": whole["gel_node_mm"], "boxes": whole["gel_hex"], "base": whole["gel_displacement_mm"]}
    base = _model(study, laws, planned)
    beside, alone = {}, {}
    for key, own in moved_laws.items():
        beside[key] = (_model(study, own, planned, base), LAW_AMOUNT)
    for key, variation in variations.items():
        varied = None if variation.alone else _model(variation.study, variation.laws, planned, base)
        if varied is not None and _same(base, varied):
            beside[key] = (varied, variation.amount)
        else:
            alone[key] = variation
    nodes = _particle_nodes(study, base)
    try:
        found |= _beside(study, base, beside, nodes)
    except NotConverged:  # one that fails must not take the others with it
        for key, one in beside.items():
            try:
                found |= _beside(study, base, {key: one}, nodes)
            except NotConverged:
                continue
    for key, variation in alone.items():
        difference = _difference(found["base"], laws, planned, variation)
        if difference is not None:
            found[key] = difference
    return found


def moved_or_fail(study: Study, laws, planned: PlannedCell) -> Mapping[str, np.ndarray]:
    cell = simulate_cell(study, laws, planned)
    if not cell.converged:
        raise SolverFailed(
            f"the gel's motion at ({planned.x_mm:g}, {planned.y_mm:g}) mm does not converge: "
            f"{cell.attributes['reason']}; leave deeper readings out"
        )
    return cell.arrays


def _model(study: Study, laws, planned: PlannedCell, base: Model | None = None) -> Model:
    by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
    trajectory = Trajectory.of(planned, study.plan.approach)
    return model_of(
        study.sensor,
        study.indenter,
        study.mechanics,
        by_layer,
        trajectory,
        base.body.pattern if base else None,
    )


def _same(base: Model, varied: Model) -> bool:
    """Return whether a varied model can be followed beside the base, see indentation.sensitivities."""
    yields = base.yielding is not None or varied.yielding is not None
    return not yields and varied.body.at_rest and np.array_equal(base.mesh.elements, varied.mesh.elements)


def _particle_nodes(study: Study, base: Model) -> np.ndarray:
    """Return the nodes of the layers with particles, in the order of a cell's file."""
    names = [layer.name for layer in study.sensor.layers if layer.particle_volume_fraction > 0]
    chosen = np.isin(base.mesh.region, [base.mesh.regions.index(name) for name in names])
    return np.unique(base.mesh.elements[chosen])


def _beside(study: Study, base: Model, varied: Mapping[str, tuple[Model, float]], nodes: np.ndarray) -> dict:
    press = Press(base.body, base.shape, base.settings, study.mechanics.solver.linear_solver)
    near = [
        Neighbour(press, model.body, model.shape, model.settings, model.start, model.centres)
        for model, _ in varied.values()
    ]
    fields: dict[str, list] = {key: [] for key in varied}
    for state, states in follow_beside(press, press.start_at(base.start), base.centres, near):
        for (key, (_, amount)), beside in zip(varied.items(), states):
            fields[key].append((beside.u[nodes] - state.u[nodes]) / amount)
    return {key: np.array(field, np.float32) for key, field in fields.items()}


def _difference(base: np.ndarray, laws, planned: PlannedCell, variation: Variation) -> np.ndarray | None:
    """Return a derivative as the difference of two solutions, node by node; None where there is none."""
    fields = []
    for study in (variation.study, variation.without):
        if study is None:
            fields.append(base)
            continue
        try:
            cell = simulate_cell(storing(study), laws, planned)
        except ConfigError:
            return None
        moved = cell.arrays.get("gel_displacement_mm")
        if not cell.converged or moved is None or moved.shape != base.shape:
            return None
        fields.append(moved)
    return (fields[0] - fields[1]) / variation.amount


def solved_with(
    solver: Solver, study: Study, planned: Sequence[PlannedCell], points: np.ndarray
) -> list[np.ndarray]:
    """Return the displacement (D, P, 3) at points of every press on a study's coarser mesh. Raises NotConverged."""
    own = replace(solver, study=study)
    found = solver.each(moved_by, [(own, own.coarse, one) for one in planned])
    for result in found:
        if isinstance(result, str):
            raise NotConverged(result)
    return [np.stack([one.weights(points) @ u.astype(float) for u in one.base]) for one in found]
