"""`gelforge warm-up`: compiled kernels, made beforehand by tiny presses and bodies."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from gelforge.api.studies import paper_study
from gelforge.laws_of_study import laws_of

if TYPE_CHECKING:
    from gelforge.indentation.cells.cell_file import Cell


def warm_up() -> None:
    """Compile every kernel, on two cores where there are as many; later runs load them from the cache."""
    from gelforge.workers import each

    each(_compile, ("presses", "other kernels"), min(2, os.cpu_count() or 1), "kernels compiled")


def _compile(part: str) -> None:
    if part == "presses":
        for strain in ("finite", "small"):
            tiny_press(strain)
    else:
        compile_other_kernels()


def tiny_press(strain: str) -> Cell:
    """Return the solution of an indentation of 0.5 mm on a coarse mesh.

    It compiles or loads the kernels and the direct solver.

    Parameters
    ----------
    strain : str
        As `mechanics.strain` of a study: "finite" or "small".

    Returns
    -------
    Cell
        One site of the article's sensor.
    """
    from gelforge.config import Mesh
    from gelforge.indentation.paths.planned_cell import PlannedCell
    from gelforge.indentation.solving.simulate import simulate_cell

    study = paper_study()
    coarse = Mesh(near_mm=2.0, near_radius_mm=2.0, far_mm=4.0)
    mechanics = study.mechanics.model_copy(update={"mesh": coarse, "strain": strain})
    tiny = study.model_copy(update={"mechanics": mechanics})
    return simulate_cell(tiny, laws_of(study, []), PlannedCell("warm_up", 16.0, 16.0, (0.5,)))


def compile_other_kernels() -> None:
    """Compile or load what such a press leaves out: bodies that relax or soften, tetrahedra, surfaces of triangles."""
    from gelforge.mechanics.bodies.kernels import ASSEMBLE, ASSEMBLE_WITH_MEMORY
    from gelforge.mechanics.bodies.memory import RememberingBody
    from gelforge.mechanics.indenters.closed_surface import closed_surface
    from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
    from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block

    mesh = layered_block(Block(1.0, 1.0, (("gel", 1.0),)), 0.5, 0.5, Sizes(near=1.0, far=1.0))
    body = RememberingBody(mesh, {"gel": NeoHooke(0.02)}, 100.0, {}, {})
    body.response(np.zeros_like(mesh.X), np.zeros(len(mesh.elements)))
    ASSEMBLE[10].compile(ASSEMBLE_WITH_MEMORY[8].signatures[0])  # which takes the same arguments
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    surface = closed_surface(tetrahedron, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    surface.gap(tetrahedron, np.zeros(3))
