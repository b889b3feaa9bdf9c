"""The article's sensor pressed 2 mm from its rim, on a coarse mesh, through all of the article's depths."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.api.studies import paper_study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of

EDGE, CORNER = (2.0, 16.0), (2.0, 2.0)


@pytest.mark.parametrize("place", [EDGE, CORNER], ids=["one edge", "two edges"])
def test_presses_2_mm_from_the_rim_converge_and_balance(place):
    """The ball, of 5 mm, reaches beyond the edge: its contact does not, and the force leans on an axis of symmetry."""
    study = paper_study()
    coarse = study.mechanics.mesh.model_copy(update={"near_mm": 1.0, "far_mm": 3.0})
    study = study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"mesh": coarse})})
    cell = simulate_cell(study, laws_of(study, []), PlannedCell("rim", *place, study.plan.depths_mm))
    assert cell.converged, cell.attributes["reason"]
    assert list(cell.arrays["depth_mm"]) == list(study.plan.depths_mm) and len(study.plan.depths_mm) == 8
    # what stored cells promise
    assert max(cell.attributes["force_balance"]) <= 1e-6
    assert max(cell.attributes["moment_balance"]) <= 1e-6
    assert min(cell.attributes["smallest_J"]) > 0.5  # 0.7 measured: no element is near to turning inside out
    force = cell.arrays["total_force_N"]
    assert (np.diff(force[:, 2], prepend=0.0) < 0).all()
    across = force[:, 1] if place == EDGE else force[:, 0] - force[:, 1]
    assert_allclose(across, 0, atol=1e-6 * np.abs(force).max())  # the stopping rule
