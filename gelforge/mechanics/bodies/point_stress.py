"""Stresses and moduli at a quadrature point of several elements at once: compiled into the element loops.

Every quantity is the `Lanes` of these elements. The spatial tangent follows Simo & Taylor 1991 (doi
10.1016/0045-7825(91)90100-K). Symmetric tensors are in the order xx yy zz xy yz xz, their moduli the upper triangle row by
row.
"""

from __future__ import annotations

from math import erf, exp, log, pi, sqrt

import numba as nb

from gelforge.mechanics.laws.lanes import ONCE, any_less, where_less

# Sum of squares off the diagonal at which Jacobi's rotations end: eigenvectors are then right to its root, which is below
# what the balance of forces leaves (tests/mechanics/test_lanes.py).
OFF_DIAGONAL = 1e-26
# Of 2 cos(arccos(r) / 3) at r in [0, 1], measured to 9e-6: two steps of Newton's then leave rounding.
LONE = (
    1.7320596975739426, 0.3328581358424494, -0.09201079716283159, 0.03528498604463647, -0.00819887607220976,
)  # fmt: skip


@nb.njit(inline="always")
def _rotation(app, aqq, apq):
    """Return t, c and s: tangent, cosine and sine of the angle that takes apq to 0."""
    apart = aqq - app
    # apart and apq may both be zero
    t = 2.0 * apq / (abs(apart) + sqrt(apart * apart + 4.0 * apq * apq) + 1e-300)
    t = where_less(apart, 0.0, -t, t)
    c = 1.0 / sqrt(t * t + 1.0)
    return t, c, t * c


@nb.njit(inline="always")
def _cross(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@nb.njit(inline="always")
def _dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@nb.njit(inline="always")
def _times(a00, a11, a22, a01, a12, a02, v):
    """Return the product of a symmetric matrix and a vector."""
    return (
        a00 * v[0] + a01 * v[1] + a02 * v[2],
        a01 * v[0] + a11 * v[1] + a12 * v[2],
        a02 * v[0] + a12 * v[1] + a22 * v[2],
    )


@nb.njit(inline="always")
def _combined(a, u, b, v):
    return a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]


@nb.njit(inline="always")
def _where(x, y, u, v):
    return where_less(x, y, u[0], v[0]), where_less(x, y, u[1], v[1]), where_less(x, y, u[2], v[2])


@nb.njit(**ONCE)
def _lone_direction(a00, a11, a22, a01, a12, a02):
    """Return the unit eigenvector whose eigenvalue is the farthest from the others.

    With the mean m of the eigenvalues and 6 p^2 = |A - m 1|^2, (A - m 1) / p has the eigenvalues 2 cos(phi + 2 k pi / 3),
    cos 3 phi = r its half determinant (Smith 1961, doi 10.1145/355578.366316). The one of the sign of r is the farthest.
    """
    mean = (a00 + a11 + a22) / 3.0
    a00, a11, a22 = a00 - mean, a11 - mean, a22 - mean
    size = (a00 * a00 + a11 * a11 + a22 * a22 + 2.0 * (a01 * a01 + a12 * a12 + a02 * a02)) / 6.0
    scale = 1.0 / sqrt(size + 1e-300)
    a00, a11, a22, a01, a12, a02 = scaled(scale, (a00, a11, a22, a01, a12, a02))
    minor = a11 * a22 - a12 * a12
    half = 0.5 * (a00 * minor - a01 * (a01 * a22 - a12 * a02) + a02 * (a01 * a12 - a11 * a02))
    r = abs(half)
    x = LONE[0] + r * (LONE[1] + r * (LONE[2] + r * (LONE[3] + r * LONE[4])))
    slope = 1.0 / (3.0 * x * x - 3.0)
    x = x - (x * (x * x - 3.0) - 2.0 * r) * slope
    x = x - (x * (x * x - 3.0) - 2.0 * r) * slope
    x = where_less(half, 0.0, -x, x)
    first, second, third = (a00 - x, a01, a02), (a01, a11 - x, a12), (a02, a12, a22 - x)
    u, v, w = _cross(first, second), _cross(first, third), _cross(second, third)
    uu, vv, ww = _dot(u, u), _dot(v, v), _dot(w, w)
    u, uu = _where(uu, vv, v, u), max(uu, vv)
    u, uu = _where(uu, ww, w, u), max(uu, ww)
    size = 1.0 / sqrt(uu)
    return size * u[0], size * u[1], size * u[2]


@nb.njit(**ONCE)
def eigen(a00, a11, a22, a01, a12, a02):
    """Return eigenvalues and unit eigenvectors of symmetric matrices: a closed form, then Jacobi's rotations if need be.

    The closed form splits off one direction and turns the other two by one rotation. A lane that has converged is turned no
    further, so it does not depend on the others.
    """
    u = _lone_direction(a00, a11, a22, a01, a12, a02)
    one = 1.0 / sqrt(u[2] * u[2] + max(u[0] * u[0], u[1] * u[1]))
    x, y, z, none = one * u[0], one * u[1], one * u[2], 0.0 * one
    v = _where(abs(u[0]), abs(u[1]), (none, z, -y), (-z, none, x))
    w = _cross(u, v)
    av = _times(a00, a11, a22, a01, a12, a02, v)
    aw = _times(a00, a11, a22, a01, a12, a02, w)
    a00, a01, a02 = _dot(u, _times(a00, a11, a22, a01, a12, a02, u)), _dot(u, av), _dot(u, aw)
    a11, a22, a12 = _dot(v, av), _dot(w, aw), _dot(v, aw)
    for _ in range(12):
        t, c, s = _rotation(a11, a22, a12)
        a11, a22, a12 = a11 - t * a12, a22 + t * a12, none
        a01, a02 = c * a01 - s * a02, s * a01 + c * a02
        v, w = _combined(c, v, -s, w), _combined(s, v, c, w)
        left = a01 * a01 + a02 * a02
        if not any_less(OFF_DIAGONAL, left):
            break
        a01 = where_less(left, OFF_DIAGONAL, 0.0, a01)
        a02 = where_less(left, OFF_DIAGONAL, 0.0, a02)
        t, c, s = _rotation(a00, a11, a01)
        a00, a11, a01 = a00 - t * a01, a11 + t * a01, none
        a02, a12 = c * a02 - s * a12, s * a02 + c * a12
        u, v = _combined(c, u, -s, v), _combined(s, u, c, v)
        t, c, s = _rotation(a00, a22, a02)
        a00, a22, a02 = a00 - t * a02, a22 + t * a02, none
        a01, a12 = c * a01 - s * a12, s * a01 + c * a12
        u, w = _combined(c, u, -s, w), _combined(s, u, c, w)
    return (a00, a11, a22), u, v, w


@nb.njit(inline="always")
def _projection(v):
    """Return v x v (6,) of a vector."""
    return v[0] * v[0], v[1] * v[1], v[2] * v[2], v[0] * v[1], v[1] * v[2], v[0] * v[2]


@nb.njit(inline="always")
def _mixed(v, w):
    """Return v x w + w x v (6,) of two vectors."""
    x, y, z = 2.0 * v[0] * w[0], 2.0 * v[1] * w[1], 2.0 * v[2] * w[2]
    return x, y, z, v[0] * w[1] + v[1] * w[0], v[1] * w[2] + v[2] * w[1], v[0] * w[2] + v[2] * w[0]


@nb.njit(inline="always")
def _sum(a, x, b, y, c, z):
    """Return a x + b y + c z (6,)."""
    return (
        a * x[0] + b * y[0] + c * z[0],
        a * x[1] + b * y[1] + c * z[1],
        a * x[2] + b * y[2] + c * z[2],
        a * x[3] + b * y[3] + c * z[3],
        a * x[4] + b * y[4] + c * z[4],
        a * x[5] + b * y[5] + c * z[5],
    )


@nb.njit(inline="always")
def scaled(a, x):
    """Return a x (6,)."""
    return a * x[0], a * x[1], a * x[2], a * x[3], a * x[4], a * x[5]


@nb.njit(inline="always")
def added(x, y):
    """Return x + y (6,)."""
    return x[0] + y[0], x[1] + y[1], x[2] + y[2], x[3] + y[3], x[4] + y[4], x[5] + y[5]


@nb.njit(inline="always")
def with_mean(x, p):
    """Return x + p 1 (6,)."""
    return x[0] + p, x[1] + p, x[2] + p, x[3], x[4], x[5]


@nb.njit(inline="always")
def kirchhoff_stress(u, v, w, beta):
    """Return the stress (6,) of principal values beta (3,) along u, v and w."""
    return _sum(beta[0], _projection(u), beta[1], _projection(v), beta[2], _projection(w))


@nb.njit(inline="always")
def _shear(bi, bj, ti, tj, gii, gjj, gij):
    """Return (t_i b_j - t_j b_i) / (b_i - b_j), or its limit where the squares of stretches b are equal."""
    apart, close = bi - bj, 1e-5 * (bi + bj)
    limit = 0.5 * (0.5 * (gii + gjj) - gij) - 0.5 * (ti + tj)
    safe = where_less(abs(apart), close, 1.0, apart)
    return where_less(abs(apart), close, limit, (ti * bj - tj * bi) / safe)


@nb.njit(inline="always")
def _products(k, M, A, S, T):
    """Return the entries m = k, ... (6,) of sum M_k A_m + sum S_k T_m over three tensors each."""
    first = _sum(M[0][k], A[0], M[1][k], A[1], M[2][k], A[2])
    return added(first, _sum(S[0][k], T[0], S[1][k], T[1], S[2][k], T[2]))


@nb.njit(**ONCE)
def spatial_modulus(square, u, v, w, beta, gamma):
    """Return the spatial modulus (21,) of the isochoric Kirchhoff stress.

    square (3,) are the eigenvalues of F F^T (full, not isochoric: only their ratios enter), u, v and w its eigenvectors.
    """
    g00, g11, g22, g01, g02, g12 = gamma
    M = _projection(u), _projection(v), _projection(w)
    A = (
        _sum(g00 - 2.0 * beta[0], M[0], g01, M[1], g02, M[2]),
        _sum(g01, M[0], g11 - 2.0 * beta[1], M[1], g12, M[2]),
        _sum(g02, M[0], g12, M[1], g22 - 2.0 * beta[2], M[2]),
    )
    S = _mixed(u, v), _mixed(u, w), _mixed(v, w)
    h0 = _shear(square[0], square[1], beta[0], beta[1], g00, g11, g01)
    h1 = _shear(square[0], square[2], beta[0], beta[2], g00, g22, g02)
    h2 = _shear(square[1], square[2], beta[1], beta[2], g11, g22, g12)
    T = scaled(h0, S[0]), scaled(h1, S[1]), scaled(h2, S[2])
    d0, d1, d2 = _products(0, M, A, S, T), _products(1, M, A, S, T), _products(2, M, A, S, T)
    d3, d4, d5 = _products(3, M, A, S, T), _products(4, M, A, S, T), _products(5, M, A, S, T)
    return (*d0, *d1[1:], *d2[2:], *d3[3:], *d4[4:], d5[5])


@nb.njit(**ONCE)
def soften(W, beta, gamma, peak, amount, m, share):
    """Return the softened energy density, beta (3,) and gamma (6,) below the largest energy density so far.

    eta = 1 - amount erf((peak - W) / (m + share peak)), 1 beyond the peak (Ogden & Roxburgh 1999, doi
    10.1098/rspa.1999.0431, eqs. 27, 50); the energy is the integral of eta over W.
    """
    width = m + share * peak
    top = peak / width
    x = max(peak - W, 0.0) / width
    root = sqrt(pi)
    lost = top * erf(top) + (exp(-top * top) - exp(-x * x)) / root - x * erf(x)
    eta = 1.0 - amount * erf(x)
    slope = where_less(W, peak, 2.0 * amount / (root * width) * exp(-x * x), 0.0)  # d eta / dW
    b0, b1, b2 = beta
    softer = (
        eta * gamma[0] + slope * b0 * b0,
        eta * gamma[1] + slope * b1 * b1,
        eta * gamma[2] + slope * b2 * b2,
        eta * gamma[3] + slope * b0 * b1,
        eta * gamma[4] + slope * b0 * b2,
        eta * gamma[5] + slope * b1 * b2,
    )
    return W - amount * width * lost, (eta * b0, eta * b1, eta * b2), softer


@nb.njit(**ONCE)
def frozen_stress(f, J, size, H):
    """Return size F_bar H F_bar^T (6,) of a frozen material stress H (6,) without its mean, and that; f (9,) is F by rows.

    The first is the Kirchhoff stress of the energy H : (C_bar - I) / 2.
    """
    scale = size * exp(-2.0 / 3.0 * log(J))
    h0, h1, h2 = (H[0], H[3], H[5]), (H[3], H[1], H[4]), (H[5], H[4], H[2])
    f0, f1, f2 = f[:3], f[3:6], f[6:]
    x0, x1, x2 = _dot(h0, f0), _dot(h1, f0), _dot(h2, f0)
    y0, y1, y2 = _dot(h0, f1), _dot(h1, f1), _dot(h2, f1)
    z0, z1, z2 = _dot(h0, f2), _dot(h1, f2), _dot(h2, f2)
    x, y, z = (x0, x1, x2), (y0, y1, y2), (z0, z1, z2)
    T = scaled(scale, (_dot(f0, x), _dot(f1, y), _dot(f2, z), _dot(f1, x), _dot(f2, y), _dot(f2, x)))
    mean = (T[0] + T[1] + T[2]) / 3.0
    return with_mean(T, -mean), mean


@nb.njit(**ONCE)
def with_frozen_modulus(D, T, mean):
    """Return D (21,) and that of a frozen stress: 2 mean (I - 1/3 1 x 1) - 2/3 (T x 1 + 1 x T), T (6,) without its mean."""
    d0, d1, d2, d3, d4, d5 = T
    k = 2.0 / 3.0
    return (
        D[0] + 2.0 * mean - k * (2.0 * d0 + mean), D[1] - k * (d0 + d1 + mean), D[2] - k * (d0 + d2 + mean),
        D[3] - k * d3, D[4] - k * d4, D[5] - k * d5,
        D[6] + 2.0 * mean - k * (2.0 * d1 + mean), D[7] - k * (d1 + d2 + mean),
        D[8] - k * d3, D[9] - k * d4, D[10] - k * d5,
        D[11] + 2.0 * mean - k * (2.0 * d2 + mean),
        D[12] - k * d3, D[13] - k * d4, D[14] - k * d5,
        D[15] + mean, D[16], D[17], D[18] + mean, D[19], D[20] + mean,
    )  # fmt: skip


@nb.njit(inline="always")
def with_pressure(D, pj, local):
    """Return D (21,) with that of a pressure, p J (1 x 1 - 2 I), and local 1 x 1."""
    normal = pj + local
    return (
        D[0] + normal - 2.0 * pj, D[1] + normal, D[2] + normal, D[3], D[4], D[5],
        D[6] + normal - 2.0 * pj, D[7] + normal, D[8], D[9], D[10],
        D[11] + normal - 2.0 * pj, D[12], D[13], D[14],
        D[15] - pj, D[16], D[17], D[18] - pj, D[19], D[20] - pj,
    )  # fmt: skip
