"""Compiled element loops: internal forces, tangent and energy of mean-dilatation elements (Q1P0 hexahedra, P2P0 tetrahedra).

The energy per undeformed volume is the law's isochoric energy of F_bar = J^(-1/3) F at each quadrature point plus
K/2 (theta - 1)^2 with theta = v/V, the mean volume ratio of the element. The element pressure p is an unknown of its own,
condensed out: the tangent's geometric terms use the p that is given, not K (theta - 1), which is what lets Newton's
iteration converge at K/mu = 1000 (Nagtegaal, Parks & Rice 1974, doi 10.1016/0045-7825(74)90032-2; Simo, Taylor & Pister
1985, doi 10.1016/0045-7825(85)90033-7). Where an element asks for it, kappa/2 (J - theta)^2 is added, and the pressure of a
point is p + kappa (J - theta): nothing for the exact solution, whose J is smooth, but it holds what a mean cannot
(elements.LOCAL_BULK_TO_SHEAR). The spectral tangent follows Simo & Taylor 1991 (doi 10.1016/0045-7825(91)90100-K).
The NumPy twins are the laws (point level) and the tests' element loop.
"""

from __future__ import annotations

from math import erf, exp, pi, sqrt

import numba as nb
import numpy as np

from gelforge.mechanics.point_laws import principal_stress

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


@nb.njit(cache=True, inline="always")
def _soften(W, peak, amount, m, share, beta, gamma):
    """Soften beta (3,) and gamma (3, 3) in place below the largest energy density so far; return the energy density.

    eta = 1 - amount erf((peak - W) / (m + share peak)), 1 beyond the peak (Ogden & Roxburgh 1999, doi
    10.1098/rspa.1999.0431, eqs. 27, 50); the energy is the integral of eta over W.
    """
    if amount == 0.0:
        return W
    width = m + share * peak
    top = peak / width
    x = max(peak - W, 0.0) / width
    root = sqrt(pi)
    lost = top * erf(top) + (exp(-top * top) - exp(-x * x)) / root - x * erf(x)
    if W < peak:
        eta = 1.0 - amount * erf(x)
        slope = 2.0 * amount / (root * width) * exp(-x * x)  # d eta / dW
        for i in range(3):
            for j in range(3):
                gamma[i, j] = eta * gamma[i, j] + slope * beta[i] * beta[j]
        for i in range(3):
            beta[i] *= eta
    return W - amount * width * lost


@nb.njit(cache=True, inline="always")
def _frozen_stress(f, J, size, H, T):
    """Fill T (6,) = size F_bar H F_bar^T of a frozen stress H (6,), order xx yy zz xy yz xz; return a third of its trace.

    It is the Kirchhoff stress of the energy H : (C_bar - I) / 2, but for its mean.
    """
    scale = size * J ** (-2.0 / 3.0)
    for k in range(6):
        i, j = (k, k) if k < 3 else ((k - 3, k - 2) if k < 5 else (0, 2))
        s = 0.0
        for a in range(3):
            x = H[0 if a == 0 else (3 if a == 1 else 5)] * f[j, 0]
            x += H[3 if a == 0 else (1 if a == 1 else 4)] * f[j, 1]
            x += H[5 if a == 0 else (4 if a == 1 else 2)] * f[j, 2]
            s += f[i, a] * x
        T[k] = scale * s
    return (T[0] + T[1] + T[2]) / 3.0


@nb.njit(cache=True, inline="always")
def _add_frozen_modulus(T, mean, D):
    """Add the spatial modulus of a frozen stress to D (6, 6): 2/3 tr T (I - 1/3 1 x 1) - 2/3 (dev T x 1 + 1 x dev T)."""
    for k in range(6):
        D[k, k] += 2.0 * mean if k < 3 else mean
        dk = T[k] - mean if k < 3 else T[k]
        for j in range(3):
            D[k, j] -= 2.0 / 3.0 * dk
            D[j, k] -= 2.0 / 3.0 * dk
    for i in range(3):
        for j in range(3):
            D[i, j] -= 2.0 / 3.0 * mean


def _assembler(NODES: int, POINTS: int, LOCAL: bool, MEMORY: bool):
    """Return `assemble` compiled for elements of this many nodes and quadrature points: constant loops vectorise.

    LOCAL: part of the bulk modulus resists the volume change of every point rather than that of the element.
    MEMORY: the points soften and carry frozen stresses; without, gain, frozen, peak and softening are not read.
    """

    @nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"}, error_model="numpy")
    def assemble(
        gradient, weight, elements, region, u, pressure, law, constants, stiffness, bulk, local_bulk, rest, slots,
        gain, frozen, peak, softening, data, f_mixed, f_condensed, p_volume, coupling,
    ):  # fmt: skip
        """Assemble a mean-dilatation body; return energy [mJ], smallest J, largest extension over its limit.

        In, with A nodes and Q points: gradient (E, Q, A, 3) [1/mm], weight (E, Q) [mm^3], elements (E, A), region (E,),
        u (N, 3) [mm], pressure (E,) [MPa] in force, law (R,) and constants (R, C) of the point routines, stiffness (E,)
        factor on the law, bulk (E,) [MPa], local_bulk (E,) the part of it at the points, rest (R, 3, 3) F at u = 0, slots
        (E, pairs) positions of the upper element pairs in data (-1: fixed); with memory: gain (R,) on the law's stress in
        this step, frozen (E, Q, 6) [MPa] material stresses beside it, peak (E, Q) [MPa] the largest energy density so far,
        softening (R, 3) = amount, m [MPa], beta. The energy is without gain and frozen stress.
        Out: data (nnz,) upper CSR values of the condensed tangent, left alone if
        of length 0; f_mixed (N, 3) [N] internal force with the given pressure; f_condensed (N, 3) the same with p_volume;
        p_volume (E,) = K (theta - 1); coupling (E, A, 3) = dv/du [mm^2].
        """
        tangent = data.shape[0] > 0
        F = np.empty((POINTS, 3, 3))
        Js = np.empty(POINTS)
        g = np.empty(
            (POINTS, 3, NODES)
        )  # spatial gradients, nodes last so that the loops over them vectorise
        b = np.empty((3, 3))
        V = np.empty((3, 3))
        lam = np.empty(3)
        beta = np.empty(3)
        gamma = np.empty((3, 3))
        M = np.empty((3, 6))
        S = np.empty(6)
        D = np.empty((6, 6))
        tau = np.empty(6)
        T = np.zeros(6)
        mean = 0.0
        ue = np.empty((3, NODES))
        fe = np.empty((3, NODES))
        ce = np.empty((3, NODES))
        Ke = np.empty((3, 3, NODES, NODES))  # [i, l, b, a] = dF_ai / du_bl
        energy = 0.0
        smallest = 1e300
        largest = 0.0
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
                        F[q, i, j] = s + rest[r, i, j]
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
            p_volume[e] = bulk[e] * (v / V0 - 1.0)
            energy += 0.5 * bulk[e] * (v / V0 - 1.0) ** 2 * V0
            factor = stiffness[e]
            kappa = local_bulk[e] if LOCAL else 0.0
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
                density, extension = principal_stress(law[r], constants[r], lam, beta, gamma)
                if MEMORY:
                    density = _soften(
                        density, peak[e, q], softening[r, 0], softening[r, 1], softening[r, 2], beta, gamma
                    )
                energy += w * factor * density
                largest = max(largest, extension)
                size = factor * gain[r] if MEMORY else factor
                for i in range(3):
                    beta[i] *= size
                    for j in range(3):
                        gamma[i, j] *= size
                _kirchhoff_stress(V, beta, M, tau)
                if MEMORY:
                    mean = _frozen_stress(f, J, factor, frozen[e, q], T)
                    for k in range(6):
                        tau[k] += T[k] - mean if k < 3 else T[k]
                departure = kappa * (J - v / V0)  # of the point's pressure from the element's
                energy += 0.5 * w * departure * (J - v / V0)
                t0 = w * (tau[0] + departure * J)
                t1 = w * (tau[1] + departure * J)
                t2 = w * (tau[2] + departure * J)
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
                _spatial_tangent(b, V, beta, gamma, (p + departure) * J, M, S, D, tau)
                if MEMORY:
                    _add_frozen_modulus(T, mean, D)
                if LOCAL:
                    for i in range(3):
                        for j in range(3):
                            D[i, j] += kappa * J * J
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
                stiff = (bulk[e] - kappa) / V0
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
        return energy, smallest, largest

    return assemble


# By the number of nodes; compiled when first called.
ASSEMBLE = {8: _assembler(8, 8, False, False), 10: _assembler(10, 4, True, False)}
ASSEMBLE_WITH_MEMORY = {8: _assembler(8, 8, False, True), 10: _assembler(10, 4, True, True)}


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
