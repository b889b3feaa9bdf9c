"""Faces between nodes on a curved indenter lie inside of it: by how much, and what making up for it wins."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.forces import facet_gap
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Box, Cylinder, Sphere
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import Press


def mean_distance(indenter, corners):
    """Return the mean distance [mm] by which a bilinear face through corners (2, 2, 3) lies inside an indenter."""
    points, weights = np.polynomial.legendre.leggauss(6)
    a = np.stack([1 - points, 1 + points]) / 2
    inside = np.einsum("ip,jq,ijk->pqk", a, a, corners).reshape(-1, 3)
    gap = indenter.gap(inside, np.zeros(3))[0].reshape(6, 6)
    return -np.einsum("p,q,pq->", weights, weights, gap) / 4


def test_it_is_the_mean_distance_of_flat_faces_and_none_of_curved_ones():
    # It is the mean distance of a face inside the indenter
    R, h = 20.0, 0.3
    along = np.array([-h / 2, h / 2])
    x, y = np.meshgrid(along, along, indexing="ij")
    corners = np.stack([x, y, -np.sqrt(R**2 - x**2 - y**2)], axis=-1)
    turn = Sphere(R).gap(corners[0, 0][None], np.zeros(3))[2]
    found = facet_gap(turn, np.array([h**2]))[0]
    assert_allclose(found, mean_distance(Sphere(R), corners), rtol=0.01)  # of h over R squared
    assert_allclose(facet_gap(turn, np.array([h**2 / 4]))[0], found / 4, rtol=0.01)

    # A flat face has none and a sharp bend little
    punch, centre, area = Box((4.0, 5.0, 8.0), 0.5), np.zeros(3), np.full(1, 0.09)
    below = punch.start(0.0, 0.0) * [1, 1, -1]  # the middle of its lower face
    assert facet_gap(punch.gap(below[None], centre)[2], area)[0] == 0.0
    for radius in (1.0, 0.1, 0.01):
        turn = np.eye(3)[None] / radius
        assert facet_gap(turn, area)[0] < 0.3 / 20  # a small part of the face's own size, however sharp

    # The side of a cylinder has half of a balls
    area = np.full(1, 0.01)
    ball = facet_gap(Sphere(3.0).gap(np.array([[0.0, 0.0, -3.0]]), np.zeros(3))[2], area)
    side = Cylinder(radius=3.0, length=8.0, edge=0.5).gap(np.array([[3.0, 0.0, 4.0]]), np.zeros(3))[2]
    assert_allclose(facet_gap(side, area), ball / 2, rtol=0.02)

    # Curved faces of tetrahedra get nothing. Their faces follow the ball between their corners
    mesh = layered_block(Block(4.0, 4.0, (("gel", 2.0),)), 2.0, 2.0, Sizes(near=1.0, far=1.0))
    for solid, expected in ((mesh, 0.75), (specimens.tetrahedral(specimens.box(2)), 0.0)):
        body = Body(solid, dict.fromkeys(solid.regions, NeoHooke(0.01)), 20.0)
        assert Press(body, Sphere(4.0), Settings(facets=0.75)).contact.facets == expected


@pytest.mark.parametrize("depth", [0.12, 0.24])
def test_the_force_at_first_touch_is_nearer_to_that_of_a_fine_mesh(depth):
    """With few nodes in contact the plain force is too small by a tenth; the correction leaves less than half of that."""

    def force(near, facets):
        mesh = layered_block(
            Block(12.0, 12.0, (("gel", 6.0),)),
            6.0,
            6.0,
            Sizes(near=near, near_radius=1.2, growth=0.3, far=2.0),
        )
        press = Press(
            Body(mesh, {"gel": NeoHooke(0.04)}, 100.0), Sphere(4.0), Settings(friction=0.0, facets=facets)
        )
        return specimens.follow(press, (6.0, 6.0), [depth])[0].force[2]

    fine = force(0.1, 0.75)
    plain, made_up = (abs(force(0.4, share) / fine - 1) for share in (0.0, 0.75))
    assert made_up < 0.5 * plain
