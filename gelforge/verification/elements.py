"""Checks of elements, laws and Newton's iteration without contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import Mesh
from gelforge.mechanics.reference_solutions import ogden_uniaxial
from gelforge.verification.check import Check, absolute, relative, vanishing
from gelforge.verification.manufactured import (
    convergence_order,
    cube,
    general_field,
    isochoric_field,
    solve_loaded,
)

GEL = Ogden((7.9652e-3, 0.3093e-3), (1.2769, 3.5676))  # MPa; Sferrazza et al. 2019, table 1
STRETCHED = np.array([[1.25, 0.2, 0.0], [0.1, 0.9, -0.15], [-0.05, 0.1, 0.8]])
ISOCHORIC = STRETCHED / np.cbrt(np.linalg.det(STRETCHED))

# The problems whose errors docs/verification.md compares with their limits:
STIFF = 1e4  # K/mu of the locking tests
# Elements a side of two meshes, the orders in displacement and gradient for K/mu = 1 and 1e4, and how far short the order
# between the meshes may fall: terms of the next order in h. A tetrahedron whose points all resist for themselves, as at
# K/mu = 1, is quadratic; at 1e4 the constant pressure has the last word, and the orders (2.45, 1.63) come down to it.
ORDERS = {
    "even": ((6, 12), (2, 1), (2, 1), 0.1),
    "hanging nodes": ((6, 12), (2, 1), (2, 1), 0.1),
    "quadratic tetrahedra": ((4, 8), (3, 2), (2, 1), 0.1),
}


def distorted(mesh: Mesh, share: float) -> Mesh:
    """Return the mesh with its free nodes moved at random by up to share of the least edge; hanging nodes follow."""
    edges = mesh.X[mesh.elements[:, [1, 3, 4]]] - mesh.X[mesh.elements[:, [0]]]
    shift = np.random.default_rng(21).uniform(-1, 1, mesh.X.shape)
    shift *= share * np.linalg.norm(edges, axis=-1).min()
    X = mesh.X + shift * ~mesh.fixed[:, None]
    return replace(mesh, X=X if mesh.ties is None else mesh.ties @ X)


def uniaxial_stress() -> list[Check]:
    """Return the nominal stress of a cube in uniaxial tension, from nodal forces, next to Ogden's formula."""
    lam, mesh = 1.6, cube(2)
    body = Body(mesh, {"gel": GEL}, 1000.0)
    stretches = np.array([lam**-0.5, lam**-0.5, lam])
    force = body.response(mesh.X * (stretches - 1), np.zeros(len(mesh.elements))).f_condensed

    def nominal(axis):  # of the face of 1 mm^2 at the far end of an axis
        return force[mesh.X[:, axis] > mesh.X[:, axis].max() - 1e-9, axis].sum()

    # A bar's side is free: the pressure that does it takes P_11 lam_1 / lam_3 off the stress along the bar.
    stress = nominal(2) - nominal(0) * stretches[0] / lam
    known = ogden_uniaxial(lam, GEL.mu, GEL.alpha)
    # The volume ratio is 1 to some 1e-16, and K/mu = 1000 of that is left.
    return [relative("uniaxial nominal stress at stretch 1.6 [MPa]", "Ogden 1972", known, stress, 1e-11)]


def patch_test() -> list[Check]:
    """Return how well an affine isochoric displacement is found on distorted elements with hanging nodes, K/mu = 1e4."""
    mesh = distorted(cube(3, "hanging nodes"), 0.3)
    body = Body(mesh, {"gel": GEL}, STIFF)
    exact = mesh.X @ (ISOCHORIC - np.eye(3)).T
    disturbed = exact + 0.01 * np.random.default_rng(3).uniform(-1, 1, exact.shape) * ~mesh.fixed[:, None]
    u, iterates = solve_loaded(body, body.spread(disturbed), np.zeros_like(exact))
    errors = [float(np.abs(iterate - exact).max()) for iterate in iterates]
    # Rounding of u (1e-16) times the condition of about K/mu.
    quantity = "patch test: displacement, isochoric, K/mu 1e4, distorted, hanging nodes [mm]"
    order, name = newton_order(errors), "patch test: order of Newton's iteration"
    return [
        vanishing(quantity, "affine field", np.abs(u - exact).max(), 1e-12),
        Check(name, "2, at least 1.8", 2.0, order, 2.0 - order, 0.2),
    ]


def newton_order(errors: list[float]) -> float:
    """Return the order log(e_k+1 / e_k) / log(e_k / e_k-1) of the last three errors above rounding."""
    seen = [error for error in errors if error > 1e-12]
    return float(np.log(seen[-1] / seen[-2]) / np.log(seen[-2] / seen[-3]))


def rigid_modes() -> list[Check]:
    """Return how many motions cost no force: six, on a distorted mesh with hanging nodes and no support."""
    mesh = distorted(cube(2, "hanging nodes"), 0.2)
    body = Body(replace(mesh, fixed=np.zeros(len(mesh.X), bool)), {"gel": GEL}, 1000.0)
    values = np.empty(len(body.pattern.indices))
    body.response(np.zeros_like(mesh.X), np.zeros(len(mesh.elements)), values)
    n = body.pattern.size
    dense = np.zeros((n, n))
    rows = np.repeat(np.arange(n), np.diff(body.pattern.indptr))
    dense[rows, body.pattern.indices] = dense[body.pattern.indices, rows] = values
    eigenvalues = np.abs(np.linalg.eigvalsh(dense))
    # Rounding is 1e-16 of the largest (K); the softest deformation, a shear of the gel, is some 1e-5 of it.
    soft = int((eigenvalues < 1e-10 * eigenvalues.max()).sum())
    return [absolute("motions without force", "rigid motions", 6, soft, 0)]


def manufactured_orders() -> list[Check]:
    """Return the orders of convergence in displacement and gradient of each kind of mesh, soft and nearly incompressible."""
    checks = []
    for kind, (sizes, soft, stiff, margin) in ORDERS.items():
        for ratio, field, bulk_to_shear, known in (
            ("1", general_field, 1.0, soft),
            ("1e4", isochoric_field, STIFF, stiff),
        ):
            for what, order, measured in zip(
                ("displacement", "gradient"), known, convergence_order(field, bulk_to_shear, kind, sizes)
            ):
                quantity = f"order in {what}, {kind}, K/mu {ratio}"
                shortfall = max(order - measured, 0.0)
                checks.append(
                    Check(quantity, "manufactured solution, at least", order, measured, shortfall, margin)
                )
    return checks
