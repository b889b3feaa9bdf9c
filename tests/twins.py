"""Plain NumPy twins of the compiled loops, written from the formulae and sharing no code with them."""

import numpy as np

# Nodes of the hexahedron and of the quadratic tetrahedron in meshio's order.
HEXAHEDRON = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    float,
)
TETRAHEDRON = np.array(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1],
     [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0], [0, 0, 0.5], [0.5, 0, 0.5], [0, 0.5, 0.5]],
    float,
)  # fmt: skip
# Exponents of r, s, t in the monomials that span the shape functions.
TRILINEAR = np.array(list(np.ndindex(2, 2, 2)))
QUADRATIC = np.array([e for e in np.ndindex(3, 3, 3) if sum(e) <= 2])


def monomials(exponents, xi):
    """Return the monomials (M,) of these exponents (M, 3) at xi (3,)."""
    return np.prod(xi**exponents, axis=1)


def monomial_slopes(exponents, xi):
    """Return d(monomial)/d(r, s, t) (M, 3)."""
    lower = [np.maximum(exponents - np.eye(3, dtype=int)[k], 0) for k in range(3)]
    return np.stack([exponents[:, k] * monomials(lower[k], xi) for k in range(3)], axis=1)


class Basis:
    """Shape functions as the monomials that are 1 at one node, and points with weights on the natural element."""

    def __init__(self, nodes, exponents, points, weights):
        self.exponents, self.points, self.weights = exponents, points, weights
        self.nodal = np.linalg.inv(
            [monomials(exponents, xi) for xi in nodes]
        )  # coefficients of N_a in column a

    def shape(self, xi):
        """Return N (A,) at natural coordinates xi (3,)."""
        return monomials(self.exponents, xi) @ self.nodal

    def slopes(self, xi):
        """Return dN/dxi (A, 3) at natural coordinates xi (3,)."""
        return self.nodal.T @ monomial_slopes(self.exponents, xi)


ABSCISSA, WEIGHT = np.polynomial.legendre.leggauss(2)
GAUSS = np.array([(r, s, t) for t in ABSCISSA for s in ABSCISSA for r in ABSCISSA])
# The 4-point rule of degree 2 in volume coordinates: one of them 1 - 3 b, three b with 20 b = 5 - sqrt(5).
B = (5 - 5**0.5) / 20
SIMPLEX = np.array([(B, B, B), (1 - 3 * B, B, B), (B, 1 - 3 * B, B), (B, B, 1 - 3 * B)])
BASES = {
    8: Basis(HEXAHEDRON, TRILINEAR, GAUSS, np.ones(8)),
    10: Basis(TETRAHEDRON, QUADRATIC, SIMPLEX, np.full(4, 1 / 24)),
}


def points(X):
    """Return dN/dX (points, nodes, 3) and the weights (points,) [mm^3] of one element X (8 or 10, 3)."""
    basis = BASES[len(X)]
    gradients, weights = [], []
    for xi, weight in zip(basis.points, basis.weights):
        dN = basis.slopes(xi)
        jacobian = X.T @ dN  # dX_x / dxi_k
        gradients.append(dN @ np.linalg.inv(jacobian))
        weights.append(np.linalg.det(jacobian) * weight)
    return np.array(gradients), np.array(weights)


def element(X, u, p, law, bulk, local=0.0):
    """Return what one mean-dilatation element does at nodes X (A, 3), displacement u (A, 3), given pressure p [MPa].

    With W(F) isochoric, v = sum w J, theta = v/V and c = dv/du, the energy is
    sum w W + K/2 (theta - 1)^2 V + local/2 sum w (J - theta)^2; keys: f_mixed and f_condensed (A, 3), p_volume,
    coupling (A, 3), energy, tangent (3 A, 3 A) = d f_mixed/du at fixed p + K/V c c^T.
    """
    G, w = points(X)
    F = np.eye(3) + np.einsum("ai,qaj->qij", u, G)
    J, Finv = np.linalg.det(F), np.linalg.inv(F)
    cofactor = J[:, None, None] * np.swapaxes(Finv, 1, 2)  # dJ/dF
    V, v = w.sum(), w @ J
    growth = np.einsum("qij,qaj->qai", cofactor, G)  # dJ/du at each point
    c = np.einsum("q,qai->ai", w, growth)
    departure = local * (J - v / V)
    f = np.einsum("q,qij,qaj->ai", w, law.nominal_stress(F), G) + np.einsum(
        "q,qai->ai", w * departure, growth
    )
    p_volume = bulk * (v / V - 1)
    A = law.tangent(F)
    # d cof_ij / dF_kl = J (F^-1_ji F^-1_lk - F^-1_li F^-1_jk)
    turn = np.einsum("q,qji,qlk->qijkl", J, Finv, Finv) - np.einsum("q,qli,qjk->qijkl", J, Finv, Finv)
    A = A + (p + departure)[:, None, None, None, None] * turn
    K = np.einsum("q,qijkl,qaj,qbl->aibk", w, A, G, G).reshape(u.size, u.size)
    points_alone = np.einsum("q,qm,qn->mn", w, growth.reshape(len(w), -1), growth.reshape(len(w), -1))
    K = K + bulk / V * np.outer(c, c) + local * (points_alone - np.outer(c, c) / V)
    return {
        "f_mixed": f + p * c,
        "f_condensed": f + p_volume * c,
        "p_volume": p_volume,
        "coupling": c,
        "energy": w @ law.energy(F) + bulk / 2 * (v / V - 1) ** 2 * V + local / 2 * w @ (J - v / V) ** 2,
        "tangent": K,
    }


def contact(gap, normal, slip, pressure, active, area, given, eps_n, weight, hold, mu):
    """Return the forces of the indenter on the nodes; arguments as in gelforge.mechanics.contact.forces.contact_forces.

    Keys: f_mixed, f_condensed, f_consistent, friction, wanted, direction (S, 3), spring (S,), state (S,) and the symmetric
    tangent stiffness (S, 3, 3).
    """
    N = area * np.where(active, pressure, 0.0)
    N_next = np.where(active, area * (pressure - eps_n * gap), 0.0)
    rubs = active & (N > 0) & (mu > 0)
    plane = np.eye(3) - np.einsum("si,sj->sij", normal, normal)
    t = np.einsum("sij,sj->si", plane, given) * rubs[:, None]
    s = np.einsum("sij,sj->si", plane, slip)
    trial = (t - (weight * area)[:, None] * s) * rubs[:, None]
    size = np.linalg.norm(trial, axis=1)
    slips = rubs & (size > mu * N)
    share = np.where(slips, mu * N / np.where(slips, size, 1.0), 0.0)
    e = np.where(slips[:, None], trial / np.where(slips, size, 1.0)[:, None], 0.0)
    k = np.where(slips, np.minimum(hold * area, weight * area * share / (1 - share)), hold * area) * rubs
    across = s - e * (e * s).sum(axis=1, keepdims=True)
    held = np.where(slips[:, None], (mu * N)[:, None] * e, t) - k[:, None] * across
    held_next = np.where(slips[:, None], (mu * np.maximum(N_next, 0))[:, None] * e, t) - k[:, None] * across
    stiffness = (eps_n * area * active)[:, None, None] * np.einsum("si,sj->sij", normal, normal)
    stiffness += k[:, None, None] * (plane - np.einsum("si,sj->sij", e, e))
    return {
        "f_mixed": N[:, None] * normal + t,
        "f_condensed": N_next[:, None] * normal + held,
        "f_consistent": N_next[:, None] * normal + held_next,
        "friction": t,
        "wanted": np.where(slips[:, None], (mu * N)[:, None] * e, trial),
        "direction": e,
        "spring": k,
        "stiffness": stiffness,
        "state": np.where(active, np.where(rubs & ~slips, 1, 2), 0),
    }
