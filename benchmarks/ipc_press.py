"""One press in gelforge and with incremental potential contact (ipctk), forces side by side: docs/results/ipc.md.

usage: python benchmarks/ipc_press.py [--ours 1.0 0.5] [--theirs 1.4 1.0] [--dhat 0.1 0.03 0.01] [--friction 0 0.5] [--quick]

A block of the size of a GelSight Mini's gel, bonded below, pressed at its middle by a rigid ball in equal steps. Both codes
have the same energy per undeformed volume, mu/2 (J^(-2/3) I_1 - 3) + K/2 (J - 1)^2 (ours with the mean volume ratio of
each element), and the same path. Theirs here: quadratic tetrahedra on a quarter of the block, a Newton iteration with
projected Hessians and collision-free steps (Li et al. 2020, doi 10.1145/3386569.3392425), barrier and friction potentials of
ipctk (https://ipctk.xyz, MIT). Needs ipctk, which is no part of gelforge: pip install ipctk. Prints a Markdown table, one
thread; --quick: one coarse mesh and one depth, to see that it runs.
"""
# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import pandas as pd
import scipy.sparse as sp

WIDTH_X, WIDTH_Y, HEIGHT = 20.75, 25.25, 4.0  # mm
RADIUS = 7.5  # mm
MU, BULK_TO_SHEAR = 0.145, 20.0  # MPa, -
DEPTHS, STEP = (0.4, 0.7, 1.0), 0.1  # mm
NEAR_RADIUS, FAR = 4.5, 2.0  # mm: where elements are small, and how large they become
FIRST_GAP = 1.5  # of dhat, between the ball and the block at the start
TOLERANCE_N = 1e-5  # largest unbalanced force of a node
EPS_SLIP = 1e-3  # mm of a step below which friction grows in proportion to slip
MOST_ITERATIONS, MOST_LAGS = 80, 8
SMALLEST_J = 0.05
BARRIER_MPA = 0.5  # stiffness of the barrier: some three times the shear modulus


# ------------------------------------------------------------------------------------- quadratic tetrahedra
@dataclass(frozen=True)
class Solid:
    """Quadratic tetrahedra: nodes, elements, gradients of the shape functions and weights at four points of each."""

    X: np.ndarray  # (N, 3) [mm]
    elements: np.ndarray  # (E, 10)
    gradient: np.ndarray  # (E, Q, 10, 3) [1/mm]
    weight: np.ndarray  # (E, Q) [mm^3]
    slots: np.ndarray  # (E * 900,) into the values of the pattern
    indices: np.ndarray
    indptr: np.ndarray


EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
SIX = np.array(
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]]
)  # of a box with corner number x + 2 y + 4 z; neighbours' diagonals meet


def lines(width: float, near: float, near_radius: float, far: float) -> np.ndarray:
    """Return places from 0 to width [mm]: near apart up to near_radius, then growing up to far."""
    places, size = [0.0], near
    while places[-1] < width - 1e-9:
        size = near if places[-1] < near_radius else min(1.3 * size, far)
        places.append(places[-1] + size)
    return np.array(places) * width / places[-1]


def quarter_block(near: float) -> Solid:
    """Return a quarter of the block: x and y from its middle, z from -HEIGHT to 0."""
    x, y = (lines(w / 2, near, NEAR_RADIUS, FAR) for w in (WIDTH_X, WIDTH_Y))
    z = np.linspace(-HEIGHT, 0, round(HEIGHT / near) + 1)
    corner = np.arange(len(x) * len(y) * len(z)).reshape(len(z), len(y), len(x))
    part = (slice(None, -1), slice(1, None))
    box = [corner[part[k], part[j], part[i]].ravel() for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    tets = np.stack(box, axis=1)[:, SIX].reshape(-1, 4)
    gz, gy, gx = np.meshgrid(z, y, x, indexing="ij")
    X = np.stack([gx.ravel(), gy.ravel(), gz.ravel()], axis=1)
    pairs = np.sort(tets[:, EDGES].reshape(-1, 2), axis=1)
    unique, back = np.unique(pairs, axis=0, return_inverse=True)
    elements = np.hstack([tets, len(X) + back.reshape(-1, 6)])
    X = np.vstack([X, X[unique].mean(axis=1)])
    return solid(X, elements)


def solid(X: np.ndarray, elements: np.ndarray) -> Solid:
    """Return the solid of nodes and elements with straight edges."""
    a, b = 0.5854101966249685, 0.1381966011250105  # four points, exact for quadratic integrands
    L = np.full((4, 4), b) + (a - b) * np.eye(4)  # (Q, 4)
    dN = np.zeros((4, 10, 4))  # dN/dL
    for i in range(4):
        dN[:, i, i] = 4 * L[:, i] - 1
    for k, (i, j) in enumerate(EDGES):
        dN[:, 4 + k, i], dN[:, 4 + k, j] = 4 * L[:, j], 4 * L[:, i]
    sides = X[elements[:, 1:4]] - X[elements[:, :1]]  # (E, 3, 3), rows are edges
    volume = np.linalg.det(sides) / 6
    if not (volume > 0).all():
        raise ValueError("a tetrahedron is turned inside out")
    dL = np.empty((len(elements), 4, 3))
    dL[:, 1:] = np.linalg.inv(sides).transpose(0, 2, 1)
    dL[:, 0] = -dL[:, 1:].sum(axis=1)
    gradient = np.einsum("qal,elj->eqaj", dN, dL)
    dofs = (3 * elements[:, :, None] + np.arange(3)).reshape(len(elements), 30)
    keys = (dofs[:, :, None] * (3 * len(X)) + dofs[:, None, :]).ravel()
    unique, slots = np.unique(keys, return_inverse=True)
    rows, columns = np.divmod(unique, 3 * len(X))
    indptr = np.searchsorted(rows, np.arange(3 * len(X) + 1))
    return Solid(X, elements, gradient, np.tile(volume[:, None] / 4, (1, 4)), slots, columns, indptr)


def response(block: Solid, x: np.ndarray, bulk: float, tangent: bool):
    """Return energy [mJ], forces (N, 3) [N], tangent (3N, 3N) with positive eigenvalues, and the least det F."""
    F = np.einsum("eai,eqaj->eqij", x[block.elements], block.gradient)
    J = np.linalg.det(F)
    if J.min() < SMALLEST_J:
        return np.inf, None, None, float(J.min())
    H = np.linalg.inv(F).transpose(0, 1, 3, 2)
    iso, I1 = J ** (-2 / 3), np.einsum("eqij,eqij->eq", F, F)
    energy = float((block.weight * (MU / 2 * (iso * I1 - 3) + bulk / 2 * (J - 1) ** 2)).sum())
    P = (
        MU * iso[..., None, None] * (F - (I1 / 3)[..., None, None] * H)
        + (bulk * (J - 1) * J)[..., None, None] * H
    )
    own = np.einsum("eq,eqij,eqaj->eai", block.weight, P, block.gradient, optimize=True)
    force = np.stack(
        [np.bincount(block.elements.ravel(), own[..., i].ravel(), len(x)) for i in range(3)], axis=1
    )
    if not tangent:
        return energy, force, None, float(J.min())
    HH = np.einsum("eqil,eqkj->eqijkl", H, H)
    FH = np.einsum("eqij,eqkl->eqijkl", F, H)
    outer = np.einsum("eqij,eqkl->eqijkl", H, H)
    unit = np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3))
    s = iso[..., None, None, None, None]
    t, j = I1[..., None, None, None, None], J[..., None, None, None, None]
    A = MU * s * (unit - 2 / 3 * (FH + FH.transpose(0, 1, 4, 5, 2, 3)) + 2 / 9 * t * outer + t / 3 * HH)
    A += bulk * j * ((2 * j - 1) * outer - (j - 1) * HH)
    shape = A.shape[:2]
    A = A.reshape(-1, 9, 9)
    values, vectors = np.linalg.eigh((A + A.transpose(0, 2, 1)) / 2)
    A = np.einsum("pik,pk,pjk->pij", vectors, np.maximum(values, 0), vectors, optimize=True).reshape(
        *shape, 3, 3, 3, 3
    )
    half = np.einsum("eq,eqijkl,eqbl->eqijbk", block.weight, A, block.gradient, optimize=True)
    K = np.einsum("eqaj,eqijbk->eaibk", block.gradient, half, optimize=True)
    data = np.bincount(block.slots, K.ravel(), len(block.indices))
    n = 3 * len(x)
    return energy, force, sp.csr_matrix((data, block.indices, block.indptr), shape=(n, n)), float(J.min())


# -------------------------------------------------------------------------------------------- the rigid ball
def cap(size: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (B, 3) [mm] on a quarter of a ball's lower cap, its lowest point the origin, and its triangles."""
    rings = np.linspace(0, np.arcsin(reach / RADIUS), round(reach / size) + 1)
    count = [1] + [max(2, round(np.pi / 2 * RADIUS * np.sin(a) / size) + 1) for a in rings[1:]]
    first = np.concatenate([[0], np.cumsum(count)])
    at = [np.zeros((1, 3))]
    for angle, n in zip(rings[1:], count[1:]):
        turn = np.linspace(0, np.pi / 2, n)
        r = RADIUS * np.sin(angle)
        at.append(
            np.stack([r * np.cos(turn), r * np.sin(turn), np.full(n, RADIUS * (1 - np.cos(angle)))], axis=1)
        )
    faces = []
    for k in range(1, len(count) - 1):
        i, j = 0, 0
        while i < count[k] - 1 or j < count[k + 1] - 1:
            a, b = first[k] + i, first[k + 1] + j
            if j < count[k + 1] - 1 and (
                i == count[k] - 1 or (j + 1) / (count[k + 1] - 1) <= (i + 1) / (count[k] - 1)
            ):
                faces.append((a, b + 1, b))
                j += 1
            else:
                faces.append((a, a + 1, b))
                i += 1
    faces += [(0, first[1] + j + 1, first[1] + j) for j in range(count[1] - 1)]
    return np.vstack(at), np.array(faces)


def top_faces(block: Solid) -> np.ndarray:
    """Return triangles (T, 3) of the nodes at z = 0: four of each face of an element."""
    up = np.abs(block.X[:, 2]) < 1e-9
    found = []
    for corners, mids in (
        ((0, 1, 2), (4, 5, 6)),
        ((0, 1, 3), (4, 8, 7)),
        ((0, 2, 3), (6, 9, 7)),
        ((1, 2, 3), (5, 9, 8)),
    ):
        own = block.elements[up[block.elements[:, corners]].all(axis=1)]
        a, b, c = own[:, corners].T
        ab, bc, ca = own[:, mids].T
        found += [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate(found)


# ----------------------------------------------------------------------------------------- contact and Newton
class IpcPress:
    """The quarter block and the ball; `to(depth)` brings the ball there and finds equilibrium."""

    def __init__(self, near: float, dhat: float, friction: float):
        import ipctk

        self.ipctk, self.dhat, self.friction = ipctk, dhat, friction
        self.block = quarter_block(near)
        X = self.block.X
        self.bulk = BULK_TO_SHEAR * MU
        top = top_faces(self.block)
        self.surface = np.unique(top)
        ball, faces = cap(near / 4, NEAR_RADIUS + near)
        self.ball, self.n = ball, len(self.surface)
        number = np.full(len(X), -1)
        number[self.surface] = np.arange(self.n)
        triangles = np.vstack([number[top], faces + self.n]).astype(np.int32)
        self.depth = -FIRST_GAP * dhat
        self.x = X.copy()
        rest = self.vertices(self.x, self.depth)
        self.mesh = ipctk.CollisionMesh(rest, ipctk.edges(triangles), triangles)
        self.rest = rest
        self.pairs = ipctk.NormalCollisions()
        self.pairs.use_area_weighting = True
        self.pairs.collision_set_type = ipctk.NormalCollisions.CollisionSetType.IMPROVED_MAX_APPROX
        self.barrier = ipctk.BarrierPotential(dhat, BARRIER_MPA, use_physical_barrier=True)
        self.slip = ipctk.FrictionPotential(EPS_SLIP)
        self.rubbing = ipctk.TangentialCollisions()
        self.before = rest
        held = np.zeros((len(X), 3), bool)
        held[np.abs(X[:, 2] + HEIGHT) < 1e-9] = True
        held[np.abs(X[:, 0]) < 1e-9, 0] = True
        held[np.abs(X[:, 1]) < 1e-9, 1] = True
        self.free = np.flatnonzero(~held.ravel())
        self.dofs = (
            3 * self.surface[:, None] + np.arange(3)
        ).ravel()  # of the surface's vertices, in the block's
        self.iterations = 0

    def vertices(self, x: np.ndarray, depth: float) -> np.ndarray:
        """Return the collision mesh's vertices: the block's surface, then the ball at a depth."""
        return np.vstack([x[self.surface], self.ball - [0.0, 0.0, depth]])

    def state(self, x: np.ndarray, depth: float, tangent: bool):
        """Return energy, gradient (3N,) and Hessian of all potentials, forces on the ball's vertices and least det F."""
        energy, force, K, J = response(self.block, x, self.bulk, tangent)
        if force is None:
            return np.inf, None, None, None, J
        V = self.vertices(x, depth)
        self.pairs.build(self.mesh, V, self.dhat)
        moved = V - self.before
        energy += self.barrier(self.pairs, self.mesh, V) + self.slip(self.rubbing, self.mesh, moved)
        own = self.barrier.gradient(self.pairs, self.mesh, V) + self.slip.gradient(
            self.rubbing, self.mesh, moved
        )
        gradient = force.ravel()
        m = 3 * self.n
        gradient[self.dofs] += own[:m]
        hessian = None
        if tangent:
            psd = self.ipctk.PSDProjectionMethod.CLAMP
            C = self.barrier.hessian(self.pairs, self.mesh, V, psd)
            C = (C + self.slip.hessian(self.rubbing, self.mesh, moved, psd)).tocsr()
            spread = sp.csr_matrix((np.ones(m), (self.dofs, np.arange(m))), shape=(len(gradient), m))
            on_ball = C[:m, m:] @ np.tile([0.0, 0.0, 1.0], len(self.ball))
            self.by_ball = spread @ on_ball  # change of the gradient as the ball goes up by 1 mm
            hessian = K + spread @ C[:m, :m] @ spread.T
        return energy, gradient, hessian, own[m:].reshape(-1, 3), J

    def to(self, depth: float) -> float:
        """Bring the ball to a depth [mm]; return Fz [N] on the whole block."""
        self.before = self.vertices(self.x, self.depth)
        self.rubbing.clear()
        while depth - self.depth > 1e-12:  # block and ball go together, as far as nothing meets
            self._advance(depth)
        self._newton()
        last = self._force()
        for _ in range(MOST_LAGS if self.friction else 0):
            V = self.vertices(self.x, self.depth)
            self.pairs.build(self.mesh, V, self.dhat)
            self.rubbing.build(self.mesh, V, self.pairs, self.barrier, self.friction)
            self._newton()
            force = self._force()
            if abs(force - last) < 1e-3 * abs(force):
                break
            last = force
        return self._force()

    def _force(self) -> float:
        """Return Fz [N] on the whole block: what the potentials push the ball's vertices with, in the other direction."""
        return 4 * float(self.state(self.x, self.depth, False)[3][:, 2].sum())

    def _solve(self, H: sp.csr_matrix, b: np.ndarray) -> np.ndarray:
        import pypardiso

        d = np.zeros(self.x.size)
        d[self.free] = pypardiso.spsolve(H[self.free][:, self.free].tocsr(), b[self.free])
        return d.reshape(-1, 3)

    def _advance(self, depth: float) -> None:
        """Move the ball towards a depth, and the block as its linearised equilibrium says."""
        _, g, H, _, _ = self.state(self.x, self.depth, True)
        self.iterations += 1
        move = depth - self.depth
        dx = self._solve(H, -g + move * self.by_ball)
        share = self._free_share(dx, move)
        self.x, self.depth = self.x + share * dx, self.depth + share * move if share < 1 else depth

    def _free_share(self, dx: np.ndarray, move: float) -> float:
        """Return the share of a step that brings no two surfaces together and turns no element."""
        here, there = self.vertices(self.x, self.depth), self.vertices(self.x + dx, self.depth + move)
        share = min(1.0, 0.9 * self.ipctk.compute_collision_free_stepsize(self.mesh, here, there))
        share = 1.0 if share >= 0.9 and not self._meets(there) else share
        while response(self.block, self.x + share * dx, self.bulk, False)[1] is None:
            share /= 2
        if share < 1e-6:
            raise RuntimeError("no step is free of collisions; take a larger dhat or smaller steps")
        return share

    def _meets(self, V: np.ndarray) -> bool:
        self.pairs.build(self.mesh, V, self.dhat)
        return self.ipctk.has_intersections(self.mesh, V)

    def _newton(self) -> None:
        for _ in range(MOST_ITERATIONS):
            energy, g, H, _, _ = self.state(self.x, self.depth, True)
            if np.abs(g[self.free]).max() < TOLERANCE_N:
                return
            self.iterations += 1
            dx = self._solve(H, -g)
            slope, share = float(g @ dx.ravel()), self._free_share(dx, 0.0)
            while self.state(self.x + share * dx, self.depth, False)[0] > energy + 1e-4 * share * slope:
                share /= 2
                if share < 1e-8:
                    return  # energy's rounding is reached
            self.x = self.x + share * dx
        raise RuntimeError(f"no equilibrium after {MOST_ITERATIONS} iterations at {self.depth:g} mm")

    def gap(self) -> float:
        """Return the least distance of ball and block [mm]."""
        V = self.vertices(self.x, self.depth)
        self.pairs.build(self.mesh, V, self.dhat)
        return float(np.sqrt(self.pairs.compute_minimum_distance(self.mesh, V)))


# --------------------------------------------------------------------------------------------------- the table
def steps(last: float) -> list[float]:
    return [round(STEP * k, 9) for k in range(1, round(last / STEP) + 1)]


def of_ipc(near: float, dhat: float, friction: float, depths=DEPTHS) -> dict:
    """Return a row of the table by incremental potential contact."""
    clock, press, found = time.process_time(), IpcPress(near, dhat, friction), {}
    for depth in steps(max(depths)):
        force = press.to(depth)
        if any(np.isclose(depth, wanted) for wanted in depths):
            found[f"Fz at {depth:g} mm [N]"] = force
    return {
        "code": "ipctk", "near [mm]": near, "dhat [mm]": dhat, "friction": friction, "unknowns": press.free.size,
        **found, "least gap [mm]": press.gap(), "iterations": press.iterations, "CPU [s]": time.process_time() - clock,
    }  # fmt: skip


def of_gelforge(near: float, friction: float, depths=DEPTHS) -> dict:
    """Return the same by gelforge.press, on the whole block."""
    import gelforge as gf

    clock = time.process_time()
    answer = gf.press(
        WIDTH_X / 2,
        WIDTH_Y / 2,
        steps(max(depths)),
        sensor={
            "width_x_mm": WIDTH_X,
            "width_y_mm": WIDTH_Y,
            "wall_mm": 0,
            "bins": {"nx": 16, "ny": 20},
            "layers": [{"name": "gel", "thickness_mm": HEIGHT, "material": "gel"}],
        },
        indenter={"kind": "sphere", "radius_mm": RADIUS},
        materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 1e3 * MU}}},
        mechanics={
            "friction": friction,
            "bulk_to_shear": BULK_TO_SHEAR,
            "mesh": {"near_mm": near, "near_radius_mm": NEAR_RADIUS, "far_mm": FAR},
        },
    )
    at = [int(np.argmin(np.abs(answer.depth_mm - depth))) for depth in depths]
    found = {f"Fz at {depth:g} mm [N]": answer.total_force_N[k, 2] for depth, k in zip(depths, at)}
    return {
        "code": "gelforge", "near [mm]": near, "dhat [mm]": np.nan, "friction": friction,
        "unknowns": int(answer.cell.attributes["degrees_of_freedom"]), **found,
        "bar at the last [N]": answer.total_sigma_N[at[-1], 2], "iterations": np.nan, "CPU [s]": time.process_time() - clock,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--ours", type=float, nargs="+", default=[1.0, 0.5], help="size of hexahedra near the ball [mm]"
    )
    parser.add_argument(
        "--theirs", type=float, nargs="+", default=[1.4, 1.0], help="size of tetrahedra near the ball [mm]"
    )
    parser.add_argument(
        "--dhat", type=float, nargs="+", default=[0.1, 0.03, 0.01], help="barrier distances [mm]"
    )
    parser.add_argument("--friction", type=float, nargs="+", default=[0.0, 0.5], help="friction coefficients")
    parser.add_argument("--quick", action="store_true", help="one coarse mesh and one depth")
    given = parser.parse_args()
    if not find_spec("ipctk"):
        raise SystemExit("ipctk is not installed: pip install ipctk (a public code, no part of gelforge)")
    if given.quick:
        rows = [of_ipc(1.5, 0.1, 0.5, DEPTHS[:1]), of_gelforge(1.5, 0.5, DEPTHS[:1])]
    else:
        rows = []
        for row in table(given.ours, given.theirs, given.dhat, given.friction):
            print(row, flush=True)
            rows.append(row)
    print(pd.DataFrame(rows).to_markdown(index=False, floatfmt=".4g"))


def table(ours: list[float], theirs: list[float], dhat: list[float], friction: list[float]) -> Iterator[dict]:
    """Yield the rows; what the barrier distance costs is seen on the first mesh and without friction."""
    for coefficient in friction:
        yield from (of_gelforge(size, coefficient) for size in ours)
        for size in theirs:
            every = size == theirs[0] and coefficient == 0
            for distance in dhat if every else dhat[-1:]:
                yield of_ipc(size, distance, coefficient)


if __name__ == "__main__":
    main()
