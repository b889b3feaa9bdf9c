"""Contact of quadratic tetrahedra next to known solutions: their corners carry no force, the middles of their edges all."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.indentation.cells.binning import node_areas
from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Cylinder, Sphere
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.reference_solutions import bonded_layer_at_radius, poissons_ratio
from gelforge.mechanics.solving.equilibrium import Press
from gelforge.verification.presses import spread_out

MU = 0.02  # MPa
LAWS = {"gel": Ogden((MU,), (2.0,))}


def test_flat_indenters_meet_one_pressure_and_layers_press_as_the_integral_equation_says(rng):
    # A flat indenter meets one pressure everywhere. The contact patch test: without lateral contraction (K/mu =
    # 2/3) and at small strain the block shortens evenly. Limits: rounding of the gap, 1e-16 of 20 mm times 20
    # N/mm^3, over a pressure of 2e-4 MPa, as for hexahedra
    height, depth = 2.0, 0.01
    even = layered_block(Block(4.0, 4.0, (("gel", height),)), 2.0, 2.0, Sizes(near=1.0, far=1.0))
    mesh = specimens.distorted(specimens.tetrahedral(even), 0.2, rng)
    settings = Settings(friction=0.0, force_tolerance=1e-12, gap_tolerance=1e-12)
    flat = Cylinder(radius=20.0, length=20.0, edge=1.0)
    press = Press(SmallStrainBody(mesh, LAWS, 2 / 3), flat, settings)
    (state,) = specimens.follow(press, (2.0, 2.0), [depth])
    pressure = 2 * MU * depth / height  # E depth / height, E = 2 mu (1 + nu), nu = 0
    force, area, top = -state.normal_force[:, 2], node_areas(mesh), mesh.surface.top
    assert (top & (area == 0)).sum() == 25 and (
        top & (area > 0)
    ).sum() == 56  # corners, edges of 32 triangles
    assert_allclose(force[top], pressure * area[top], atol=1e-9 * pressure)
    assert not force[~top].any()
    assert_allclose(state.u[:, 2], -depth * (1 + mesh.X[:, 2] / height), atol=1e-9 * depth)
    assert_allclose(state.u[:, :2], 0, atol=1e-9 * depth)

    # A layer as thick as the contact's radius is pressed as the integral equation says. Tetrahedra with 8 node
    # distances over the contact's radius, their outer part drawn out to 3 thicknesses. Force to 1 % as for
    # hexahedra (measured: -0.4 %), contact radius to one distance between nodes
    radius, bulk_to_shear, apart = 100.0, 1000.0, 1 / 8
    known = bonded_layer_at_radius(1.0, radius, 1.0, MU, poissons_ratio(bulk_to_shear))
    block = Block(5.0, 5.0, (("gel", 1.0),))
    even = layered_block(block, 2.5, 2.5, Sizes(near=2 * apart, far=2 * apart))
    mesh = specimens.tetrahedral(spread_out(even, np.array([2.5, 2.5, 0.0]), start=1.5, length=1.0))
    settings = Settings(friction=0.0, gap_tolerance=1e-6)
    press = Press(Body(mesh, LAWS, bulk_to_shear), Sphere(radius), settings)
    (state,) = specimens.follow(press, (2.5, 2.5), [known.depth])
    assert -state.force[2] == pytest.approx(known.force, rel=0.01)
    touched = node_areas(mesh)[state.contact_state > 0].sum()
    assert np.sqrt(touched / np.pi) == pytest.approx(1.0, abs=apart)
