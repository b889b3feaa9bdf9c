"""Compiled element loops: internal forces, tangent and energy of mean-dilatation hexahedra (Q1P0), Ogden's law.

The energy per undeformed volume is the isochoric Ogden energy of F_bar = J^(-1/3) F at each of the 8 Gauss points plus
K/2 (theta - 1)^2 with theta = v/V, the mean volume ratio of the element. The element pressure p is an unknown of its own,
condensed out: the tangent's geometric terms use the p that is given, not K (theta - 1), which is what lets Newton's
iteration converge at K/mu = 1000 (Nagtegaal, Parks & Rice 1974, doi 10.1016/0045-7825(74)90032-2; Simo, Taylor & Pister
1985, doi 10.1016/0045-7825(85)90033-7). The spectral tangent follows Simo & Taylor 1991 (doi 10.1016/0045-7825(91)90100-K).
The NumPy twins are laws.Ogden (point level) and the tests' element loop.
"""

from __future__ import annotations

from math import sqrt

import numba as nb
import numpy as np

NODES = 8
POINTS = 8
DOFS = 3 * NODES
PAIRS = DOFS * (DOFS + 1) // 2
SMALLEST_J = 1e-3  # guards powers of J while an iterate is inverted; such an iterate is never accepted


@nb.njit(cache=True, inline="always")
def _eigen_symmetric(A, V):
    """Jacobi rotations: A (3, 3) becomes diagonal in place, the columns of V its unit eigenvectors."""
    for i in range(3):
        for j in range(3):
            V[i, j] = 0.0
        V[i, i] = 1.0
    for _ in range(12):
        if A[0, 1] * A[0, 1] + A[0, 2] * A[0, 2] + A[1, 2] * A[1, 2] < 1e-28:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                a = A[p, q]
                if abs(a) < 1e-300:
                    continue
                ratio = (A[q, q] - A[p, p]) / (2 * a)
                t = 1.0 / (abs(ratio) + sqrt(ratio * ratio + 1.0))
                if ratio < 0:
                    t = -t
                c = 1.0 / sqrt(t * t + 1.0)
                s = t * c
                A[p, p] -= t * a
                A[q, q] += t * a
                A[p, q] = 0.0
                A[q, p] = 0.0
                r = 3 - p - q
                x = A[r, p]
                y = A[r, q]
                A[r, p] = c * x - s * y
                A[p, r] = A[r, p]
                A[r, q] = s * x + c * y
                A[q, r] = A[r, q]
                for k in range(3):
                    x = V[k, p]
                    y = V[k, q]
                    V[k, p] = c * x - s * y
                    V[k, q] = s * x + c * y


@nb.njit(cache=True, inline="always")
def _ogden(lam, mu, alpha, beta, gamma):
    """Fill principal isochoric Kirchhoff stresses beta_i and gamma_ij = d beta_i / d ln lam_j; return the energy.

    lam (3,) are the isochoric stretches; mu, alpha (K,) with mu = 0 for absent terms.
    """
    energy = 0.0
    for i in range(3):
        beta[i] = 0.0
        for j in range(3):
            gamma[i, j] = 0.0
    for k in range(mu.shape[0]):
        m = mu[k]
        if m == 0.0:
            continue
        a = alpha[k]
        p0 = lam[0] ** a
        p1 = lam[1] ** a
        p2 = lam[2] ** a
        mean = (p0 + p1 + p2) / 3.0
        energy += m / a * (3.0 * mean - 3.0)
        beta[0] += m * (p0 - mean)
        beta[1] += m * (p1 - mean)
        beta[2] += m * (p2 - mean)
        c = m * a / 3.0
        gamma[0, 0] += c * (p0 + mean)
        gamma[1, 1] += c * (p1 + mean)
        gamma[2, 2] += c * (p2 + mean)
        gamma[0, 1] += c * (mean - p0 - p1)
        gamma[0, 2] += c * (mean - p0 - p2)
        gamma[1, 2] += c * (mean - p1 - p2)
    gamma[1, 0] = gamma[0, 1]
    gamma[2, 0] = gamma[0, 2]
    gamma[2, 1] = gamma[1, 2]
    return energy


@nb.njit(cache=True, inline="always")
def _kirchhoff_stress(V, beta, M, tau):
    """Fill the isochoric Kirchhoff stress tau (6,), order xx yy zz xy yz xz, and the projections M (3, 6) of V's columns."""
    for i in range(3):
        M[i, 0] = V[0, i] * V[0, i]
        M[i, 1] = V[1, i] * V[1, i]
        M[i, 2] = V[2, i] * V[2, i]
        M[i, 3] = V[0, i] * V[1, i]
        M[i, 4] = V[1, i] * V[2, i]
        M[i, 5] = V[0, i] * V[2, i]
    for k in range(6):
        tau[k] = beta[0] * M[0, k] + beta[1] * M[1, k] + beta[2] * M[2, k]


@nb.njit(cache=True, inline="always")
def _spatial_tangent(b, V, beta, gamma, pj, M, S, D, tau):
    """Fill the spatial modulus D (6, 6) of the Kirchhoff stress with pressure; add p J to tau (6,).

    b holds the eigenvalues of F F^T (full, not isochoric: only their ratios enter) on its diagonal, V the eigenvectors.
    """
    for k in range(6):
        for m in range(6):
            D[k, m] = 0.0
    for i in range(3):
        for j in range(3):
            c = gamma[i, j]
            if i == j:
                c -= 2.0 * beta[i]
            for k in range(6):
                cm = c * M[i, k]
                for m in range(6):
                    D[k, m] += cm * M[j, m]
    for i in range(2):
        for j in range(i + 1, 3):
            bi = b[i, i]
            bj = b[j, j]
            if abs(bi - bj) > 1e-5 * (bi + bj):
                h = (beta[i] * bj - beta[j] * bi) / (bi - bj)
            else:  # the limit of equal stretches
                h = 0.5 * (0.5 * (gamma[i, i] + gamma[j, j]) - gamma[i, j]) - 0.5 * (beta[i] + beta[j])
            S[0] = 2.0 * V[0, i] * V[0, j]
            S[1] = 2.0 * V[1, i] * V[1, j]
            S[2] = 2.0 * V[2, i] * V[2, j]
            S[3] = V[0, i] * V[1, j] + V[1, i] * V[0, j]
            S[4] = V[1, i] * V[2, j] + V[2, i] * V[1, j]
            S[5] = V[0, i] * V[2, j] + V[2, i] * V[0, j]
            for k in range(6):
                cm = h * S[k]
                for m in range(6):
                    D[k, m] += cm * S[m]
    for i in range(3):  # pressure: p J (1 x 1 - 2 I)
        tau[i] += pj
        for j in range(3):
            D[i, j] += pj
        D[i, i] -= 2.0 * pj
        D[i + 3, i + 3] -= pj


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"}, error_model="numpy")
def assemble(
    gradient, weight, elements, region, u, pressure, mu, alpha, bulk, slots,
    data, f_mixed, f_condensed, p_volume, coupling,
):  # fmt: skip
    """Assemble a mean-dilatation body; return (energy [mJ], smallest J at a Gauss point).

    In: gradient (E, 8, 8, 3) [1/mm], weight (E, 8) [mm^3], elements (E, 8), region (E,), u (N, 3) [mm], pressure (E,)
    [MPa] in force, mu, alpha (R, K), bulk (R,) [MPa], slots (E, 300) positions of the upper element pairs in data (-1:
    fixed). Out: data (nnz,) upper CSR values of the condensed tangent, left alone if of length 0; f_mixed (N, 3) [N]
    internal force with the given pressure; f_condensed (N, 3) the same with p_volume; p_volume (E,) = K (theta - 1);
    coupling (E, 8, 3) = dv/du [mm^2].
    """
    tangent = data.shape[0] > 0
    F = np.empty((POINTS, 3, 3))
    Js = np.empty(POINTS)
    g = np.empty((POINTS, 3, NODES))  # spatial gradients, nodes last so that the loops over them vectorise
    b = np.empty((3, 3))
    V = np.empty((3, 3))
    lam = np.empty(3)
    beta = np.empty(3)
    gamma = np.empty((3, 3))
    M = np.empty((3, 6))
    S = np.empty(6)
    D = np.empty((6, 6))
    tau = np.empty(6)
    ue = np.empty((3, NODES))
    fe = np.empty((3, NODES))
    ce = np.empty((3, NODES))
    Ke = np.empty((3, 3, NODES, NODES))  # [i, l, b, a] = dF_ai / du_bl
    energy = 0.0
    smallest = 1e300
    data[:] = 0.0
    f_mixed[:] = 0.0
    f_condensed[:] = 0.0
    for e in range(elements.shape[0]):
        r = region[e]
        for a in range(NODES):
            n = elements[e, a]
            for i in range(3):
                ue[i, a] = u[n, i]
                fe[i, a] = 0.0
                ce[i, a] = 0.0
        V0 = 0.0
        v = 0.0
        for q in range(POINTS):
            for i in range(3):
                for j in range(3):
                    s = 0.0
                    for a in range(NODES):
                        s += ue[i, a] * gradient[e, q, a, j]
                    F[q, i, j] = s
                F[q, i, i] += 1.0
            f = F[q]
            c00 = f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1]
            c01 = f[1, 2] * f[2, 0] - f[1, 0] * f[2, 2]
            c02 = f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0]
            J = f[0, 0] * c00 + f[0, 1] * c01 + f[0, 2] * c02
            smallest = min(smallest, J)
            w = weight[e, q]
            V0 += w
            v += J * w
            J = max(J, SMALLEST_J)
            Js[q] = J
            c10 = f[0, 2] * f[2, 1] - f[0, 1] * f[2, 2]
            c11 = f[0, 0] * f[2, 2] - f[0, 2] * f[2, 0]
            c12 = f[0, 1] * f[2, 0] - f[0, 0] * f[2, 1]
            c20 = f[0, 1] * f[1, 2] - f[0, 2] * f[1, 1]
            c21 = f[0, 2] * f[1, 0] - f[0, 0] * f[1, 2]
            c22 = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
            for a in range(NODES):  # F^-T dN/dX
                x = gradient[e, q, a, 0] / J
                y = gradient[e, q, a, 1] / J
                z = gradient[e, q, a, 2] / J
                g[q, 0, a] = c00 * x + c01 * y + c02 * z
                g[q, 1, a] = c10 * x + c11 * y + c12 * z
                g[q, 2, a] = c20 * x + c21 * y + c22 * z
        p = pressure[e]
        p_volume[e] = bulk[r] * (v / V0 - 1.0)
        energy += 0.5 * bulk[r] * (v / V0 - 1.0) ** 2 * V0
        if tangent:
            Ke[:] = 0.0
        for q in range(POINTS):
            f = F[q]
            J = Js[q]
            w = weight[e, q]
            for i in range(3):
                for j in range(3):
                    b[i, j] = f[i, 0] * f[j, 0] + f[i, 1] * f[j, 1] + f[i, 2] * f[j, 2]
            _eigen_symmetric(b, V)
            scale = J ** (-1.0 / 3.0)
            for i in range(3):
                lam[i] = sqrt(b[i, i]) * scale
            energy += w * _ogden(lam, mu[r], alpha[r], beta, gamma)
            _kirchhoff_stress(V, beta, M, tau)
            t0 = w * tau[0]
            t1 = w * tau[1]
            t2 = w * tau[2]
            t3 = w * tau[3]
            t4 = w * tau[4]
            t5 = w * tau[5]
            wj = w * J
            for a in range(NODES):
                x = g[q, 0, a]
                y = g[q, 1, a]
                z = g[q, 2, a]
                fe[0, a] += t0 * x + t3 * y + t5 * z
                fe[1, a] += t3 * x + t1 * y + t4 * z
                fe[2, a] += t5 * x + t4 * y + t2 * z
                ce[0, a] += wj * x
                ce[1, a] += wj * y
                ce[2, a] += wj * z
            if not tangent:
                continue
            _spatial_tangent(b, V, beta, gamma, p * J, M, S, D, tau)
            for k in range(6):
                tau[k] *= w
                for m in range(6):
                    D[k, m] *= w
            for c in range(NODES):
                x = g[q, 0, c]
                y = g[q, 1, c]
                z = g[q, 2, c]
                sx = tau[0] * x + tau[3] * y + tau[5] * z
                sy = tau[3] * x + tau[1] * y + tau[4] * z
                sz = tau[5] * x + tau[4] * y + tau[2] * z
                for m in range(3):
                    if m == 0:
                        k0, k1, k2 = 0, 3, 5
                    elif m == 1:
                        k0, k1, k2 = 3, 1, 4
                    else:
                        k0, k1, k2 = 5, 4, 2
                    d0 = D[0, k0] * x + D[0, k1] * y + D[0, k2] * z
                    d1 = D[1, k0] * x + D[1, k1] * y + D[1, k2] * z
                    d2 = D[2, k0] * x + D[2, k1] * y + D[2, k2] * z
                    d3 = D[3, k0] * x + D[3, k1] * y + D[3, k2] * z
                    d4 = D[4, k0] * x + D[4, k1] * y + D[4, k2] * z
                    d5 = D[5, k0] * x + D[5, k1] * y + D[5, k2] * z
                    gx = sx if m == 0 else 0.0
                    gy = sy if m == 0 else 0.0
                    gz = sz if m == 0 else 0.0
                    for a in range(NODES):
                        Ke[0, m, c, a] += (
                            g[q, 0, a] * (d0 + gx) + g[q, 1, a] * (d3 + gy) + g[q, 2, a] * (d5 + gz)
                        )
                    gx = sx if m == 1 else 0.0
                    gy = sy if m == 1 else 0.0
                    gz = sz if m == 1 else 0.0
                    for a in range(NODES):
                        Ke[1, m, c, a] += (
                            g[q, 0, a] * (d3 + gx) + g[q, 1, a] * (d1 + gy) + g[q, 2, a] * (d4 + gz)
                        )
                    gx = sx if m == 2 else 0.0
                    gy = sy if m == 2 else 0.0
                    gz = sz if m == 2 else 0.0
                    for a in range(NODES):
                        Ke[2, m, c, a] += (
                            g[q, 0, a] * (d5 + gx) + g[q, 1, a] * (d4 + gy) + g[q, 2, a] * (d2 + gz)
                        )
        for a in range(NODES):
            n = elements[e, a]
            for i in range(3):
                coupling[e, a, i] = ce[i, a]
                f_mixed[n, i] += fe[i, a] + p * ce[i, a]
                f_condensed[n, i] += fe[i, a] + p_volume[e] * ce[i, a]
        if tangent:
            stiff = bulk[r] / V0
            k = 0
            for a in range(NODES):
                for i in range(3):
                    ca = stiff * ce[i, a]
                    for c in range(a, NODES):
                        for m in range(i if c == a else 0, 3):
                            s = slots[e, k]
                            if s >= 0:
                                data[s] += Ke[i, m, c, a] + ca * ce[m, c]
                            k += 1
    return energy, smallest


@nb.njit(cache=True)
def symmetric_product(indptr, indices, data, x, y):
    """Fill y = A x for a symmetric A whose upper triangle is in CSR form, diagonal first in every row."""
    for i in range(x.shape[0]):
        y[i] = 0.0
    for i in range(x.shape[0]):
        first = indptr[i]
        xi = x[i]
        s = data[first] * xi
        for k in range(first + 1, indptr[i + 1]):
            j = indices[k]
            s += data[k] * x[j]
            y[j] += data[k] * xi
        y[i] += s
