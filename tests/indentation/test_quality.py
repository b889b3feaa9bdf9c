"""Qualities of the mesh: what they multiply, and that they lie in order."""

import numpy as np
import specimens
from numpy.testing import assert_allclose

from gelforge.config import Mesh
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.sensor_mesh import sizes_of
from gelforge.indentation.solving.simulate import simulate_cell

SIZES = {"near_mm": 0.6, "growth": 0.3, "far_mm": 1.8, "wall_parts": 2.0}


def test_fast_is_coarser_and_fine_is_finer_than_standard():
    assert sizes_of(Mesh(**SIZES)) == sizes_of(Mesh(quality="standard", **SIZES))
    assert sizes_of(Mesh(**SIZES)).near == 0.6

    # Fast is coarser and fine is finer everywhere
    fast, standard, fine = (sizes_of(Mesh(quality=q, **SIZES)) for q in ("fast", "standard", "fine"))
    for name in ("near", "far"):
        assert_allclose(
            [getattr(s, name) for s in (fast, fine)], getattr(standard, name) * np.array([4 / 3, 2 / 3])
        )
    assert fast.growth > standard.growth == fine.growth
    assert fast.wall_parts < standard.wall_parts < fine.wall_parts

    # The quality used is not applied twice and goes with coarser meshes
    fast = Mesh(quality="fast", **SIZES)
    assert fast.used.used == fast.used
    assert_allclose(fast.coarser(2.0).used.near_mm, 2 * fast.used.near_mm)


def test_a_study_of_each_quality_has_more_unknowns_and_a_smaller_error():
    cells = [
        simulate_cell(
            specimens.study(mesh={"quality": quality}),
            specimens.STUDY_LAWS,
            PlannedCell("a", 8.0, 8.0, (0.5, 1.0, 1.5)),
        )
        for quality in ("fast", "standard", "fine")
    ]
    unknowns = [cell.attributes["degrees_of_freedom"] for cell in cells]
    assert unknowns[0] < unknowns[1] < unknowns[2]
    forces = np.array([cell.arrays["total_force_N"][:, 2] for cell in cells])
    # in order from coarse to fine, on these coarse elements by some per cent
    assert (np.abs(forces[0] / forces[2] - 1) > np.abs(forces[1] / forces[2] - 1)).all()
