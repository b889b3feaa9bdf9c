r"""Manufactured solutions: a displacement is chosen, the load that makes it the solution follows, the error falls with h^2.

With the displacement held on the whole boundary, the load of the chosen field enters through the weak form itself,

.. math:: f_a = \int P(F_{exact}) \nabla N_a \, dV,

which equals that of the body force -Div P and needs no second derivatives (Roache 2002, doi 10.1115/1.1436090). P is the
law's plain NumPy form plus K (J - 1) cof F, independent of the compiled kernel that is judged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.linear.sparse import direct_solver, refined_solve
from gelforge.mechanics.meshes.elements import ELEMENTS, Element, quadratic_tetrahedra
from gelforge.mechanics.meshes.mesh import Block, Mesh, Sizes, layered_block

AMPLITUDE = 0.08  # mm on a cube of 1 mm: strains of 0.25
PRESSURE = 0.3  # over mu: any would do, and 0.3 is of the size of the stresses of AMPLITUDE
LAW = Ogden((0.02, 0.001), (1.3, 4.0))
# six tetrahedra of a hexahedron
KUHN = [(0, a, b, 6) for a, b in [(1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1)]]

Field = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]  # u, F, added pressure over mu


# -------------------------------------------------------------------------------------------------- chosen solutions
def general_field(X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return u (..., 3) [mm], F (..., 3, 3) and no added pressure (...) at X (..., 3) of a field that changes volume."""
    # row i: wave vector of u_i
    waves = np.pi * np.array([[0.3, 1.0, 0.5], [0.8, -0.4, 1.0], [1.0, 0.6, -0.7]])
    phase = X @ waves.T + [0.3, 0.7, 1.1]
    F = np.eye(3) + AMPLITUDE * np.cos(phase)[..., :, None] * waves
    return AMPLITUDE * np.sin(phase), F, np.zeros(X.shape[:-1])


def isochoric_field(X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return u (..., 3) [mm] and F (..., 3, 3) of three simple shears, each seeing the last one's outcome: det F = 1.

    The third is a pressure (...) over mu, which a body of K/mu = 1e4 carries with a change of volume of 3e-5 only: that
    moves u by some 1e-6 mm, a thousandth of the errors measured.
    """
    x = X.copy()
    F = np.broadcast_to(np.eye(3), (*X.shape, 3)).copy()
    for moved, along, phase in ((0, 1, 0.3), (2, 0, 0.7), (1, 2, 1.1)):
        argument = np.pi * x[..., along] + phase
        x[..., moved] += AMPLITUDE * np.sin(argument)
        F[..., moved, :] += (AMPLITUDE * np.pi * np.cos(argument))[..., None] * F[..., along, :]
    return x - X, F, PRESSURE * np.cos(np.pi * (X @ [1.0, 0.5, -0.7]))


# ---------------------------------------------------------------------------------------------------------- problem
@dataclass(frozen=True)
class Errors:
    """Root mean squares over the body of the error of a solved field."""

    displacement: float  # mm
    gradient: float


def cube(n: int, kind: str = "even") -> Mesh:
    """Return a cube of 1 mm held on its boundary, n elements a side.

    kind: even; hanging nodes, where elements are halved in a ball at the middle of the top; or quadratic tetrahedra,
    six to a hexahedron.
    """
    near = 1 / (2 * n) if kind == "hanging nodes" else 1 / n
    sizes = Sizes(near=near, near_radius=0.3, growth=1.0, far=1 / n)
    mesh = layered_block(Block(1.0, 1.0, (("gel", 1.0),)), 0.5, 0.5, sizes)
    if kind == "quadratic tetrahedra":
        X, elements = quadratic_tetrahedra(mesh.X, mesh.elements[:, KUHN].reshape(-1, 4))
        mesh = replace(mesh, X=X, elements=elements, region=np.repeat(mesh.region, len(KUHN)))
    X = mesh.X
    edge = ((X < X.min(axis=0) + 1e-9) | (X > X.max(axis=0) - 1e-9)).any(axis=1)
    return replace(mesh, fixed=edge)


def solve_manufactured(mesh: Mesh, field: Field, bulk_to_shear: float) -> Errors:
    """Return the errors of the finite-element solution whose exact one is the field."""
    body = Body(mesh, {"gel": LAW}, bulk_to_shear)
    load = body.gathered(_load(mesh, field, bulk_to_shear))
    u, _ = solve_loaded(body, body.spread(field(mesh.X)[0]), load)
    return _errors(mesh, field, u)


def convergence_order(
    field: Field, bulk_to_shear: float, kind: str, sizes: tuple[int, int]
) -> tuple[float, float]:
    """Return the orders in h at which the errors of displacement and gradient fall between two meshes."""
    coarse, fine = (solve_manufactured(cube(n, kind), field, bulk_to_shear) for n in sizes)
    falls = coarse.displacement / fine.displacement, coarse.gradient / fine.gradient
    of_u, of_F = (float(np.log(fall) / np.log(sizes[1] / sizes[0])) for fall in falls)
    return of_u, of_F


def solve_loaded(
    body: Body, u: np.ndarray, load: np.ndarray, iterations: int = 12
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return u (N, 3) in equilibrium with nodal loads (N, 3) [N], and all iterates, by mixed Newton's iteration from u.

    Fixed nodes keep the displacement given. Raises ArithmeticError if it does not settle.
    """
    free = body.pattern.equation >= 0
    values, solver = np.empty(len(body.pattern.indices)), direct_solver(body.pattern)
    # Not the pressure of the start's volume: K times the error of interpolation makes the first tangent indefinite.
    pressure, iterates = np.zeros(len(body.mesh.elements)), [u]
    for _ in range(iterations):
        response = body.response(u, pressure, values)
        solver.factor(values)
        step = np.zeros_like(u)
        rhs = (load - response.f_condensed)[free]
        step[free], _ = refined_solve(solver, body.pattern, values, rhs, 1e-14, 8)
        step = body.spread(step)
        pressure = body.linearised_pressure(response, step)
        u = u + step
        iterates.append(u)
        if np.abs(step).max() < 1e-12 * max(np.abs(u).max(), 1e-6):
            return u, iterates
    raise ArithmeticError(
        f"no equilibrium in {iterations} iterations; the last one moved {np.abs(step).max():.1e} mm"
    )


def _quadrature(kind: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return points (Q, 3) and weights (Q,) of a rule whose error, h^6 or less, is far below what is measured."""
    x, w = np.polynomial.legendre.leggauss(3)
    points = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3)
    weights = np.einsum("i,j,k->ijk", w, w, w).ravel()
    if kind.name == "hexahedron":
        return points, weights
    # The cube collapsed to a tetrahedron (Stroud 1971): z = c, y = b (1 - c), x = a (1 - b) (1 - c).
    a, b, c = ((points + 1) / 2).T
    return (np.stack([a * (1 - b) * (1 - c), b * (1 - c), c], axis=-1), weights / 8 * (1 - b) * (1 - c) ** 2)


def _at_points(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return X (E, Q, 3), dN/dX (E, Q, A, 3), weights (E, Q) and shape functions (Q, A) at the quadrature points."""
    kind, corners = ELEMENTS[mesh.elements.shape[1]], mesh.X[mesh.elements]
    points, weights = _quadrature(kind)
    N, dN = kind.shape(points), kind.natural_gradient(points)
    jacobian = np.einsum("enx,qnk->eqxk", corners, dN)
    gradient = np.einsum("qnk,eqkx->eqnx", dN, np.linalg.inv(jacobian))
    return np.einsum("qn,enx->eqx", N, corners), gradient, weights * np.linalg.det(jacobian), N


def _load(mesh: Mesh, field: Field, bulk_to_shear: float) -> np.ndarray:
    X, gradient, weight, _ = _at_points(mesh)
    _, F, added = field(X)
    J = np.linalg.det(F)
    cofactor = J[..., None, None] * np.linalg.inv(F).swapaxes(-1, -2)
    pressure = LAW.shear_modulus * (bulk_to_shear * (J - 1) + added)
    P = LAW.nominal_stress(F) + pressure[..., None, None] * cofactor
    nodal = np.einsum("eq,eqij,eqnj->eni", weight, P, gradient)
    load = np.zeros_like(mesh.X)
    np.add.at(load, mesh.elements, nodal)
    return load


def _errors(mesh: Mesh, field: Field, u: np.ndarray) -> Errors:
    X, gradient, weight, N = _at_points(mesh)
    exact, F, _ = field(X)
    nodal = u[mesh.elements]
    of_u = ((np.einsum("qn,eni->eqi", N, nodal) - exact) ** 2).sum(axis=-1)
    of_F = ((np.eye(3) + np.einsum("eni,eqnj->eqij", nodal, gradient) - F) ** 2).sum(axis=(-2, -1))
    volume = weight.sum()
    return Errors(*(float(np.sqrt((weight * square).sum() / volume)) for square in (of_u, of_F)))
