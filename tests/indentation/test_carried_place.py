"""Derivatives along the place of a press: its touched nodes are taken along, so no ripple from node to node enters."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.effects.geometry import carried_mesh
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.sensitivities import Variation, derivatives, unmirrored
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mechanics.meshes.mesh import layered_block

LAWS = specimens.STUDY_LAWS
FINE = {"mesh": {"near_mm": 0.5, "near_radius_mm": 2.5, "growth": 0.3, "far_mm": 1.0}}
TIGHT = {"solver": {"force_tolerance": 1e-8, "gap_tolerance": 1e-7, "max_iterations": 80}}
SMALL_BALL = {"kind": "sphere", "radius_mm": 3.0}
NARROW_BINS = {
    "bins": {"nx": 64, "ny": 64}
}  # far narrower than elements: else a moment jumps from bin to bin
AMOUNT = 5e-3


def study(**keys):
    return unmirrored(
        specimens.study(indenter=SMALL_BALL, sensor=NARROW_BINS, store_displacement=True, **TIGHT, **keys)
    )


def moves(base):
    """Return variations of a study along the places of its presses."""
    kinematics = {
        "x": ({"misregistration_mm": [AMOUNT, 0.0]}, AMOUNT),
        "y": ({"misregistration_mm": [0.0, AMOUNT]}, AMOUNT),
        "yaw": ({"yaw_deg": 0.05}, 0.05),
        "scale": ({"grid_scale": 1e-3}, 1e-3),
    }
    return {
        name: Variation(with_keys(base, kinematics=keys), LAWS, amount)
        for name, (keys, amount) in kinematics.items()
    }


def slopes(x, y, depths=(0.3, 0.6), **keys):
    base = study(**keys)
    return derivatives(base, LAWS, PlannedCell("place", x, y, depths), moves(base))


@pytest.fixture(scope="module")
def off_middle():
    return slopes(10.0, 8.7, **FINE)


def middles(bins):
    """Return the middles (B, 2) of the bins [mm]."""
    x = (np.arange(bins.nx) + 0.5) * 16.0 / bins.nx
    return np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)


def test_forces_and_gel_move_with_the_press():
    # Forces move with the press. Far from the walls the force keeps its size and its centre moves as the press
    # does; so do the gel's displacements
    base, found = slopes(8.0, 8.0, **FINE)
    own, pushed = base.arrays["total_force_N"][:, 2], found["x"]
    assert_allclose(pushed.total[:, 2], 0.0, atol=2e-3 * np.abs(own).max())
    places = middles(study().sensor.bins)
    moment = pushed.bins[:, :, 2] @ places
    assert_allclose(moment[:, 0], own, rtol=0.02)
    assert_allclose(moment[:, 1], 0.0, atol=0.02 * np.abs(own).max())

    # The gel moves with the press. Far from the walls u(X - d) is the displacement of a press that is moved by d:
    # the slope is -du/dx
    base, found = slopes(8.0, 8.0, depths=(0.6,), **FINE)
    nodes, u = base.arrays["gel_node_mm"], base.arrays["gel_displacement_mm"][0]
    slope = found["x"].gel[0]
    column = {tuple(np.round(node, 6)): k for k, node in enumerate(nodes)}
    checked = 0
    for k, node in enumerate(nodes):
        near = [column.get(tuple(np.round(node + [s, 0.0, 0.0], 6))) for s in (1.0, -1.0)]
        if None in near or np.abs(node[:2] - 8.0).max() > 2.0:
            continue
        expected = -(u[near[0]] - u[near[1]]) / 2.0
        assert_allclose(slope[k], expected, atol=0.1 * np.abs(u).max())
        checked += 1
    assert checked >= 100
    assert np.abs(slope).max() > 0.2 * np.abs(u).max()


def test_walls_turned_and_stretched_grids_move_presses_as_they_should(off_middle):
    # Walls are felt as on meshes of their own. Against presses on meshes laid out around places to either side,
    # whose elements are the same under the ball
    _, found = off_middle
    for name, (dx, dy) in {"x": (0.5, 0.0), "y": (0.0, 0.5)}.items():
        ends = [
            simulate_cell(study(**FINE), LAWS, PlannedCell("place", 10.0 + s * dx, 8.7 + s * dy, (0.3, 0.6)))
            for s in (1, -1)
        ]
        expected = ends[0].arrays["total_force_N"] - ends[1].arrays["total_force_N"]
        # Their elements at the walls are others, which changes sideways forces as much as the walls do themselves.
        assert_allclose(found[name].total[:, 2], expected[:, 2], atol=0.12 * np.abs(expected).max())

    # A turned and a stretched grid move every press. The chain rule: both move a press at (10, 8.7) mm by what its
    # distance from the middle says
    away = np.array([2.0, 0.7])
    along = np.stack([found["x"].total, found["y"].total])
    size = np.abs(along).max()
    assert_allclose(found["scale"].total, np.tensordot(away, along, 1), atol=0.01 * 2 * size)
    turn = np.radians([-away[1], away[0]])
    assert_allclose(found["yaw"].total, np.tensordot(turn, along, 1), atol=0.02 * size * np.radians(2))


@pytest.mark.parametrize("x", [8.0, 3.0])
def test_walls_stay_and_the_contact_is_moved_as_a_whole(x):
    """Also where the contact lies over the wall, which only the top layer goes over."""
    sensor, by = specimens.study().sensor, np.array([0.3, -0.2])
    sizes = specimens.Sizes(near=0.5, near_radius=2.5, growth=0.3, far=2.0)
    mesh = layered_block(specimens.BLOCK, x, 8.0, sizes)
    moved = carried_mesh(mesh, sensor, np.array([[x, 8.0, 2.5]]), by).X - mesh.X
    touched = (np.hypot(*(mesh.X[:, :2] - [x, 8.0]).T) < 2.0) & (mesh.X[:, 2] == 0) & ~mesh.hanging
    out = ((mesh.X[:, :2] <= 1.0) | (mesh.X[:, :2] >= 15.0)).any(axis=1) & (mesh.X[:, 2] <= -1.0)
    edge = ((mesh.X[:, :2] <= 0.0) | (mesh.X[:, :2] >= 16.0)).any(axis=1)
    assert touched.sum() > 20 and out.sum() > 50
    assert_allclose(moved[touched], np.tile([*by, 0.0], (touched.sum(), 1)))
    assert not moved[out | edge].any() and not moved[:, 2].any()
    own = replace(mesh, X=mesh.X + moved)
    assert_allclose(own.ties @ own.X, own.X, atol=1e-12)  # hanging nodes still hang between the others


def test_a_contact_at_the_edge_takes_nothing_along():
    mesh = layered_block(specimens.BLOCK, 2.0, 8.0, specimens.Sizes(near=1.0, far=2.0))
    at_edge = np.array([[2.0, 8.0, 1.9]])
    assert carried_mesh(mesh, specimens.study().sensor, at_edge, np.array([1e-3, 0.0])) is None
