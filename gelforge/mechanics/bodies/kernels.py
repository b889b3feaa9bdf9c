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

from math import erf, exp, log, pi, sqrt

import numba as nb
import numpy as np

from gelforge.mechanics.laws.points import FINGERPRINT, principal_stress

FAST = {"reassoc", "contract", "nsz", "arcp"}
# Sum of squares off the diagonal at which Jacobi's rotations end: eigenvectors are then right to its root, which is below
# what the balance of forces leaves.
OFF_DIAGONAL = 1e-22
# Number of the block of an element's tangent by the two directions that it couples; the others are its transposes.
BLOCK = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
SMALLEST_J = 1e-3  # guards powers of J while an iterate is inverted; such an iterate is never accepted


def _eigen_solver(POINTS: int):
    """Return the compiled `eigen` of this many symmetric matrices at a time: loops over them without branches vectorise."""

    @nb.njit(cache=True, inline="always", fastmath=FAST, error_model="numpy")
    def eigen(A, V):
        """Jacobi rotations: A (3, 3, POINTS) become diagonal in place, the columns of V (3, 3, POINTS) unit eigenvectors."""
        for i in range(3):
            for j in range(3):
                for k in range(POINTS):
                    V[i, j, k] = 1.0 if i == j else 0.0
        for _ in range(12):
            left = 0.0
            for k in range(POINTS):
                left = max(left, A[0, 1, k] ** 2 + A[0, 2, k] ** 2 + A[1, 2, k] ** 2)
            if left < OFF_DIAGONAL:
                break
            for p in range(2):
                for q in range(p + 1, 3):
                    r = 3 - p - q
                    for k in range(POINTS):
                        a = A[p, q, k]
                        apart = A[q, q, k] - A[p, p, k]
                        # a and apart may both be zero
                        t = 2.0 * a / (abs(apart) + sqrt(apart * apart + 4.0 * a * a) + 1e-300)
                        t = t if apart >= 0.0 else -t
                        c = 1.0 / sqrt(t * t + 1.0)
                        s = t * c
                        A[p, p, k] -= t * a
                        A[q, q, k] += t * a
                        A[p, q, k] = 0.0
                        A[q, p, k] = 0.0
                        x = A[r, p, k]
                        y = A[r, q, k]
                        A[r, p, k] = c * x - s * y
                        A[p, r, k] = c * x - s * y
                        A[r, q, k] = s * x + c * y
                        A[q, r, k] = s * x + c * y
                        for i in range(3):
                            x = V[i, p, k]
                            y = V[i, q, k]
                            V[i, p, k] = c * x - s * y
                            V[i, q, k] = s * x + c * y

    return eigen


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
def _spatial_tangent(square, V, beta, gamma, pj, M, A, S, h, D, tau):
    """Fill the spatial modulus D (6, 6) of the Kirchhoff stress with pressure; add p J to tau (6,).

    square (3,) are the eigenvalues of F F^T (full, not isochoric: only their ratios enter), V holds the eigenvectors.
    A (3, 6), S (3, 6) and h (3,) are room to work in.
    """
    pair = 0
    for i in range(3):
        c0 = gamma[i, 0] - (2.0 * beta[i] if i == 0 else 0.0)
        c1 = gamma[i, 1] - (2.0 * beta[i] if i == 1 else 0.0)
        c2 = gamma[i, 2] - (2.0 * beta[i] if i == 2 else 0.0)
        for k in range(6):
            A[i, k] = c0 * M[0, k] + c1 * M[1, k] + c2 * M[2, k]
        for j in range(i + 1, 3):
            bi = square[i]
            bj = square[j]
            if abs(bi - bj) > 1e-5 * (bi + bj):
                h[pair] = (beta[i] * bj - beta[j] * bi) / (bi - bj)
            else:  # the limit of equal stretches
                h[pair] = 0.5 * (0.5 * (gamma[i, i] + gamma[j, j]) - gamma[i, j]) - 0.5 * (beta[i] + beta[j])
            S[pair, 0] = 2.0 * V[0, i] * V[0, j]
            S[pair, 1] = 2.0 * V[1, i] * V[1, j]
            S[pair, 2] = 2.0 * V[2, i] * V[2, j]
            S[pair, 3] = V[0, i] * V[1, j] + V[1, i] * V[0, j]
            S[pair, 4] = V[1, i] * V[2, j] + V[2, i] * V[1, j]
            S[pair, 5] = V[0, i] * V[2, j] + V[2, i] * V[0, j]
            pair += 1
    for k in range(6):
        h0, h1, h2 = h[0] * S[0, k], h[1] * S[1, k], h[2] * S[2, k]
        for m in range(k, 6):
            d = M[0, k] * A[0, m] + M[1, k] * A[1, m] + M[2, k] * A[2, m]
            d += h0 * S[0, m] + h1 * S[1, m] + h2 * S[2, m]
            D[k, m] = d
            D[m, k] = d
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
    scale = size * exp(-2.0 / 3.0 * log(J))
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


def _element_blocks(NODES: int, POINTS: int):
    """Return the compiled `blocks` of elements of this many nodes and points."""

    @nb.njit(cache=True, inline="always", fastmath=FAST, error_model="numpy")
    def blocks(g, t, D, bend, flat, flat_bend, K):
        """Fill K (6, A, A) = dF_ai / du_cm of an element [b, c, a], b = xx, xy, xz, yy, yz, zz, without its volume's part.

        g (A, 3, Q) spatial gradients [1/mm], t (6, Q) Kirchhoff stress and D (6, 6, Q) its spatial modulus, times the
        points' volumes [N mm]; bend (6, A, 3, Q) is room to work in. flat and flat_bend are views of g and bend with their
        last two axes as one: one long sum vectorises.
        """
        for c in range(NODES):
            for q in range(POINTS):
                x, y, z = g[c, 0, q], g[c, 1, q], g[c, 2, q]
                sx = t[0, q] * x + t[3, q] * y + t[5, q] * z
                sy = t[3, q] * x + t[1, q] * y + t[4, q] * z
                sz = t[5, q] * x + t[4, q] * y + t[2, q] * z
                xy0 = D[0, 3, q] * x + D[0, 1, q] * y + D[0, 4, q] * z
                xy1 = D[3, 3, q] * x + D[3, 1, q] * y + D[3, 4, q] * z
                xy2 = D[5, 3, q] * x + D[5, 1, q] * y + D[5, 4, q] * z
                xz0 = D[0, 5, q] * x + D[0, 4, q] * y + D[0, 2, q] * z
                xz1 = D[3, 5, q] * x + D[3, 4, q] * y + D[3, 2, q] * z
                xz2 = D[5, 5, q] * x + D[5, 4, q] * y + D[5, 2, q] * z
                yz1 = D[1, 5, q] * x + D[1, 4, q] * y + D[1, 2, q] * z
                yz2 = D[4, 5, q] * x + D[4, 4, q] * y + D[4, 2, q] * z
                bend[0, c, 0, q] = D[0, 0, q] * x + D[0, 3, q] * y + D[0, 5, q] * z + sx
                bend[0, c, 1, q] = D[3, 0, q] * x + D[3, 3, q] * y + D[3, 5, q] * z + sy
                bend[0, c, 2, q] = D[5, 0, q] * x + D[5, 3, q] * y + D[5, 5, q] * z + sz
                bend[1, c, 0, q] = xy0
                bend[1, c, 1, q] = xy1
                bend[1, c, 2, q] = xy2
                bend[2, c, 0, q] = xz0
                bend[2, c, 1, q] = xz1
                bend[2, c, 2, q] = xz2
                bend[3, c, 0, q] = xy1 + sx
                bend[3, c, 1, q] = D[1, 3, q] * x + D[1, 1, q] * y + D[1, 4, q] * z + sy
                bend[3, c, 2, q] = D[4, 3, q] * x + D[4, 1, q] * y + D[4, 4, q] * z + sz
                bend[4, c, 0, q] = xz1
                bend[4, c, 1, q] = yz1
                bend[4, c, 2, q] = yz2
                bend[5, c, 0, q] = xz2 + sx
                bend[5, c, 1, q] = yz2 + sy
                bend[5, c, 2, q] = D[2, 5, q] * x + D[2, 4, q] * y + D[2, 2, q] * z + sz
        for i in range(3):
            for m in range(i, 3):
                b = BLOCK[i, m]
                for c in range(NODES):
                    for group in range((NODES + 3) // 4):  # four sums at a time vectorise
                        a = min(4 * group, NODES - 4)
                        s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
                        for k in range(3 * POINTS):
                            x = flat_bend[b, c, k]
                            s0 += x * flat[a, k]
                            s1 += x * flat[a + 1, k]
                            s2 += x * flat[a + 2, k]
                            s3 += x * flat[a + 3, k]
                        K[b, c, a] = s0
                        K[b, c, a + 1] = s1
                        K[b, c, a + 2] = s2
                        K[b, c, a + 3] = s3

    return blocks


# By name and not closed over by `assemble`: on disk a kernel is known by its code and by what it closes over, and a compiled
# function is another one in every process, so that each would compile the kernel anew.
_eigen_of_8, _eigen_of_4 = _eigen_solver(8), _eigen_solver(4)
_blocks_of_8, _blocks_of_10 = _element_blocks(8, 8), _element_blocks(10, 4)


def _assembler(NODES: int, POINTS: int, LOCAL: bool, MEMORY: bool, LAWS: int = FINGERPRINT):
    """Return `assemble` compiled for elements of this many nodes and quadrature points: constant loops vectorise.

    LOCAL: part of the bulk modulus resists the volume change of every point rather than that of the element.
    MEMORY: the points soften and carry frozen stresses; without, gain, frozen, peak and softening are not read.
    LAWS: closed over, so that a kernel on disk is not taken for that of other laws.
    """

    @nb.njit(cache=True, fastmath=FAST, error_model="numpy")
    def assemble(
        gradient, weight, elements, region, u, pressure, law, constants, stiffness, bulk, local_bulk, rest, slots,
        gain, frozen, peak, softening, data, f_mixed, f_condensed, p_volume, coupling,
    ):  # fmt: skip
        """Assemble a mean-dilatation body; return energy [mJ], smallest J, largest extension over its limit.

        In, with A nodes and Q points: gradient (E, Q, A, 3) [1/mm], weight (E, Q) [mm^3], elements (E, A), region (E,),
        u (N, 3) [mm], pressure (E,) [MPa] in force, law (R,) and constants (R, C) of the point routines, stiffness (E,)
        factor on the law, bulk (E,) [MPa], local_bulk (E,) the part of it at the points, rest (R, 3, 3) F at u = 0, slots
        (E, pairs, 3) as Pattern.element_slots; with memory: gain (R,) on the law's stress in this step, frozen (E, Q, 6)
        [MPa] material stresses beside it, peak (E, Q) [MPa] the largest energy density so far,
        softening (R, 3) = amount, m [MPa], beta. The energy is without gain and frozen stress.
        Out: data (nnz,) upper CSR values of the condensed tangent, left alone if
        of length 0; f_mixed (N, 3) [N] internal force with the given pressure; f_condensed (N, 3) the same with p_volume;
        p_volume (E,) = K (theta - 1); coupling (E, A, 3) = dv/du [mm^2].
        """
        _ = LAWS
        tangent = data.shape[0] > 0
        F = np.empty((POINTS, 3, 3))
        Js = np.empty(POINTS)
        # Points last: loops over them vectorise.
        g = np.empty((NODES, 3, POINTS))  # spatial gradients
        B = np.empty((3, 3, POINTS))  # F F^T
        directions = np.empty((3, 3, POINTS))
        square = np.empty(3)
        V = np.empty((3, 3))
        lam = np.empty(3)
        beta = np.empty(3)
        gamma = np.empty((3, 3))
        M = np.empty((3, 6))
        A = np.empty((3, 6))
        S = np.empty((3, 6))
        h = np.empty(3)
        D = np.empty((6, 6))
        tau = np.empty(6)
        moduli = np.empty((6, 6, POINTS))
        stress = np.empty((6, POINTS))
        total = np.empty((6, POINTS))  # with the pressure
        volume = np.empty(POINTS)
        bend = np.empty(
            (6, NODES, 3, POINTS)
        )  # moduli times gradients, for the blocks of xx, xy, xz, yy, yz, zz
        K = np.empty((6, NODES, NODES))
        flat, flat_bend = g.reshape(NODES, 3 * POINTS), bend.reshape(6, NODES, 3 * POINTS)
        T = np.zeros(6)
        mean = 0.0
        ue = np.empty((3, NODES))
        fe = np.empty((3, NODES))
        ce = np.empty((3, NODES))
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
                    g[a, 0, q] = c00 * x + c01 * y + c02 * z
                    g[a, 1, q] = c10 * x + c11 * y + c12 * z
                    g[a, 2, q] = c20 * x + c21 * y + c22 * z
            p = pressure[e]
            p_volume[e] = bulk[e] * (v / V0 - 1.0)
            energy += 0.5 * bulk[e] * (v / V0 - 1.0) ** 2 * V0
            factor = stiffness[e]
            kappa = local_bulk[e] if LOCAL else 0.0
            for i in range(3):
                for j in range(3):
                    for q in range(POINTS):
                        B[i, j, q] = (
                            F[q, i, 0] * F[q, j, 0] + F[q, i, 1] * F[q, j, 1] + F[q, i, 2] * F[q, j, 2]
                        )
            if POINTS == 8:
                _eigen_of_8(B, directions)
            else:
                _eigen_of_4(B, directions)
            for q in range(POINTS):
                f = F[q]
                J = Js[q]
                w = weight[e, q]
                scale = exp(-log(J) / 3.0)
                for i in range(3):
                    square[i] = B[i, i, q]
                    lam[i] = sqrt(square[i]) * scale
                    for j in range(3):
                        V[i, j] = directions[i, j, q]
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
                for k in range(6):
                    stress[k, q] = w * (tau[k] + departure * J if k < 3 else tau[k])
                volume[q] = w * J
                if not tangent:
                    continue
                _spatial_tangent(square, V, beta, gamma, (p + departure) * J, M, A, S, h, D, tau)
                if MEMORY:
                    _add_frozen_modulus(T, mean, D)
                if LOCAL:
                    for i in range(3):
                        for j in range(3):
                            D[i, j] += kappa * J * J
                for k in range(6):
                    total[k, q] = w * tau[k]
                    for m in range(6):
                        moduli[k, m, q] = w * D[k, m]
            for a in range(NODES):
                f0, f1, f2, v0, v1, v2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for q in range(POINTS):
                    x, y, z = g[a, 0, q], g[a, 1, q], g[a, 2, q]
                    f0 += stress[0, q] * x + stress[3, q] * y + stress[5, q] * z
                    f1 += stress[3, q] * x + stress[1, q] * y + stress[4, q] * z
                    f2 += stress[5, q] * x + stress[4, q] * y + stress[2, q] * z
                    v0 += volume[q] * x
                    v1 += volume[q] * y
                    v2 += volume[q] * z
                fe[0, a], fe[1, a], fe[2, a] = f0, f1, f2
                ce[0, a], ce[1, a], ce[2, a] = v0, v1, v2
            for a in range(NODES):
                n = elements[e, a]
                for i in range(3):
                    coupling[e, a, i] = ce[i, a]
                    f_mixed[n, i] += fe[i, a] + p * ce[i, a]
                    f_condensed[n, i] += fe[i, a] + p_volume[e] * ce[i, a]
            if tangent:
                if NODES == 8:
                    _blocks_of_8(g, total, moduli, bend, flat, flat_bend, K)
                else:
                    _blocks_of_10(g, total, moduli, bend, flat, flat_bend, K)
                stiff = (bulk[e] - kappa) / V0
                k = 0
                for a in range(NODES):
                    for c in range(a, NODES):
                        row, column = (a, c) if elements[e, a] <= elements[e, c] else (c, a)
                        if slots[e, k, 0] >= 0:
                            for i in range(3):
                                first = i if a == c else 0
                                s = slots[e, k, i] - first
                                ca = stiff * ce[i, row]
                                for m in range(first, 3):
                                    own = (
                                        K[BLOCK[i, m], column, row] if i <= m else K[BLOCK[i, m], row, column]
                                    )
                                    data[s + m] += own + ca * ce[m, column]
                        k += 1
        return energy, smallest, largest

    return assemble


# By the number of nodes; compiled when first called.
ASSEMBLE = {8: _assembler(8, 8, False, False), 10: _assembler(10, 4, True, False)}
ASSEMBLE_WITH_MEMORY = {8: _assembler(8, 8, False, True), 10: _assembler(10, 4, True, True)}
