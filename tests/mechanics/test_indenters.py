"""Indenters: one battery for every shape (a new one enters by one line), and what is refused.

The normal is the gradient of the gap and the turn that of the normal, by rates; the gap is the distance to the surface,
inside and outside, found by looking everywhere.
"""

from runpy import run_path

import numpy as np
import pytest
import solids
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from gelforge.mechanics.indenters.closed_surface import ClosedSurface, SurfaceError, closed_surface
from gelforge.mechanics.indenters.shapes import (
    Box,
    Cylinder,
    Several,
    Sphere,
    Turned,
    rotation_about_axes,
    rotation_of,
)


def guides_example():
    """Return the capsule that docs/adding/indenter.md shows."""
    return run_path("docs/adding/examples/capsule.py")["Capsule"](2.0, 7.0)


TILT = rotation_about_axes((12.0, -7.0, 30.0))
INDENTERS = {
    "small ball": Sphere(2.0),
    "ball": Sphere(5.0),
    "cylinder": Cylinder(3.0, 8.0, 0.5),
    "cylinder with a round end": Cylinder(2.0, 6.0, 1.9),
    "tilted cylinder": Turned(Cylinder(3.0, 8.0, 0.5), TILT),
    "box": Box((6.0, 3.0, 4.0), 0.4),
    "tilted box": Turned(Box((6.0, 3.0, 4.0), 0.4), TILT),
    "capsule of the guide": guides_example(),
    "two balls": Several((Sphere(2.0), Sphere(3.0)), np.array([[-4.0, 0.0, 2.0], [3.0, 1.0, 3.2]])),
    "ball and box": Several(
        (Sphere(2.0), Turned(Box((3.0, 3.0, 3.0), 0.3), TILT)), np.array([[-4.0, 0.0, 2.0], [3.0, 1.0, 0.5]])
    ),
    "surface, sharp L": closed_surface(*solids.l_shape()),
    "surface, rounded L": closed_surface(*solids.l_shape(), edge=0.3),
    "surface, ball": closed_surface(*solids.ball(3.0), edge=0.3),
    "surface, blunted cone": Turned(closed_surface(*solids.cone(3.0, 5.0), edge=0.3), TILT),
}
CENTRE = np.array([1.0, -2.0, 3.0])


@pytest.fixture(params=INDENTERS.values(), ids=INDENTERS.keys())
def indenter(request):
    return request.param


@pytest.fixture
def rng():
    return np.random.default_rng(2)


def cloud(indenter, rng, count=60):
    """Return points on both sides of the surface, within 0.8 mm of it."""
    surface = indenter.outline[rng.integers(len(indenter.outline), size=count)]
    return CENTRE + surface + rng.uniform(-0.45, 0.45, (count, 3))


def smooth(indenter, points, step):
    """Return which points keep 20 steps from where the gap has a kink: the normal turns there as the turn says."""
    kept = np.ones(len(points), bool)
    for move in [*np.eye(3), *-np.eye(3), *(np.ones((1, 3)) / 2)]:
        _, normal, turn = indenter.gap(points, CENTRE)
        there = indenter.gap(points + 20 * step * move, CENTRE)[1]
        kept &= np.abs(there - normal - 20 * step * turn @ move).max(axis=1) < 40 * step
    return kept


def halving_rates(value, slope):
    """Return the rates with which |value(h) - value(0) - h slope| falls as h is halved, and the largest remainder."""
    steps = 1e-3 * 0.5 ** np.arange(4)
    remainder = [np.abs(value(h) - value(0) - h * slope).max() for h in steps]
    return np.log2(np.divide(remainder[:-1], remainder[1:])), max(remainder)


def test_start_touches_the_undeformed_top_from_above(indenter):
    """The lowest point lies at z = 0: a dense cloud of the surface ends there, the gap just below is the distance to it."""
    centre = indenter.start(4.0, 7.0)
    assert_allclose(centre[:2], [4.0, 7.0])
    x, y = np.meshgrid(np.linspace(-3, 11, 141), np.linspace(0, 14, 141))
    plane = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)
    gap = indenter.gap(plane, centre)[0]
    best = plane[gap.argmin()]
    found = minimize(
        lambda p: indenter.gap(np.array([[*p, 0.0]]), centre)[0][0], best[:2], method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-12},
    )  # fmt: skip
    assert found.fun == pytest.approx(0.0, abs=1e-8)  # the search's own accuracy
    assert gap.min() > -1e-12


def test_normals_are_unit_vectors_with_their_foot_on_the_surface(indenter, rng):
    points = cloud(indenter, rng)
    _, normal, turn = indenter.gap(points, CENTRE)
    assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-13)
    scale = 1 + np.abs(turn).max(axis=(1, 2))
    assert (np.abs(np.einsum("nij,nj->ni", turn, normal)).max(axis=1) < 1e-11 * scale).all()
    assert (np.abs(turn - turn.transpose(0, 2, 1)).max(axis=(1, 2)) < 1e-11 * scale).all()

    # The foot lies on the surface and the outline too
    gap, normal, _ = indenter.gap(points, CENTRE)
    assert (gap > 0).sum() > 10
    assert (gap < 0).sum() > 10
    # Inside its rounding a surface's foot is that of its core: the same on faces, not at concave edges and corners.
    shape = getattr(indenter, "shape", indenter)
    kept = (gap > 0) | (not isinstance(shape, ClosedSurface)) | (getattr(shape, "edge", 1.0) == 0)
    assert_allclose(indenter.gap(points - gap[:, None] * normal, CENTRE)[0][kept], 0, atol=1e-12)
    assert np.abs(indenter.distance(indenter.outline)[0]).max() < 1e-12


def test_normal_and_turn_are_gradients(indenter, rng):
    points, direction = cloud(indenter, rng), rng.normal(size=(60, 3))
    points, direction = (a[smooth(indenter, points, 1e-3)] for a in (points, direction))
    assert len(points) > 30
    slope = np.einsum("ni,ni->n", indenter.gap(points, CENTRE)[1], direction)
    rates, largest = halving_rates(lambda h: indenter.gap(points + h * direction, CENTRE)[0], slope)
    assert largest < 1e-13 or (np.abs(rates - 2) < 0.1).all(), (
        rates
    )  # second order, unless all faces are flat

    # Turn is the gradient of the normal
    slope = np.einsum("nij,nj->ni", indenter.gap(points, CENTRE)[2], direction)
    rates, largest = halving_rates(lambda h: indenter.gap(points + h * direction, CENTRE)[1], slope)
    assert largest < 1e-12 or (np.abs(rates - 2) < 0.1).all(), rates


# What an inset changes: concave edges keep a triangle's width of gap, a ball's facets are rounded about their corners.
BY_DEFINITION = {
    "small ball": lambda p: np.linalg.norm(p, axis=-1) - 2.0,
    "cylinder": lambda p: _rounded_profile(np.hypot(p[..., 0], p[..., 1]), p[..., 2]),
}


def _rounded_profile(rho, z):
    """Return the distance to a dense profile of the cylinder of radius 3, length 8, edge 0.5 mm, by looking everywhere."""
    arc = np.linspace(0, np.pi / 2, 2001)
    corner = [(2.5 + 0.5 * np.sin(arc), h + s * 0.5 * np.cos(arc)) for h, s in ((0.5, -1), (7.5, 1))]
    flat = np.linspace(-2.5, 2.5, 20001)
    side = np.linspace(0.5, 7.5, 20001)
    profile = np.concatenate(
        [np.stack(c, -1) for c in corner]
        + [np.stack([np.abs(flat), np.full_like(flat, z0)], -1) for z0 in (0, 8)]
        + [np.stack([np.full_like(side, 3.0), side], -1)]
    )
    inside = (z > 0) & (z < 8) & (rho < 3)
    corner_z = np.where(z < 4, 0.5, 7.5)
    in_corner = (rho > 2.5) & (np.abs(z - 4) > 3.5)
    inside &= ~(in_corner & (np.hypot(rho - 2.5, z - corner_z) > 0.5))
    d = np.array([np.hypot(*(profile - q).T).min() for q in np.stack([rho, z], -1)])
    return np.where(inside, -d, d)


@pytest.mark.parametrize("name", BY_DEFINITION)
def test_gap_is_the_distance_to_a_dense_sampling(name, rng):
    indenter = INDENTERS[name]
    low, high = indenter.outline.min(axis=0) - 1, indenter.outline.max(axis=0) + 1
    points = rng.uniform(low, high, (200, 3))
    gap = indenter.distance(points)[0]
    assert (gap < 0).sum() > 20
    assert_allclose(
        gap, BY_DEFINITION[name](points), atol=1e-6
    )  # samples 4e-4 mm apart: (4e-4)^2 / (2 distance)


@pytest.mark.parametrize(
    "solid", [solids.l_shape(), solids.ball(3.0, 8), solids.cone(2.0, 3.0)], ids="L ball cone".split()
)
def test_a_surfaces_gap_is_the_distance_to_all_its_triangles(solid, rng):
    """Every triangle is sampled densely; inside is where rays cross the surface an odd number of times (winding number)."""
    vertices, triangles = solid
    body = closed_surface(vertices, triangles)
    points = rng.uniform(vertices.min(axis=0) - 1, vertices.max(axis=0) + 1, (100, 3))
    n = 60
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
    weight = np.stack([n - i - j, i, j], -1)[i + j <= n] / n
    samples = np.einsum("wk,tki->twi", weight, vertices[triangles]).reshape(-1, 3)
    spacing = np.linalg.norm(np.ptp(vertices, axis=0)) / n
    nearest = np.array([np.linalg.norm(samples - p, axis=1).min() for p in points])
    a, b, c = (
        vertices[triangles[:, k]] - points[:, None] for k in range(3)
    )  # solid angles: van Oosterom & Strackee
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    dots = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    inside = np.rint(2 * np.arctan2((np.cross(a, b) * c).sum(-1), dots).sum(axis=1) / (4 * np.pi)) != 0
    gap = body.distance(points)[0]
    assert 3 < inside.sum() < 97
    assert np.array_equal(gap < 0, inside)
    assert (np.abs(gap) <= nearest + 1e-12).all()
    assert (np.abs(gap) >= nearest - spacing).all()  # no sample of a triangle is further than its spacing
    assert np.median(nearest - np.abs(gap)) < 0.05 * spacing


def test_surfaces_of_a_block_and_of_a_ball_are_the_box_and_the_ball(rng):
    """Faces moved in and widened again: the same body as the box with rounded edges, inside and out."""
    box, surface = Box((6.0, 3.0, 4.0), 0.4), closed_surface(*solids.block(6.0, 3.0, 4.0), edge=0.4)
    points = rng.uniform([-4, -3, -1], [4, 3, 5], (500, 3))
    found, known = surface.distance(points), box.distance(points)
    assert_allclose(found[0], known[0], atol=1e-12)
    one = smooth_inside(box, points)  # on the medial surfaces two faces are as near
    assert one.sum() > 400
    assert_allclose(found[1][one], known[1][one], atol=1e-9)
    assert_allclose(found[2][one], known[2][one], atol=1e-7)
    for depth in (0.1, 1.0):
        assert_allclose(
            surface.footprint(depth)[0], box.footprint(depth)[0], atol=0.1
        )  # outlines 0.1 mm apart

    # Chords of triangles cut the ball by R (1 - cos(half an angle)): halving the angle quarters the
    # error.
    points = np.random.default_rng(5).uniform(-4, 4, (200, 3))
    exact = Sphere(3.0).distance(points)[0]
    errors = [
        np.abs(closed_surface(*solids.ball(3.0, n), edge=0.3).distance(points)[0] - exact).max()
        for n in (8, 16, 32)
    ]
    assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.25)


def smooth_inside(box, points):
    """Return which points are not within 1e-3 mm of a change between faces, edges and corners of the box."""
    q = np.abs(points - box._middle) - box._core
    two = np.sort(q, axis=1)
    return (np.abs(q) > 1e-3).all(axis=1) & ((two[:, 2] > 0) | (two[:, 2] - two[:, 1] > 1e-3))


def test_support_outline_and_rigid_motion_agree(indenter, rng):
    # Support and outline agree
    for direction in rng.normal(size=(20, 3)):
        furthest = (indenter.outline @ direction).max() if not isinstance(indenter, Sphere) else None
        if furthest is not None:
            slack = 0.2 * indenter.size * np.linalg.norm(direction)  # the outline's own spacing
            assert indenter.support(direction) - slack < furthest <= indenter.support(direction) + 1e-9

    # Rigid motion carries gap normal and turn along
    points = cloud(indenter, rng)
    vector = np.array([0.3, -0.2, 0.5])
    R, shift = rotation_of(vector), np.array([0.4, 2.0, -1.0])
    gap, normal, turn = indenter.gap(points, CENTRE)
    moved = (points - CENTRE) @ R.T + CENTRE + shift
    g, n, t = indenter.gap(moved, np.concatenate([CENTRE + shift, vector]))
    assert_allclose(g, gap, atol=1e-12)
    one = np.abs(n - normal @ R.T).max(axis=1) < 1e-6  # a point as near to two faces may choose the other one
    assert one.mean() > 0.9
    assert_allclose(t[one], (R @ turn @ R.T)[one], atol=1e-6 * (1 + np.abs(turn[one]).max()))


def test_footprint_covers_what_a_flat_plane_touches_at_half_the_depth(indenter):
    """Hertz: a ball touches as far out as it cuts the plane at half the depth. And not much more is covered."""
    for depth in (0.2, 1.0):
        centre = indenter.start(0.0, 0.0)
        x, y = np.meshgrid(np.linspace(-9, 9, 361), np.linspace(-9, 9, 361))
        plane = np.stack([x.ravel(), y.ravel(), np.full(x.size, depth / 2)], axis=-1)
        inside = plane[indenter.gap(plane, centre)[0] < 0]
        discs = indenter.footprint(depth)
        distance = np.linalg.norm(inside[:, None, :2] - discs[None, :, :2], axis=-1) - discs[:, 2]
        assert (distance.min(axis=1) < indenter.size / 32).all()  # the outline's own spacing
        reach = np.hypot(discs[:, 0], discs[:, 1]) + discs[:, 2]
        # a disc around a half-moon reaches 1.4 times as far; 1.1 for the larger depth, 1.1 for the margin
        assert reach.max() < 1.7 * np.hypot(*inside[:, :2].T).max() + 0.2


def test_reach_is_the_widest_part_and_the_vertical_gap_straight_up(rng):
    # Reach is the height of the widest part
    assert Sphere(2.0).reach == 2.0
    assert Cylinder(3.0, 8.0, 0.5).reach == pytest.approx(
        7.5, abs=0.3
    )  # samples of the outline, 0.25 mm apart
    two = INDENTERS["two balls"]  # the second ball's lowest point lies 0.2 mm higher
    assert two.reach == pytest.approx(2.0)

    # Vertical gap measures straight up to the ball
    indenter = Sphere(5.0)
    ray = rng.normal(size=(50, 3)) - [0, 0, 1.5]
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    centre = CENTRE
    points = centre + ray * indenter.radius * rng.uniform(0.9, 1.3, (50, 1))
    gap, normal, turn = indenter.vertical_gap(points, centre)
    below = np.linalg.norm(points[:, :2] - centre[:2], axis=1) < indenter.radius
    assert 10 < below.sum() < len(points)
    lifted = points[below] + gap[below][:, None] * [0, 0, 1]
    assert_allclose(np.linalg.norm(lifted - centre, axis=1), indenter.radius, rtol=1e-13)
    assert (lifted[:, 2] <= centre[2]).all()
    assert_allclose(gap[~below], centre[2] - points[~below, 2])
    assert (normal == [0, 0, -1]).all()
    assert not turn.any()


# ------------------------------------------------------------------------------------------- surfaces refused
def test_surfaces_that_cannot_be_are_refused_or_put_right():
    vertices, triangles = solids.block(2.0, 2.0, 2.0)
    with pytest.raises(SurfaceError, match=r"not closed: 3 open edges.*close the holes"):
        closed_surface(vertices, triangles[1:])

    # A surface whose triangles disagree is refused
    triangles[0] = triangles[0, ::-1]
    with pytest.raises(SurfaceError, match=r"opposite ways at 3 edges"):
        closed_surface(vertices, triangles)

    # A surface inside out and with doubled corners is put right
    vertices, triangles = solids.block(2.0, 2.0, 2.0)
    soup = vertices[triangles[:, ::-1]].reshape(-1, 3)  # as an STL file holds it
    body = closed_surface(soup, np.arange(len(soup)).reshape(-1, 3))
    assert len(body.vertices) == 8
    assert body.distance(np.array([[0.0, 0.0, 0.7], [0.0, 0.0, 3.0]]))[0] == pytest.approx([-0.7, 1.0])

    # An edge rounder than the body is thick is refused
    with pytest.raises(
        SurfaceError, match=r"triangles turn over when edges are rounded by 0.6 mm.*smaller edge_radius_mm"
    ):
        closed_surface(*solids.block(4.0, 4.0, 1.0), edge=0.6)
