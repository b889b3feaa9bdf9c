"""Small sensors and meshes on which the mechanics is verified: coarse, so that one press takes a fraction of a second."""

from dataclasses import replace

import numpy as np

from gelforge.config import study_from
from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Sphere
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.elements import TET10_FACES, lumped_area, quadratic_tetrahedra
from gelforge.mechanics.meshes.mesh import Block, Mesh, Sizes, Surface, layered_block
from gelforge.mechanics.solving.equilibrium import Press

GEL = Ogden((7.9652e-3, 0.3093e-3), (1.2769, 3.5676))  # MPa; Sferrazza et al. 2019, table 1
SKIN = Ogden((85.1168e-3, -0.0020e-3), (2.8991, -8.2915))
LAWS = {"gel": GEL, "skin": SKIN, "wall": SKIN, "flange": SKIN}

BLOCK = Block(16.0, 16.0, (("gel", 3.0), ("skin", 1.0)), wall=1.0)
SIZES = Sizes(near=1.0, near_radius=2.5, growth=0.3, far=2.0)  # halved once: some nodes hang
CENTRE, CORNER = (8.0, 8.0), (10.9, 10.3)
BALL = Sphere(5.0)

# Iterated until rounding decides: what still differs is the formulation, not the stopping rule.
TO_ROUNDING = Settings(force_tolerance=1e-11, gap_tolerance=1e-11, volume_tolerance=1e-12)


def press(position=CENTRE, settings=TO_ROUNDING, body=Body, bulk_to_shear=1000.0, block=BLOCK):
    """Return a press of the small sensor by the ball at a position [mm]."""
    return Press(body(layered_block(block, *position, SIZES), LAWS, bulk_to_shear), BALL, settings)


def follow(press, position, depths, start=None):
    """Return the states at these depths [mm] in turn."""
    start = start or press.start(*position)
    centres = press.indenter.start(*position) - np.outer(depths, [0.0, 0.0, 1.0])
    return list(press.follow(start, centres))


def box(n, length=1.0) -> Mesh:
    """Return a cube of n^3 elements of one region "gel", held at its base."""
    return layered_block(
        Block(length, length, (("gel", length),)),
        length / 2,
        length / 2,
        Sizes(near=length / n, far=length / n),
    )


def tetrahedral(mesh: Mesh) -> Mesh:
    """Return the mesh of quadratic tetrahedra, six (Kuhn's) in every hexahedron of a block without hanging nodes."""
    # From corner 0 along two edges and on to corner 6.
    paths = [(1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1)]
    corners = mesh.elements[:, [(0, a, b, 6) for a, b in paths]].reshape(-1, 4)
    X, elements = quadratic_tetrahedra(mesh.X, corners)
    faces = elements[:, TET10_FACES].reshape(-1, 6)
    _, first, uses = np.unique(np.sort(faces[:, :3]), axis=0, return_index=True, return_counts=True)
    faces = faces[first[uses == 1]]
    faces = faces[X[faces, 2].max(axis=1) > X[:, 2].min() + 1e-9]  # all but the base
    area = lumped_area(X, faces)
    nodes = np.flatnonzero(area)
    return Mesh(
        X=X,
        elements=elements,
        region=np.repeat(mesh.region, 6),
        regions=mesh.regions,
        fixed=X[:, 2] < X[:, 2].min() + 1e-9,
        surface=Surface(
            nodes,
            area[nodes],
            X[nodes, 2] > -1e-9,
            faces[(X[faces, 2] > -1e-9).all(axis=1)],
        ),
    )


def distorted(mesh: Mesh, share: float, rng: np.random.Generator, boundary: bool = False) -> Mesh:
    """Return the mesh with its inner nodes (and, if asked, all others) moved at random by up to share of the least edge."""
    if mesh.elements.shape[1] == 10:  # corners move, edges stay straight
        N = mesh.elements[:, :4].max() + 1
        corners = replace(mesh, X=mesh.X[:N], elements=mesh.elements[:, [0, 1, 1, 2, 3]])
        X, _ = quadratic_tetrahedra(distorted(corners, share, rng, boundary).X, mesh.elements[:, :4])
        return replace(mesh, X=X)
    edges = mesh.X[mesh.elements[:, [1, 3, 4]]] - mesh.X[mesh.elements[:, [0]]]
    shift = share * np.linalg.norm(edges, axis=-1).min() * rng.uniform(-1, 1, mesh.X.shape)
    inside = np.ones(len(mesh.X), bool)
    if not boundary:
        inside = ((mesh.X > mesh.X.min(axis=0) + 1e-9) & (mesh.X < mesh.X.max(axis=0) - 1e-9)).all(axis=1)
    X = mesh.X + shift * inside[:, None]
    return replace(
        mesh, X=X if mesh.ties is None else mesh.ties @ X
    )  # hanging nodes stay on their edges and faces


def study(plan=None, sensor=None, indenter=None, **mechanics):
    """Return the validated study of the small sensor; plan, sensor, indenter and mechanics override its keys."""
    block = {
        "width_x_mm": 16.0,
        "width_y_mm": 16.0,
        "layers": [
            {"name": "gel", "thickness_mm": 3.0, "material": "soft", "particle_volume_fraction": 0.02},
            {"name": "skin", "thickness_mm": 1.0, "material": "stiff"},
        ],
        "wall_mm": 1.0,
        "bins": {"nx": 10, "ny": 10},
    }
    mesh = {"near_mm": 1.0, "near_radius_mm": 2.5, "growth": 0.3, "far_mm": 2.0}
    parameters = {
        "soft": {"mu_kPa": [7.9652, 0.3093], "alpha": [1.2769, 3.5676]},
        "stiff": {"mu_kPa": [85.1168, -0.0020], "alpha": [2.8991, -8.2915]},
    }
    return study_from(
        {
            "study": "small",
            "materials": {name: {"parameters": value} for name, value in parameters.items()},
            "sensor": block | (sensor or {}),
            "indenter": indenter or {},
            "plan": plan or {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": [0.4, 0.8]},
            # The nodes alone press: on elements this large what is made up for their faces is no longer little.
            "mechanics": {"mesh": mesh, "contact": {"facets": 0.0}} | mechanics,
        }
    )


STUDY_LAWS = {"soft": GEL, "stiff": SKIN}

# What the package's own functions are given: one layer without a wall, a mesh that is solved in a fraction of a second.
ONE_LAYER = {
    "sensor": {
        "width_x_mm": 12,
        "width_y_mm": 12,
        "wall_mm": 0,
        "layers": [{"name": "gel", "thickness_mm": 4, "material": "gel"}],
        "bins": {"nx": 6, "ny": 4},
    },
    "materials": {"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    "indenter": {"kind": "sphere", "radius_mm": 3},
    "mechanics": {"mesh": {"near_mm": 1, "near_radius_mm": 2, "far_mm": 2}},
}


BETWEEN = {  # a study of labels between solved sites: one layer without a wall
    "study": "between",
    "materials": {"gel": {"parameters": {"mu_kPa": [8.0], "alpha": [2.0]}}},
    "sensor": {
        "width_x_mm": 32.0,
        "width_y_mm": 32.0,
        "layers": [{"name": "gel", "thickness_mm": 6.0, "material": "gel"}],
        "bins": {"nx": 20, "ny": 20},
    },
}
