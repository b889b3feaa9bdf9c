"""How the gel moves: displacement of the layers with particles by the finite elements, and how it follows each effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from gelforge.config import Study
from gelforge.files import source_digest
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import transform_points
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.sensitivities import Variation, unmirrored
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.fem.asked import Asked, carried_derivatives, observed_by
from gelforge.mismatch.fem.solutions import Solver, along_laws, each_derivative, once
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

    def at(self, weights: csr_array) -> np.ndarray:
        """Return the base displacement (D, P, 3) at points of these weights."""
        return np.stack([weights @ u.astype(float) for u in self.base])

    def carried(self, symmetry: str, asked: Sequence[Asked], width_mm: float) -> Moved:
        """Return what a symmetry of a square of this width makes of it, with the asked derivatives that it can show."""
        fields = carried_derivatives(dict(self.along) | {"base": self.base}, symmetry, asked, width_mm)
        return Moved(self.nodes, self.boxes, fields.pop("base"), fields, symmetry, width_mm)


def storing(study: Study) -> Study:
    """Return the study with displacements kept."""
    mechanics = study.mechanics.model_copy(update={"store_displacement": True})
    return unmirrored(study.model_copy(update={"mechanics": mechanics}))


def _storing(variation: Variation) -> Variation:
    without = variation.without and storing(variation.without)
    instead = variation.instead and _storing(variation.instead)
    return replace(variation, study=storing(variation.study), without=without, instead=instead)


def moved_by(task: tuple[Solver, Study, PlannedCell, Mapping[str, Variation]]) -> Moved | str:
    """Return how an indentation moves the gel in a study, with derivatives along variations, or why it is not solved.

    Variations that could not be solved are missing.
    """
    solver, study, planned, variations = task
    study, laws = storing(study), dict(solver.laws)
    asked = {key: _storing(variation) for key, variation in variations.items()}
    about = {key: variation.inputs for key, variation in asked.items()}
    source = source_digest("mismatch/images/flow_fields.py")
    content = ["moved", inputs_digest(study, laws, planned), about, source]

    def solve() -> dict[str, np.ndarray] | str:
        try:
            cell, along = each_derivative(study, laws, planned, asked)
        except NotConverged as failure:
            return str(failure)
        names = {"nodes": "gel_node_mm", "boxes": "gel_hex", "base": "gel_displacement_mm"}
        fields = {
            key: one.gel for key, one in along.items() if not isinstance(one, str) and one.gel is not None
        }
        return {key: cell.arrays[array] for key, array in names.items()} | fields

    kept = once(solver, content, solve)
    if isinstance(kept, str):
        return kept
    along = {key: field for key, field in kept.items() if key not in ("nodes", "boxes", "base")}
    return Moved(kept["nodes"], kept["boxes"], kept["base"], along)


def each_moved(
    solver: Solver, study: Study, planned: Sequence[PlannedCell], asked: Sequence[Asked] | None = None
) -> list[Moved]:
    """Return how each indentation moves the gel in a study, mirror images carried. Raises NotConverged.

    asked: also all derivatives that an indentation shows, and those along the laws.
    """
    laws = {} if asked is None else along_laws(solver, storing(study))

    def solve(distinct: list[PlannedCell]) -> list[Moved]:
        tasks = [(solver, study, one, laws | observed_by(asked or (), one)) for one in distinct]
        moved = solver.each(moved_by, tasks)
        for one, path in zip(moved, distinct):
            if isinstance(one, str):
                raise NotConverged(f"at ({path.x_mm:g}, {path.y_mm:g}) mm: {one}")
        return moved

    moved, symmetries = solved_for_all(solver.study, planned, solve)
    width = study.sensor.width_x_mm
    return [one.carried(symmetry, asked or (), width) for one, symmetry in zip(moved, symmetries)]
