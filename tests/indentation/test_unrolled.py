"""A dome's bins along its surface: equal areas, no force lost, there and back."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import dblquad

from gelforge.config import Bins, Layer, Mesh, Sensor, Shape
from gelforge.indentation.cells.binning import bin_forces, node_areas, node_shares, surface_shares
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.indentation.sensor.unrolled import bin_points, place_in_bins, rolled, unrolled

rng = np.random.default_rng(4)
NX, NY = 6, 5


def dome(width_x, width_y, height, over="surface"):
    return Sensor(
        width_x_mm=width_x,
        width_y_mm=width_y,
        shape=Shape(kind="dome"),
        layers=[Layer(name="gel", thickness_mm=height, material="soft")],
        wall_mm=0.0,
        bins=Bins(nx=NX, ny=NY, over=over),
    )


DOMES = {
    "half ball": dome(20.0, 20.0, 10.0),
    "almost a half ball": dome(20.0, 20.0, 10.0001),
    "flat": dome(20.0, 20.0, 3.0),
    "high, of an ellipse": dome(20.0, 14.0, 16.0),
}


@pytest.fixture(params=DOMES.values(), ids=DOMES.keys())
def sensor(request):
    return request.param


def test_places_come_back(sensor):
    places = rng.uniform(0, 1, (500, 2)) * [sensor.width_x_mm, sensor.width_y_mm]
    points = rolled(sensor, places)
    half = np.array([sensor.width_x_mm / 2, sensor.width_y_mm / 2, sensor.height_mm])
    assert_allclose((((points + [0, 0, half[2]]) / half - [1, 1, 0]) ** 2).sum(axis=1), 1, rtol=1e-12)
    assert_allclose(unrolled(sensor, points), places, atol=1e-8)
    top = unrolled(sensor, np.array([half[0], half[1], 0.0]))
    assert_allclose(top, half[:2], atol=1e-12)


def test_equal_parts_of_the_rectangle_are_equal_areas_of_the_surface(sensor):
    """Drawn on the surface by a fine grid of the rectangle; the whole is the half-ellipsoid's area by quadrature."""
    n = 60  # parts of a bin along each side; triangles of a 1/300 of the dome miss 1e-4 of the area of what they span
    x, y = np.linspace(0, sensor.width_x_mm, n * NX + 1), np.linspace(0, sensor.width_y_mm, n * NY + 1)
    X = rolled(sensor, np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    area = np.linalg.norm(np.cross(X[1:, 1:] - X[:-1, :-1], X[1:, :-1] - X[:-1, 1:]), axis=-1) / 2
    of_bins = area.reshape(NX, n, NY, n).sum(axis=(1, 3))
    assert_allclose(of_bins, of_bins.mean(), rtol=2e-3)
    a, b, c = sensor.width_x_mm / 2, sensor.width_y_mm / 2, sensor.height_mm

    def element(phi, theta):
        k = (c * np.cos(theta) / a) ** 2 + (c * np.sin(theta) / b) ** 2
        return a * b * np.sin(phi) * np.sqrt(np.cos(phi) ** 2 + k * np.sin(phi) ** 2)

    whole, _ = dblquad(element, 0, 2 * np.pi, 0, np.pi / 2)
    assert_allclose(of_bins.sum(), whole, rtol=2e-3)


@pytest.fixture(scope="module")
def mesh():
    return sensor_mesh(DOMES["half ball"], Mesh(near_mm=1.0, near_radius_mm=2.0, far_mm=2.0), 10.0, 10.0)


@pytest.mark.parametrize("rule", [surface_shares, node_shares])
def test_nodal_forces_are_all_in_the_bins(mesh, rule):
    forces = rng.normal(size=(2, len(mesh.surface.nodes), 3))
    found = bin_forces(forces, rule(mesh, DOMES["half ball"]))
    assert_allclose(found.sum(axis=1), forces[:, mesh.surface.top].sum(axis=1), atol=1e-12)


def test_a_uniform_pressure_fills_bins_along_the_surface_alike_and_bins_seen_from_above_not(mesh):
    """Forces of a uniform pressure of 1 MPa. Bins at the rim lack the faces that are held there, of 1 to 2 mm."""
    lengths = node_areas(mesh)
    inside = np.zeros((NY, NX), bool)
    inside[1:-1, 1:-1] = True
    along = surface_shares(mesh, DOMES["half ball"]) @ lengths
    assert_allclose(
        along[inside.ravel()], 2 * np.pi * 10.0**2 / (NX * NY), rtol=0.03
    )  # faces are cut by quadrature
    above = surface_shares(mesh, dome(20.0, 20.0, 10.0, "plan")) @ lengths
    assert above.max() > 7 * above.min()
    assert_allclose(above.sum(), along.sum(), rtol=1e-12)


def test_the_centre_of_a_bin_is_in_it_and_files_are_not_unrolled():
    sensor = DOMES["high, of an ellipse"]
    points = bin_points(sensor)
    places = np.array([place_in_bins(sensor, x, y) for x, y, _ in points])
    index = np.floor(places / [sensor.width_x_mm, sensor.width_y_mm] * [NX, NY]).astype(int)
    assert (index[:, 1] * NX + index[:, 0] == np.arange(NX * NY)).all()

    # Surfaces from files are not unrolled
    layers = [Layer(name="gel", thickness_mm=2.0, material="soft")]
    shape = Shape(kind="surfaces", files={"gel": "gel.stl"})
    with pytest.raises(ValueError, match="surface unrolls a dome"):
        Sensor(shape=shape, layers=layers, bins=Bins(over="surface"))
