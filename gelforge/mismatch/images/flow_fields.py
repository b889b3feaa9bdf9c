"""How the gel moves: displacement of the layers with particles by the finite elements, and how it follows each effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from gelforge.config import Study
from gelforge.files import digest, source_digest
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import transform_points
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.sensitivities import Variation, unmirrored
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.fem.asked import Asked, carried_derivatives, observed_by
from gelforge.mismatch.fem.solutions import (
    Solver,
    SolverFailed,
    along_laws,
    each_derivative,
    found_before,
    keep,
)
from gelforge.mismatch.model.images_of_presses import inverse, solved_for_all
from gelforge.virtual_lab.particles import interpolation


@dataclass(frozen=True)
class Moved:
    """Displacement of the layers with particles at some depths of an indentation, on a mesh of boxes.

    What was solved at a mirror image is carried: displacements are those here, nodes stay where they were solved.
    """

    nodes: np.ndarray  # (G, 3) undeformed [mm], at the image
    boxes: np.ndarray  # (E, 8)
    base: np.ndarray  # (D, G, 3) [mm]
    along: Mapping[str, np.ndarray]  # (D, G, 3) [mm per unit] by derivative
    symmetry: str = "identity"  # which carries the image here
    width_mm: float = 0.0  # of the square that it is a symmetry of

    def weights(self, points: np.ndarray) -> csr_array:
        """Return the weights (P, G) of the nodes at points (P, 3)."""
        there = transform_points(inverse(self.symmetry), points, self.width_mm)
        return interpolation(self.nodes, self.boxes, there)

    def carried(self, symmetry: str, asked: Sequence[Asked], width_mm: float) -> Moved:
        """Return what a symmetry of a square of this width makes of it, with the asked derivatives that it can show."""
        fields = carried_derivatives(dict(self.along) | {"base": self.base}, symmetry, asked, width_mm)
        return Moved(self.nodes, self.boxes, fields.pop("base"), fields, symmetry, width_mm)


def storing(study: Study) -> Study:
    """Return the study with displacements kept."""
    return unmirrored(
        study.model_copy(
            update={"mechanics": study.mechanics.model_copy(update={"store_displacement": True})}
        )
    )


def moved_by(task: tuple[Solver, Study, PlannedCell]) -> Moved | str:
    """Return how an indentation moves the gel in a study, or why it could not be solved."""
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
    """Return how an indentation moves the gel on the coarser mesh, with derivatives along variations and the laws'
    directions.

    Variations that could not be solved are missing. Raises SolverFailed where the base could not.
    """
    solver, planned, variations = task
    study, laws = storing(solver.coarse), dict(solver.laws)
    asked = along_laws(solver, study) | {key: _storing(variation) for key, variation in variations.items()}
    about = {key: variation.inputs for key, variation in asked.items()}
    own = [inputs_digest(study, laws, planned), about, source_digest("mismatch/images/flow_fields.py")]
    name = digest(["moved along", own])
    kept = found_before(solver, name)
    if kept is None:
        try:
            base, along = each_derivative(study, laws, planned, asked)
        except NotConverged as failure:
            raise SolverFailed(
                f"the gel's motion at ({planned.x_mm:g}, {planned.y_mm:g}) mm does not converge: {failure}"
            ) from None
        fields = {
            key: one.gel for key, one in along.items() if not isinstance(one, str) and one.gel is not None
        }
        whole = base.arrays
        mesh = {"nodes": whole["gel_node_mm"], "boxes": whole["gel_hex"]}
        kept = keep(solver, name, mesh | {"base": whole["gel_displacement_mm"]} | fields)
    moved = {key: field for key, field in kept.items() if key not in ("nodes", "boxes", "base")}
    return Moved(kept["nodes"], kept["boxes"], kept["base"], moved)


def _storing(variation: Variation) -> Variation:
    without = variation.without and storing(variation.without)
    instead = variation.instead and _storing(variation.instead)
    return replace(variation, study=storing(variation.study), without=without, instead=instead)


def solved_with(
    solver: Solver, study: Study, planned: Sequence[PlannedCell], points: np.ndarray
) -> list[np.ndarray]:
    """Return the displacement (D, P, 3) at points of every indentation on a study's coarser mesh. Raises NotConverged."""
    own = replace(solver, study=study)
    found = each_moved(own, own.coarse, planned)
    return [np.stack([one.weights(points) @ u.astype(float) for u in one.base]) for one in found]


def each_moved(solver: Solver, study: Study, planned: Sequence[PlannedCell]) -> list[Moved]:
    """Return how each indentation moves the gel in a study, mirror images carried. Raises NotConverged."""

    def solve(distinct: list[PlannedCell]) -> list[Moved]:
        found = solver.each(moved_by, [(solver, study, one) for one in distinct])
        for result in found:
            if isinstance(result, str):
                raise NotConverged(result)
        return found

    found, symmetries = solved_for_all(solver.study, planned, solve)
    width = study.sensor.width_x_mm
    return [one.carried(symmetry, (), width) for one, symmetry in zip(found, symmetries)]


def each_moved_along(solver: Solver, planned: Sequence[PlannedCell], asked: Sequence[Asked]) -> list[Moved]:
    """Return the same on the coarser mesh with all derivatives that an indentation shows. Raises SolverFailed."""
    found, symmetries = solved_for_all(
        solver.study,
        planned,
        lambda distinct: solver.each(
            moved_along, [(solver, one, observed_by(asked, one)) for one in distinct]
        ),
    )
    width = solver.study.sensor.width_x_mm
    return [one.carried(symmetry, asked, width) for one, symmetry in zip(found, symmetries)]
