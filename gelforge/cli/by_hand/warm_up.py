"""`gelforge warm-up`: compiled kernels, made beforehand by tiny presses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gelforge.api.studies import paper_study
from gelforge.laws_of_study import laws_of

if TYPE_CHECKING:
    from gelforge.indentation.cells.cell_file import Cell


def warm_up() -> None:
    """Compile every kernel by tiny presses; later runs load them from the cache."""
    for strain in ("finite", "small"):
        cell = tiny_press(strain)
        print(f"{strain} strain: {cell.attributes['linear_solver']}, {cell.attributes['seconds']:.1f} s")


def tiny_press(strain: str) -> Cell:
    """Return the solution of a press on a coarse mesh, which compiles or loads the kernels and the direct solver."""
    from gelforge.config import Mesh
    from gelforge.indentation.paths.planned_cell import PlannedCell
    from gelforge.indentation.solving.simulate import simulate_cell

    study = paper_study()
    coarse = Mesh(near_mm=2.0, near_radius_mm=2.0, far_mm=4.0)
    mechanics = study.mechanics.model_copy(update={"mesh": coarse, "strain": strain})
    tiny = study.model_copy(update={"mechanics": mechanics})
    return simulate_cell(tiny, laws_of(study, []), PlannedCell("warm_up", 16.0, 16.0, (0.5,)))
