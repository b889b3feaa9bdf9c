"""FElupe's model of the concealed sets: balls to which the mesh is bent."""

import numpy as np
import pytest

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
import felupe as fem

from validation.pressed import ROUNDED, Ball, Setup, _grid, _in_cube, _lines, _rounded

BALL = Ball((3.0, 1.0, -3.0), 1.3, 20.0)


@pytest.fixture(scope="module")
def bent():
    points, cells, middles = _grid(_lines(Setup(4.0, 2.0, defect=BALL)))
    own = _in_cube(BALL, middles)
    return points, cells, own, _rounded(points, cells[own], BALL)


def test_a_cube_of_elements_is_bent_to_a_ball_as_large(bent):
    """Its volume is the ball's but for rounding, and all nodes of its face lie on one sphere."""
    _, cells, own, points = bent
    volume = fem.RegionHexahedron(fem.Mesh(points, cells[own], "hexahedron")).dV.sum()
    assert volume == pytest.approx(4 / 3 * np.pi * BALL.radius_mm**3, rel=1e-9)
    face = np.intersect1d(cells[own], cells[~own])
    away = np.linalg.norm(points[face] - BALL.centre_mm, axis=1)
    assert np.ptp(away) < 1e-9 and 1 < away[0] / BALL.radius_mm < 1.05

    # No element is turned inside out and none far away moves
    before, cells, _, points = bent
    assert fem.RegionHexahedron(fem.Mesh(points, cells, "hexahedron")).dV.min() > 0
    far = np.abs(before - BALL.centre_mm).max(axis=1) >= ROUNDED * BALL.radius_mm
    skin = before[:, 2] >= -1.0 - 1e-9
    assert skin.any() and np.array_equal(points[far | skin], before[far | skin])
