"""One ball pressed into one layered block by FElupe: its own graded mesh, its own contact, every quantity by name."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import asdict, dataclass, replace

import felupe as fem
import numpy as np

from .ogden import Ogden

VERSION = 1  # of everything below; a change of the model makes all solutions anew
WALL = 1.0
GEL = ((7.9652e-3, 0.3093e-3), (1.2769, 3.5676))  # MPa; Sferrazza et al. 2019, table 1
SKIN = ((85.1168e-3, -0.0020e-3), (2.8991, -8.2915))
BULK_TO_SHEAR = 1000.0
PENALTY = 200.0  # N/mm^3; the ball sinks in by pressure / penalty, about 2e-4 mm
FILM = 0.3  # thickness of a film that has come off [mm]
CUBE = float(np.cbrt(np.pi / 6))  # half of the side of a cube as large as a ball, over the ball's radius
ROUNDED = 1.5  # no node moves from this distance on, over the radius: less than the way to the skin
UNDER = 2.4  # half of the even part of the mesh under the ball [mm]; contact reaches 2.9 mm from its middle
SHALLOW_STEP, DEEP_STEP = (
    0.4,
    0.2,
)  # of the ball to 0.8 mm and beyond [mm]: larger ones often have to be halved
ITERATIONS, TOLERANCE = 12, 1e-7


@dataclass(frozen=True)
class Ball:
    """A region of other stiffness: a ball, or (film) a disc of the film under the skin that keeps its bulk modulus.

    A ball is a cube of elements as large as it to which the mesh is bent: one that cuts elements is far too strong where it
    is hard.
    """

    centre_mm: tuple[float, float, float]  # from the sensor's middle, z from the top, down is negative
    radius_mm: float
    factor: float
    bulk: float | None = None  # the bulk modulus's own factor
    film: bool = False
    near_mm: float = 0.5  # largest element in it

    @property
    def half_mm(self) -> tuple[float, float, float]:
        """Return half of its extent along x, y, z before the mesh is bent."""
        if self.film:
            return self.radius_mm, self.radius_mm, FILM / 2
        return (CUBE * self.radius_mm,) * 3


@dataclass(frozen=True)
class Sizes:
    """Element sizes [mm]: under the ball, their growth per mm of distance, the largest; at the top and growth downward."""

    near: float
    growth: float
    largest: float
    top: float
    downward: float
    through_wall: int  # elements


COARSE = Sizes(0.6, 0.25, 1.6, 0.45, 0.1, 2)
MIDDLE = Sizes(0.5, 0.15, 1.2, 0.3, 0.05, 3)
FINE = Sizes(0.3, 0.08, 0.8, 0.2, 0.05, 3)


@dataclass(frozen=True)
class Setup:
    """Everything that decides one solution. The position is from the sensor's middle."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    depths_mm: tuple[float, ...] = (0.2, 0.4, 0.8, 1.2, 1.6, 1.85)
    sizes: Sizes = COARSE
    gel_mm: float = 4.0
    skin_mm: float = 1.0
    radius_mm: float = 5.0
    gel: float = 1.0  # factors on the moduli, bulk modulus included
    skin: float = 1.0
    wall: float = 1.0
    stiffening: float = 0.0  # Yeoh term of every layer over its shear modulus
    power: int = 2  # of that term
    neo_hooke: bool = False
    bulk_to_shear: float = BULK_TO_SHEAR
    gap: float = 1.0  # factor on a strip of the gel along the wall
    slab_MPa: float | None = None  # Young's modulus of a slab of 17 mm below
    friction: float = 0.0
    tangential: float = 100.0  # N/mm^3; a node slips by friction / this before it slides
    defect: Ball | None = None
    width_mm: float = 20.0

    @property
    def key(self) -> str:
        """Return the digest of everything that decides the solution."""
        described = asdict(self)
        if not self.friction:
            del described["tangential"]
        for later in ("power", "width_mm"):  # added since: keys of what was solved before stay as they are
            if described[later] == Setup.__dataclass_fields__[later].default:
                del described[later]
        text = json.dumps([VERSION, described], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:24]

    @property
    def halves(self) -> tuple[bool, bool]:
        """Return whether x and y of the sensor may be halved by mirror symmetry."""
        lone = self.defect is None
        return lone and self.x_mm == 0, lone and self.y_mm == 0


@dataclass(frozen=True)
class Curve:
    """What a solution says."""

    depths_mm: np.ndarray  # (D,)
    force_N: np.ndarray  # (D, 3) on the sensor
    area_mm2: np.ndarray  # (D,) of nodes in contact
    seconds: float  # of one core
    unknowns: int
    iterations: int


def press(setup: Setup) -> Curve:
    """Return the forces of the ball on the sensor, step by step; a step that fails is halved."""
    began = time.process_time()
    model = _Model(setup)
    forces, areas, iterations = [], [], 0
    for depth in setup.depths_mm:
        iterations += model.go_to(depth)
        forces.append(model.force())
        areas.append(model.area())
    return Curve(
        np.array(setup.depths_mm), np.array(forces), np.array(areas), time.process_time() - began,
        model.mesh.npoints * 3, iterations,
    )  # fmt: skip


class RigidBall(fem.mechanics.ContactRigidBase):
    """FElupe's contact with a ball; each node's penalty stands for the area that it has on the surface."""

    def __init__(self, field, points, centre, radius, area, **keys):
        self.radius, self.area = radius, area
        super().__init__(field, points, centre, **keys)

    def _kinematics(self, dx):
        distance = np.linalg.norm(dx, axis=1)
        normal = dx / distance[:, None]
        turn = (np.eye(3) - normal[:, :, None] * normal[:, None, :]) / distance[:, None, None]
        return distance - self.radius, normal, turn

    def _evaluate(self, field=None):
        trial = super()._evaluate(field)
        area = self.area[trial.contact]
        return trial._replace(
            force=trial.force * area[:, None], stiffness=trial.stiffness * area[:, None, None]
        )


class _Model:
    """Mesh, bodies and contact of a setup, with the state that has been reached."""

    def __init__(self, setup: Setup):
        self.setup = setup
        lines = _lines(setup)
        points, cells, middles = _grid(lines)
        if setup.defect is not None and not setup.defect.film:
            points = _rounded(points, cells[_in_cube(setup.defect, middles)], setup.defect)
        centre = [setup.x_mm, setup.y_mm, setup.radius_mm]
        self.mesh = fem.Mesh(np.vstack([points, centre]), cells, "hexahedron")
        region = fem.RegionHexahedron(self.mesh)
        self.mesh.points_without_cells = np.array([], dtype=int)
        self.field = fem.FieldContainer([fem.Field(region, dim=3)])
        self.solids = [_body(setup, self.mesh, cells, middles, name) for name in _regions(setup, middles)]
        self.solids = [body for body in self.solids if body is not None]
        top = np.flatnonzero(np.isclose(points[:, 2], 0.0))
        reach = np.hypot(points[top, 0] - setup.x_mm, points[top, 1] - setup.y_mm) < 1.1 * setup.radius_mm
        area = _areas(lines, points[top])
        friction = (
            {"friction": setup.friction, "multiplier_tangential": setup.tangential}
            if setup.friction
            else {"symmetric": True}
        )
        self.ball = RigidBall(
            self.field, top[reach], len(points), setup.radius_mm, area[reach], multiplier=PENALTY, **friction
        )
        held = np.zeros((len(points) + 1, 3), bool)
        held[:-1][np.isclose(points[:, 2], points[:, 2].min())] = True
        for axis, half in enumerate(setup.halves):
            if half:
                held[:-1, axis] |= np.isclose(points[:, axis], 0.0)
        held[-1] = True
        dof = np.arange(held.size)
        self.held, self.free = dof[held.ravel()], dof[~held.ravel()]
        self.solve = _solver()
        self.depth = 0.0

    def go_to(self, depth: float) -> int:
        """Bring the ball to a depth [mm] and return the iterations that it took."""
        pending, count = [depth], 0
        while pending:
            while pending[-1] - self.depth > (SHALLOW_STEP if pending[-1] <= 0.8 else DEEP_STEP) + 1e-9:
                pending.append((self.depth + pending[-1]) / 2)
            state = self._state()
            try:
                with np.errstate(all="ignore"):  # iterates that diverge are refused, and the step is halved
                    count += self._newton(pending[-1])
            except (fem.NewtonConvergenceError, np.linalg.LinAlgError):
                if pending[-1] - self.depth < 0.01:
                    raise
                self._restore(state)
                pending.append((self.depth + pending[-1]) / 2)
                continue
            self.depth = pending.pop()
        return count

    def force(self) -> np.ndarray:
        """Return the force (3,) [N] on the whole sensor."""
        total = np.asarray(self.ball.assemble.vector(self.field).todense()).reshape(-1, 3)[-1].copy()
        for axis, half in enumerate(self.setup.halves):
            if half:
                total *= 2
                total[axis] = 0.0
        return total  # of the ball on the gel: FElupe gives the centre what the ball must be pushed with

    def area(self) -> float:
        """Return the area [mm^2] of the nodes in contact."""
        whole = 2 ** sum(self.setup.halves)
        return float(whole * self.ball.area[self.ball.results.active].sum())

    def _newton(self, depth: float) -> int:
        items = [*self.solids, self.ball]
        values = np.zeros((self.mesh.npoints, 3))
        values[-1, 2] = -depth
        for item in items:
            item.field.link(self.field)
        found = fem.newtonraphson(
            x0=self.field, items=items, dof0=self.held, dof1=self.free, ext0=values.ravel()[self.held],
            tol=TOLERANCE, maxiter=ITERATIONS, verbose=0, solver=self.solve,
        )  # fmt: skip
        self.field[0].values[:] = found.x[0].values
        return found.iterations

    def _state(self):
        return self.field[0].values.copy(), [item.checkpoint() for item in (*self.solids, self.ball)]

    def _restore(self, state) -> None:
        self.field[0].values[:] = state[0]
        for item, saved in zip((*self.solids, self.ball), state[1]):
            item.field.link(self.field)
            item.restore(saved)


def _solver():
    """Return a sparse solver (A, b) -> x: PARDISO, or SuperLU where it is not installed."""
    try:
        from pypardiso import spsolve
    except ImportError:
        from scipy.sparse.linalg import spsolve
    return spsolve


def _lines(setup: Setup) -> list[np.ndarray]:
    """Return the mesh lines along x, y, z [mm]: fine under the ball, growing away."""
    h, half, inner = setup.sizes, setup.width_mm / 2, setup.width_mm / 2 - WALL
    sides = []
    for axis, (at, halved) in enumerate(zip((setup.x_mm, setup.y_mm), setup.halves)):
        breaks = [0.0, inner, half] if halved else [-half, -inner, inner, half]
        breaks = sorted([*breaks, *_edges(setup.defect, axis)])
        least = [h.through_wall if b - a <= WALL else 1 for a, b in zip(breaks, breaks[1:])]

        def size(x, at=at, axis=axis):
            under = h.near + h.growth * np.maximum(np.abs(x - at) - UNDER, 0)
            return np.minimum(np.minimum(under, h.largest), _size_at_defect(setup, axis, x))

        sides.append(_divided(breaks, size, least))
    total = setup.gel_mm + setup.skin_mm
    breaks = sorted([-total, *_edges(setup.defect, 2), -setup.skin_mm, 0.0])
    z = _divided(
        breaks,
        lambda z: np.minimum(h.top + h.downward * np.abs(z), _size_at_defect(setup, 2, z)),
        least=[1] * (len(breaks) - 2) + [2],
    )
    if setup.slab_MPa is not None:
        below = -total - 17.0 * np.array([1.0, 0.62, 0.34, 0.15, 0.05])
        z = np.concatenate([below, z])
    return [*sides, z]


def _edges(defect: Ball | None, axis: int) -> list[float]:
    """Return where the mesh needs lines along an axis: at both ends of a ball's cube, below a film."""
    if defect is None or (defect.film and axis < 2):
        return []
    ends = (-1,) if defect.film else (-1, 1)
    return [defect.centre_mm[axis] + end * defect.half_mm[axis] for end in ends]


def _in_cube(ball: Ball, middles) -> np.ndarray:
    """Return which elements (E,) a ball is made of."""
    return np.abs(middles - np.array(ball.centre_mm)).max(axis=1) < ball.half_mm[0]


def _rounded(points, cells, ball: Ball) -> np.ndarray:
    """Return nodes (N, 3) [mm] moved so that a cube of elements, `cells`, is a ball as large; farther away none moves."""
    away = points - np.array(ball.centre_mm)
    reach, half = np.abs(away).max(axis=1), ball.half_mm[0]
    far = ROUNDED * ball.radius_mm
    share = np.where(reach <= half, reach / half, np.clip((far - reach) / (far - half), 0, 1))
    length = np.maximum(np.linalg.norm(away, axis=1), 1e-12)

    def with_nodes_on(radius):
        on_ball = radius * reach / (half * length)  # times away: what lies on a cube lies on a ball
        return points + away * (share * (on_ball - 1))[:, None]

    inscribed = fem.RegionHexahedron(fem.Mesh(with_nodes_on(ball.radius_mm), cells, "hexahedron")).dV.sum()
    return with_nodes_on(ball.radius_mm * (4 / 3 * np.pi * ball.radius_mm**3 / inscribed) ** (1 / 3))


def _size_at_defect(setup: Setup, axis: int, x) -> np.ndarray:
    """Return the element size (n,) [mm] that a defect asks for at x (n,) along an axis; infinite without one."""
    if setup.defect is None:
        return np.full(np.shape(x), np.inf)
    beyond = np.abs(x - setup.defect.centre_mm[axis]) - setup.defect.half_mm[axis]
    return setup.defect.near_mm + setup.sizes.growth * np.maximum(beyond, 0)


def _divided(breaks, size, least) -> np.ndarray:
    """Return lines through all breaks, elements as long as size(x) asks."""
    lines = [np.array([breaks[0]])]
    for (a, b), fewest in zip(zip(breaks, breaks[1:]), least):
        x = np.linspace(a, b, 2001)
        count = np.concatenate([[0.0], np.cumsum((1 / size(x)[1:] + 1 / size(x)[:-1]) / 2 * np.diff(x))])
        n = max(fewest, int(np.ceil(count[-1] - 0.2)))
        lines.append(np.interp(np.linspace(0, count[-1], n + 1)[1:], count, x))
    return np.concatenate(lines)


def _grid(lines) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes (N, 3), hexahedra (E, 8) and their middles (E, 3) of lines along x, y, z."""
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    nx, ny, nz = (len(line) for line in lines)
    number = np.arange(nx * ny * nz).reshape(nx, ny, nz)
    corner = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cells = np.stack(
        [number[i : nx - 1 + i, j : ny - 1 + j, k : nz - 1 + k].ravel() for i, j, k in corner], axis=1
    )
    return points, cells, points[cells].mean(axis=1)


def _areas(lines, points) -> np.ndarray:
    """Return the area [mm^2] of each top node of the part that is meshed."""
    share = [np.convolve(np.diff(line), [0.5, 0.5]) for line in lines[:2]]
    at = [np.searchsorted(line, points[:, axis] - 1e-9) for axis, line in enumerate(lines[:2])]
    return share[0][at[0]] * share[1][at[1]]


def _regions(setup: Setup, middles) -> dict[str, np.ndarray]:
    """Return which elements (E,) are gel, skin, wall and slab."""
    inside = np.abs(middles[:, :2]).max(axis=1) < setup.width_mm / 2 - WALL
    skin = middles[:, 2] > -setup.skin_mm
    slab = middles[:, 2] < -setup.gel_mm - setup.skin_mm
    return {"gel": inside & ~skin & ~slab, "skin": skin, "wall": ~inside & ~skin & ~slab, "slab": slab}


def _body(setup: Setup, mesh, cells, middles, name: str):
    """Return FElupe's body of a region, or None where there is none."""
    mine = _regions(setup, middles)[name]
    if not mine.any():
        return None
    part = fem.Mesh(mesh.points, cells[mine], "hexahedron")
    region = fem.RegionHexahedron(part)
    part.points_without_cells = np.array([], dtype=int)
    field = fem.FieldContainer([fem.Field(region, dim=3)])
    mu, alpha = GEL if name == "gel" else SKIN
    whole = {"gel": setup.gel, "skin": setup.skin, "wall": setup.skin * setup.wall, "slab": 1.0}[name]
    if name == "slab":
        mu, alpha = (setup.slab_MPa / 3,), (2.0,)
    shear = sum(m * a for m, a in zip(mu, alpha)) / 2
    if setup.neo_hooke:
        mu, alpha = (shear,), (2.0,)
    X = np.einsum(
        "caj,aq->qcj", mesh.points[cells[mine]], region.h[:, :, 0] if region.h.ndim == 3 else region.h
    )
    factor = np.full(X.shape[:2], whole)
    bulk = np.full(X.shape[1], whole * shear * setup.bulk_to_shear)
    if name == "gel" and setup.gap != 1.0:
        strip = np.abs(X[..., :2]).max(axis=-1) > setup.width_mm / 2 - WALL - 0.5
        factor[strip] *= setup.gap
        bulk *= np.where(strip, setup.gap, 1.0).mean(axis=0)
    if setup.defect is not None and name != "slab":
        if setup.defect.film:
            factor[_in_film(setup.defect, X, setup.skin_mm)] *= setup.defect.factor
        else:
            within = _in_cube(setup.defect, middles[mine])
            factor[:, within] *= setup.defect.factor
            bulk[within] *= setup.defect.factor if setup.defect.bulk is None else setup.defect.bulk
    law = Ogden(mu, alpha, factor, setup.stiffening * shear * whole, setup.power)
    return fem.SolidBodyNearlyIncompressible(law, field, bulk=bulk)


def _in_film(defect: Ball, X, skin_mm: float) -> np.ndarray:
    """Return whether points (q, E, 3) lie in a disc of the film under the skin."""
    away, below = X - np.array(defect.centre_mm), -X[..., 2] - skin_mm
    return (np.hypot(away[..., 0], away[..., 1]) < defect.radius_mm) & (below > 0) & (below < FILM)


def moved(setup: Setup, x_mm: float, y_mm: float, **changes) -> Setup:
    """Return a setup at another position, with other changes."""
    return replace(setup, x_mm=x_mm, y_mm=y_mm, **changes)
