"""Forces follow moduli and lengths in proportion: no constant of contact, step or tolerance has a unit.

With K/mu and friction kept, moduli times c give forces times c at every node, and lengths times c forces times c^2.
Powers of two scale without rounding; at other factors the iterations round differently, and end within their stopping rule.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Sphere
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import Press

CENTRE = specimens.CENTRE
INDENTERS = {
    "ball": {"kind": "sphere", "radius_mm": 5.0},
    "flat cylinder": {"kind": "cylinder", "radius_mm": 2.0, "length_mm": 6.0, "edge_radius_mm": 0.3},
    "box turned": {
        "kind": "box", "size_mm": [4.0, 3.0, 5.0], "edge_radius_mm": 0.5, "orientation_deg": [4.0, -3.0, 30.0],
    },
    "ridge": {"kind": "mesh", "file": "config/indenters/wedge.stl", "edge_radius_mm": 0.6},
    "two balls": {
        "kind": "several",
        "parts": [
            {"kind": "sphere", "radius_mm": 3.0, "offset_mm": [-2.5, 0.0, 0.0]},
            {"kind": "sphere", "radius_mm": 3.0, "offset_mm": [2.5, 0.0, 0.2]},
        ],
    },
}  # fmt: skip
# (depth mm, shear mm, phase): down, sideways, turned back, up
PATH = [
    (0.3, (0.0, 0.0), "load"), (0.6, (0.0, 0.0), "load"), (0.6, (0.2, 0.1), "shear"), (0.6, (0.1, 0.1), "shear"),
    (0.3, (0.1, 0.1), "unload"),
]  # fmt: skip
LENGTHS = ("radius_mm", "length_mm", "edge_radius_mm", "size_mm", "offset_mm", "mm_per_unit", "thickness_mm")


def scaled(value, factor):
    """Return a description with every length multiplied."""
    if isinstance(value, dict):
        return {
            key: np.multiply(item, factor).tolist() if key in LENGTHS else scaled(item, factor)
            for key, item in value.items()
        }
    return [scaled(item, factor) for item in value] if isinstance(value, list) else value


def bins(indenter, modulus=1.0, length=1.0, **mechanics):
    """Return the bin forces (D, B, 3) of the small sensor along the path."""
    indenter = {"mm_per_unit": 1.0} | indenter if indenter["kind"] == "mesh" else indenter
    mesh = {"near_mm": 1.0, "near_radius_mm": 2.5, "far_mm": 2.0}
    mesh = {name: length * value for name, value in mesh.items()} | {"growth": 0.3}
    layers = [
        {"name": "gel", "thickness_mm": 3.0, "material": "soft"},
        {"name": "skin", "thickness_mm": 1.0, "material": "stiff"},
    ]
    sensor = {
        "width_x_mm": 16.0 * length,
        "width_y_mm": 16.0 * length,
        "wall_mm": length,
        "layers": scaled(layers, length),
    }
    study = specimens.study(
        sensor=sensor, indenter=scaled(indenter, length), mesh=mesh, error_bars=False, **mechanics
    )
    laws = {
        name: Ogden(tuple(modulus * mu for mu in law.mu), law.alpha)
        for name, law in specimens.STUDY_LAWS.items()
    }
    depths, shears, phases = zip(*PATH)
    planned = PlannedCell(
        "site",
        *(length * np.array(specimens.CORNER)),
        tuple(length * depth for depth in depths),
        phases=phases,
        shears_mm=tuple((length * x, length * y) for x, y in shears),
    )
    cell = simulate_cell(study, laws, planned)
    assert cell.converged, cell.attributes["reason"]
    return cell.arrays["bin_force_N"]


@pytest.mark.thorough(but_first=3)
@pytest.mark.parametrize("indenter", INDENTERS.values(), ids=INDENTERS.keys())
def test_forces_follow_moduli_and_lengths(indenter):
    known = bins(indenter)
    largest = np.abs(known).max()
    for modulus, limit in [(25.0, 1e-5), (1 / 25, 1e-5), (1 / 16, 1e-6)]:
        assert_allclose(bins(indenter, modulus) / modulus, known, atol=limit * largest, rtol=0)
    assert_allclose(bins(indenter, length=10.0) / 100.0, known, atol=1e-5 * largest, rtol=0)


@pytest.mark.parametrize(
    "mechanics",
    [
        {"strain": "small"},
        {"solver": {"linear_solver": "superlu"}},
        {"friction": 1.5},
        {"bulk_to_shear": 16.3},  # nu = 0.47
    ],
    ids=lambda keys: next(iter(keys)),
)
def test_they_do_whatever_the_model(mechanics):
    ball = INDENTERS["ball"]
    known = bins(ball, **mechanics)
    for modulus, limit in [(25.0, 1e-5), (16.0, 1e-6)]:
        found = bins(ball, modulus, **mechanics) / modulus
        assert_allclose(found, known, atol=limit * np.abs(known).max(), rtol=0)


@cache
def pressed(kind, modulus):
    """Return the nodal forces over the modulus of a block of either element, pressed and sheared."""
    mesh = layered_block(specimens.BLOCK, *CENTRE, Sizes(near=2.0, near_radius=2.5, far=2.0))
    mesh = specimens.tetrahedral(mesh) if kind == "tetrahedra" else mesh
    laws = {name: Ogden((modulus,), (2.0,)) for name in mesh.regions}
    press = Press(Body(mesh, laws, 100.0), Sphere(5.0), replace(Settings(), force_tolerance=1e-8))
    start = press.start(*CENTRE)
    path = start.centre + np.array([[0, 0, -0.4], [0, 0, -0.8], [0.2, 0.1, -0.8]])
    state = list(press.follow(start, path))[-1]
    return (state.normal_force + state.friction_force) / modulus


@pytest.mark.thorough(but_first=3)  # both elements, and a soft and a stiff gel
@pytest.mark.parametrize(
    ("kind", "shear_kPa"),
    [("hexahedra", 10.0), ("hexahedra", 4000.0), ("tetrahedra", 4000.0), ("tetrahedra", 10.0)],
)
def test_soft_and_stiff_gels_of_either_element(kind, shear_kPa):
    known = pressed(kind, 0.064)
    assert_allclose(pressed(kind, shear_kPa * 1e-3), known, atol=1e-6 * np.abs(known).max(), rtol=0)
