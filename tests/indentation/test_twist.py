"""An indenter that turns about the vertical axis under load: torque by friction alone, and no force along the surface."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose, assert_array_equal

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.planning.plan_table import plan_table
from gelforge.indentation.sensor.indenter_shapes import shape_of
from gelforge.indentation.solving.model import touched_discs
from gelforge.indentation.solving.simulate import simulate_cell

CENTRE = np.array(specimens.CENTRE)
MESH = {"near_mm": 0.7, "near_radius_mm": 2.4, "growth": 0.4, "far_mm": 2.0}
PUNCH = {"kind": "cylinder", "radius_mm": 2.0, "length_mm": 6.0, "edge_radius_mm": 0.3}
BALL = {"kind": "sphere", "radius_mm": 3.0}
EDGE = {"kind": "box", "size_mm": [6.0, 2.0, 5.0], "edge_radius_mm": 0.5}


def twisted(indenter, friction, twists_deg, **more):
    """Return the arrays of an indenter pressed by 0.2 and 0.4 mm, then twisted."""
    depths = (0.2, 0.4, *[0.4] * len(twists_deg))
    phases = ("load", "load", *["twist"] * len(twists_deg))
    planned = PlannedCell("press", *CENTRE, depths, phases=phases, twists_deg=(0.0, 0.0, *twists_deg), **more)
    study = specimens.study(indenter=indenter, mesh=MESH, friction=friction)
    cell = simulate_cell(study, specimens.STUDY_LAWS, planned)
    assert cell.converged, cell.attributes["reason"]
    assert max(cell.attributes["force_balance"]) < 1e-6
    return cell.arrays


def arms(a):
    """Return the horizontal arms (D, n, 2) [mm] of the nodes about the axis, deformed."""
    return a["node_xy_mm"] - CENTRE + a["node_displacement_mm"][..., :2]


def torque(a):
    """Return the torque (D,) [N mm] on the sensor about the axis, counter-clockwise seen from above."""
    r, f = arms(a), a["node_normal_N"] + a["node_shear_N"]
    return (r[..., 0] * f[..., 1] - r[..., 1] * f[..., 0]).sum(axis=1)


def test_a_punch_slides_by_coulombs_law_or_sticks_as_a_spring():
    # A sliding punch has the torque of coulombs law. Every node slides around the axis: the torque is the sum of mu
    # N r, whatever the pressure's distribution is
    mu = 0.05
    a = twisted(PUNCH, mu, (5.0, 10.0))
    assert set(a["node_state"][-1]) == {0, 2}
    r = np.linalg.norm(arms(a), axis=-1)
    wanted = mu * (r * np.linalg.norm(a["node_normal_N"], axis=-1)).sum(axis=1)
    # the rounded edge's normals lean outwards, and the gel's own twist turns slips by less than a hundredth
    assert_allclose(torque(a)[2:], wanted[2:], rtol=0.01)
    assert_allclose(torque(twisted(PUNCH, mu, (-5.0,)))[-1], -torque(a)[2], rtol=1e-6)

    # A sticking punch turns the gel as a spring and drags it nowhere
    a = twisted(PUNCH, 0.9, (1.0, 2.0))
    t = torque(a)
    assert_allclose(t[3] / t[2], 2, rtol=0.06)  # some nodes of the rim slip
    size = np.abs(a["total_force_N"][:, 2])[:, None]
    assert_allclose(a["total_force_N"][:, :2] / size, 0, atol=1e-6)  # the tolerance of forces
    # through the axis friction is antisymmetric: the mesh of the sensor's middle is symmetric
    r, f = a["node_xy_mm"] - CENTRE, a["node_shear_N"][-1] - a["node_shear_N"][1]
    opposite = np.array([np.linalg.norm(r + own, axis=1).argmin() for own in r])
    assert_allclose(f[opposite][:, :2], -f[:, :2], atol=1e-5 * np.abs(f).max())
    assert np.abs(f[:, :2]).max() > 1e-3


def test_a_twisted_ball_acts_by_friction_alone():
    smooth = twisted(BALL, 0.0, (10.0,))
    for name in ("total_force_N", "node_normal_N", "node_displacement_mm"):
        assert_allclose(smooth[name][2], smooth[name][1], atol=1e-6 * np.abs(smooth[name]).max())
    assert not smooth["node_shear_N"].any()

    rough = twisted(BALL, 0.5, (3.0,))
    limit = 0.5 * (
        np.linalg.norm(arms(rough), axis=-1) * np.linalg.norm(rough["node_normal_N"], axis=-1)
    ).sum(axis=1)
    assert 0.1 * limit[2] < torque(rough)[2] < limit[2]
    assert abs(torque(rough)[1]) < 1e-6 * limit[1]
    assert np.abs(rough["total_force_N"][:, :2]).max() < 1e-8


def test_edges_and_plan_files_twist(tmp_path):
    # An edge that turns is finely meshed where it goes
    box = specimens.study(indenter=EDGE).indenter
    path = Trajectory(8.0, 8.0, (0.4, 0.4), ("load", "twist"), twists_deg=(0.0, 90.0))
    discs = touched_discs(shape_of(box), path)
    still = touched_discs(shape_of(box), Trajectory(8.0, 8.0, (0.4,), ("load",)))
    assert_allclose(discs[: len(still)], still)
    assert_allclose(np.ptp(discs[len(still) :, 1]), np.ptp(still[:, 0]))  # it lay along x and lies along y
    assert np.ptp(still[:, 0]) > 2 > np.ptp(still[:, 1])

    # A plan file twists
    file = tmp_path / "plan.csv"
    file.write_text(
        "cell,x_mm,y_mm,depth_mm,phase,twist_deg\na,8,8,0.4,,0\na,8,8,0.4,,5\na,8,8,0.4,,10\na,8,8,0.2,,10\n"
    )
    cell = plan_cells(specimens.study(plan={"file": str(file)}))["a"]
    assert cell.phases == ("load", "twist", "twist", "unload")
    assert cell.twists_deg == (0.0, 5.0, 10.0, 10.0)
    assert not cell.tilts_deg and not cell.shears_mm
    assert list(plan_table({"a": cell})["twist_deg"]) == [0.0, 5.0, 10.0, 10.0]
    centres = Trajectory.of(cell).centres(np.zeros(3))
    assert_allclose(centres[:, 3:], np.radians([[0, 0, t] for t in cell.twists_deg]))


@pytest.mark.parametrize("twists", [(), (0.0, 10.0)])
def test_a_cell_says_its_twist_only_if_it_has_one(twists):
    planned = PlannedCell(
        "press", *CENTRE, (0.2, 0.2), phases=("load", "twist" if twists else "dwell"), twists_deg=twists
    )
    a = simulate_cell(specimens.study(mesh=MESH, friction=0.0), specimens.STUDY_LAWS, planned).arrays
    if twists:
        assert_array_equal(a["twist_deg"], twists)
    else:
        assert "twist_deg" not in a
