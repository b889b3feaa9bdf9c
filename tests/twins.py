"""Plain NumPy twins of the compiled loops, written from the formulae and sharing no code with them."""

import numpy as np

# Corners of the hexahedron in meshio's order, and its trilinear monomials 1, r, s, t, rs, st, tr, rst.
CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    float,
)


def monomials(xi):
    r, s, t = xi
    return np.array([1, r, s, t, r * s, s * t, t * r, r * s * t])


def monomial_slopes(xi):
    """Return d(monomial)/d(r, s, t) (8, 3)."""
    r, s, t = xi
    return np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [s, r, 0], [0, t, s], [t, 0, r], [s * t, r * t, r * s]]
    )


NODAL = np.linalg.inv([monomials(corner) for corner in CORNERS])  # monomial coefficients of N_a in column a
ABSCISSA, WEIGHT = np.polynomial.legendre.leggauss(2)
GAUSS = np.array([(r, s, t) for t in ABSCISSA for s in ABSCISSA for r in ABSCISSA])


def shape(xi):
    """Return N (8,) at natural coordinates xi (3,)."""
    return monomials(xi) @ NODAL


def points(X):
    """Return dN/dX (8 points, 8 nodes, 3) and the weights (8,) [mm^3] of one element X (8, 3)."""
    gradients, weights = [], []
    for xi in GAUSS:
        dN = NODAL.T @ monomial_slopes(xi)  # (nodes, 3)
        jacobian = X.T @ dN  # dX_x / dxi_k
        gradients.append(dN @ np.linalg.inv(jacobian))
        weights.append(np.linalg.det(jacobian) * np.prod([WEIGHT[0]] * 3))
    return np.array(gradients), np.array(weights)


def element(X, u, p, law, bulk):
    """Return what one mean-dilatation element does at nodes X (8, 3), displacement u (8, 3), given pressure p [MPa].

    With W(F) isochoric, v = sum w J and c = dv/du, the energy is sum w W + K/2 (v/V - 1)^2 V; keys: f_mixed and
    f_condensed (8, 3), p_volume, coupling (8, 3), energy, tangent (24, 24) = d f_mixed/du at fixed p + K/V c c^T.
    """
    G, w = points(X)
    F = np.eye(3) + np.einsum("ai,qaj->qij", u, G)
    J, Finv = np.linalg.det(F), np.linalg.inv(F)
    cofactor = J[:, None, None] * np.swapaxes(Finv, 1, 2)  # dJ/dF
    V, v = w.sum(), w @ J
    c = np.einsum("q,qij,qaj->ai", w, cofactor, G)
    f = np.einsum("q,qij,qaj->ai", w, law.nominal_stress(F), G)
    p_volume = bulk * (v / V - 1)
    A = law.tangent(F)
    # d cof_ij / dF_kl = J (F^-1_ji F^-1_lk - F^-1_li F^-1_jk)
    A = A + p * (np.einsum("q,qji,qlk->qijkl", J, Finv, Finv) - np.einsum("q,qli,qjk->qijkl", J, Finv, Finv))
    K = np.einsum("q,qijkl,qaj,qbl->aibk", w, A, G, G).reshape(24, 24) + bulk / V * np.outer(c, c)
    return {
        "f_mixed": f + p * c,
        "f_condensed": f + p_volume * c,
        "p_volume": p_volume,
        "coupling": c,
        "energy": w @ law.energy(F) + bulk / 2 * (v / V - 1) ** 2 * V,
        "tangent": K,
    }


def contact(gap, normal, slip, pressure, active, area, t_old, new_contact, eps_n, eps_t, mu):
    """Return the forces of the indenter on the nodes; arguments as in gelforge.mechanics.contact.contact_forces.

    Keys: f_mixed, f_condensed, f_consistent, friction (S, 3), state (S,), stiffness (S, 3, 3): the symmetric tangent.
    """
    N = area * np.where(active, pressure, 0.0)
    N_next = np.where(active, area * (pressure - eps_n * gap), 0.0)
    rubs = active & (N > 0) & (mu > 0)
    plane = np.eye(3) - np.einsum("si,sj->sij", normal, normal)
    share = np.where(new_contact, 0.5, 1.0)
    elastic = eps_t * area * share
    trial = np.einsum("sij,sj->si", plane, t_old - elastic[:, None] * slip)
    size = np.linalg.norm(trial, axis=1)
    slips = rubs & (size > mu * N)
    size = np.where(slips, size, 1.0)
    factor = np.where(slips, mu * N / size, 1.0) * rubs
    factor_next = np.where(slips, mu * np.maximum(N_next, 0) / size, 1.0) * rubs
    friction = factor[:, None] * trial
    along = np.einsum("si,sj->sij", trial, trial) / size[:, None, None] ** 2 * slips[:, None, None]
    stiffness = (eps_n * area * active)[:, None, None] * np.einsum("si,sj->sij", normal, normal)
    stiffness += (factor * elastic)[:, None, None] * (plane - 0.5 * along)
    return {
        "f_mixed": N[:, None] * normal + friction,
        "f_condensed": N_next[:, None] * normal + friction,
        "f_consistent": N_next[:, None] * normal + factor_next[:, None] * trial,
        "friction": friction,
        "stiffness": stiffness,
        "state": np.where(active, np.where(rubs & ~slips, 1, 2), 0),
    }
