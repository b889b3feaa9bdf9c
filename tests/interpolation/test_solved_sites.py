"""Labels between finite-element solutions: held-out sites next to what is solved there, on a coarse mesh."""

from functools import cache

import numpy as np
import pytest
import specimens
from closed_form import LAWS

from gelforge.config import study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.lattice import index_of, lattice_of, name_of, solved_site
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.solving.companion import simulate_label
from gelforge.interpolation.nodal_forces import NodalForces
from gelforge.interpolation.solved_sites import SolvedSites

STUDY = study_from(
    merged(
        specimens.BETWEEN,
        {
            "sensor": {"wall_mm": 0.0},
            "mechanics": {"mesh": {"near_mm": 0.8, "near_radius_mm": 3.0, "far_mm": 3.2}},
            "plan": {
                "grid": {"spacing_mm": 1.1, "margin_mm": 9.5},
                "depths_mm": [0.6, 1.2],
                "interpolation": {"tolerance": 1.0},
            },
        },
    )
)


def solve(planned):
    return simulate_label(STUDY, LAWS, {}, planned)


@cache
def sites() -> SolvedSites:
    lattice = lattice_of(STUDY, plan_cells(STUDY))
    names = [name_of(at) for at in lattice.representatives(lattice.level(1))]
    cells = {index_of(name): solve(solved_site(lattice, name)) for name in names}
    return SolvedSites(lattice, STUDY.sensor, STUDY.indenter, cells)


def test_nodes_at_their_own_place_give_the_bins_of_the_mesh():
    """Shape functions of the mesh next to hats of the nodes' areas: two hundredths of the largest bin on a coarse mesh."""
    for cell in sites().cells.values():
        place = np.array([cell.attributes["x_mm"], cell.attributes["y_mm"]])
        moved = NodalForces.of(cell).binned(place, STUDY.sensor).reshape(2, -1, 6)
        scale = np.abs(cell.arrays["bin_normal_N"]).max()
        assert moved[..., :3] == pytest.approx(cell.arrays["bin_normal_N"], abs=0.02 * scale)
        assert moved.sum(axis=1)[:, :3] == pytest.approx(
            cell.arrays["node_normal_N"].sum(axis=1), rel=1e-9, abs=1e-12
        )


@pytest.mark.parametrize("place", [(11.3, 13.2), (17.4, 15.9), (10.2, 20.1)])
def test_held_out_sites_lie_inside_the_error_bars(place):
    held = solve(PlannedCell("held", *place, (0.6, 1.2)))
    found = sites().at(np.array(place), (0.6, 1.2))
    bars = sites().bars_at(np.array(place), (0.6, 1.2))
    error = np.abs(found.force - held.arrays["bin_force_N"])
    loaded = np.abs(held.arrays["bin_force_N"]).max(axis=-1) > 0
    inside = (error <= 2 * np.hypot(bars["bin_interpolation"], bars["bin_mesh"]))[loaded]
    assert inside.mean() > 0.9
    total = np.abs(found.force.sum(axis=1) - held.arrays["total_force_N"])
    assert (total <= 2 * np.hypot(bars["total_interpolation"], bars["total_mesh"])).all()
    assert total.max() < 0.02 * np.abs(held.arrays["total_force_N"]).max()
