"""Sensors that are no blocks: where they are touched, how they press, and which surfaces are refused."""

import meshio
import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError
from gelforge.indentation.paths.first_contact import centre_at_contact, surface_point
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mechanics.indenters.shapes import DOWN, Sphere
from gelforge.mechanics.reference_solutions import contact_modulus, hertz, poissons_ratio
from gelforge.meshing.solids import block_solids

LAWS = specimens.STUDY_LAWS
WIDTH, TOP = 20.0, (10.0, 10.0)  # a hemisphere of 10 mm
PLAN = {"grid": {"spacing_mm": 4.0, "margin_mm": 6.0}, "depths_mm": [0.3], "approach": "normal"}
MESH = {"near_mm": 0.3, "near_radius_mm": 1.6, "growth": 0.6, "far_mm": 2.0}


def dome(layers=(("gel", 10.0, "soft"),), approach="normal", **sensor):
    """Return the study of a dome 10 mm high."""
    described = {
        "shape": {"kind": "dome"},
        "width_x_mm": WIDTH,
        "width_y_mm": WIDTH,
        "layers": [
            {"name": name, "thickness_mm": thickness, "material": material}
            for name, thickness, material in layers
        ],
    }
    return specimens.study(PLAN | {"approach": approach}, described | sensor, mesh=MESH)


@pytest.fixture(scope="module")
def mesh():
    study = dome()
    return sensor_mesh(study.sensor, study.mechanics.mesh, 13.0, 11.0)


@pytest.mark.parametrize("place", [TOP, (13.0, 11.0), (4.5, 7.0)])
def test_the_point_and_normal_of_a_hemisphere(mesh, place):
    """Edge middles lie on the sphere, so a face of 1 to 3 mm is off by its size^4 / (100 R^3), some 1e-3 mm."""
    point, normal = surface_point(mesh, *place)
    away = point - [10.0, 10.0, -10.0]
    assert np.linalg.norm(away) == pytest.approx(10.0, abs=0.01)
    assert_allclose(normal, away / np.linalg.norm(away), atol=0.02)


def test_a_ball_touches_a_hemisphere_a_sum_of_radii_away(mesh):
    place = (13.0, 11.0)
    point, normal = surface_point(mesh, *place)
    centre = centre_at_contact(Sphere(5.0), mesh, *place, -normal)
    assert np.linalg.norm(centre - [10.0, 10.0, -10.0]) == pytest.approx(15.0, abs=0.01)
    assert_allclose(centre, point + 5.0 * normal, atol=0.05)
    straight = centre_at_contact(
        Sphere(5.0), mesh, *place, DOWN
    )  # from above it meets the flank off its axis
    assert_allclose(straight[:2], place)
    assert straight[2] == pytest.approx(-10.0 + np.sqrt(15.0**2 - 10.0), abs=0.01)

    # No surface lies next to the dome
    with pytest.raises(ValueError, match=r"no top surface lies over \(0\.5, 0\.5\) mm"):
        surface_point(mesh, 0.5, 0.5)


DEPTHS = (0.3, 0.6)  # contact radii of 1 and 1.4 mm


@pytest.fixture(scope="module")
def presses():
    """Return cells of a homogeneous hemisphere: at its top and on a flank along the normals, and there from above."""
    east = (14.0, 10.0)
    cases = {"top": (TOP, "normal"), "east": (east, "normal"), "from above": (east, "vertical")}
    return {
        name: simulate_cell(dome(approach=approach), LAWS, PlannedCell("cell", *place, DEPTHS))
        for name, (place, approach) in cases.items()
    }


@pytest.mark.thorough
def test_a_hemisphere_presses_by_hertz_along_its_normal(presses):
    for name, cell in presses.items():
        assert cell.converged, (name, cell.attributes["reason"])
        assert max(cell.attributes["force_balance"]) < 1e-6
        a = cell.arrays
        total = a["bin_force_N"].sum(axis=1) + a["side_force_N"]
        assert_allclose(total, a["total_force_N"], atol=1e-6 * np.abs(a["total_force_N"]).max())

    # 1/R = 1/5 + 1/10. Base, friction and finite strain add 8 to 12 %; the ball's radius alone
    # would give 22 % more.
    modulus = contact_modulus(specimens.GEL.shear_modulus, poissons_ratio(1000.0))
    for depth, force in zip(DEPTHS, presses["top"].arrays["total_force_N"]):
        known = hertz(depth, 1 / (1 / 5 + 1 / 10), modulus).force
        assert 1.04 < -force[2] / known < 1.16

    # A sphere knows no other direction; far from the base its force is that at the top.
    for top, east in zip(*(presses[name].arrays["total_force_N"] for name in ("top", "east"))):
        normal = np.array([0.4, 0.0, np.sqrt(1 - 0.4**2)])
        assert east @ normal == pytest.approx(-np.linalg.norm(east), rel=2e-3)  # within 4 degrees
        # Two meshes of 3 to 5 nodes over the contact radius.
        assert np.linalg.norm(east) == pytest.approx(np.linalg.norm(top), rel=0.03)

    # A vertical move by d comes nearer along the normal by d cos(angle) only; Hertz's force follows
    # its power 1.5.
    along, down = (presses[name].arrays["total_force_N"][-1] for name in ("east", "from above"))
    normal = np.array([4.0, 0.0, np.sqrt(15.0**2 - 16.0)]) / 15.0  # where the ball meets the flank
    assert down @ normal / np.linalg.norm(along) == pytest.approx(-(normal[2] ** 1.5), rel=0.05)

    # The section of a dome is its outline
    nodes = presses["top"].arrays["section_node_mm"]
    away = np.linalg.norm(nodes - [10.0, 10.0, -10.0], axis=1)
    # Its lower edge is flat; a cut through the edges of elements is straight between them.
    assert away[nodes[:, 2] > -9.9].max() == pytest.approx(10.0, abs=0.02)
    assert np.ptp(nodes[:, 1]) < 1e-6


# ------------------------------------------------------------------------------------------------ surfaces from files
def write_block(folder, shift=(0.0, 0.0, 0.0)):
    """Write the small sensor's gel and its whole as STL files and return their names."""
    files = {}
    for name, (vertices, triangles) in zip(("gel", "skin"), block_solids(specimens.BLOCK).drafts):
        files[name] = str(folder / f"{name}.stl")
        meshio.write(files[name], meshio.Mesh(vertices + shift, [("triangle", triangles)]), binary=True)
    return {"shape": {"kind": "surfaces", "files": files}}


def test_a_block_from_files_presses_as_the_block_does(tmp_path):
    """Tetrahedra of the surfaces against hexahedra: 2 to 4 % on meshes of 0.6 mm."""
    sizes = {"near_mm": 0.6, "near_radius_mm": 2.0, "growth": 0.4, "far_mm": 1.2}
    cell = PlannedCell("a", *specimens.CENTRE, (0.4, 0.8))
    by_files, block = (
        simulate_cell(specimens.study(sensor=sensor, mesh=sizes), LAWS, cell).arrays["total_force_N"][-1]
        for sensor in (write_block(tmp_path), None)
    )
    assert by_files[2] == pytest.approx(block[2], rel=0.05)


def test_a_surface_that_does_not_fit_or_is_not_closed_is_refused(tmp_path):
    study = specimens.study(sensor=write_block(tmp_path, shift=(0.0, 3.0, 1.0)))
    with pytest.raises(ConfigError, match=r"set shape\.origin_mm: \[0\.0, 3\.0, 1\.0\], the corner"):
        simulate_cell(study, LAWS, PlannedCell("a", *specimens.CENTRE, (0.4,)))

    # An open or missing surface of a layer is named
    sensor = write_block(tmp_path)
    vertices, triangles = block_solids(specimens.BLOCK).drafts[0]
    meshio.write(tmp_path / "gel.stl", meshio.Mesh(vertices, [("triangle", triangles[1:])]), binary=True)
    with pytest.raises(ConfigError, match=r"gel\.stl: the surface is not closed: 3 open edges"):
        simulate_cell(specimens.study(sensor=sensor), LAWS, PlannedCell("a", *specimens.CENTRE, (0.4,)))
    (tmp_path / "skin.stl").unlink()
    with pytest.raises(ConfigError, match=r"skin\.stl'\] do not exist"):
        simulate_cell(specimens.study(sensor=sensor), LAWS, PlannedCell("a", *specimens.CENTRE, (0.4,)))
