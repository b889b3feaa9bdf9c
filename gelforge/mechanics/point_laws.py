r"""Compiled twins of the laws: principal stresses and their slopes at one point.

A routine serves a family: given the isochoric stretches it fills

.. math:: \beta_i = \mathrm{dev}\, \frac{\partial W}{\partial\ln\lambda_i}, \qquad
    \gamma_{ij} = \frac{\partial\beta_i}{\partial\ln\lambda_j} \text{ (both indices without their mean)}

and returns the energy and how far the point is on its way to the law's limit of extension (1: reached; 0: no limit).
"""

from __future__ import annotations

from math import exp, log

import numba as nb

from gelforge.mechanics.laws import OGDEN, POLYNOMIAL

# Beyond this share of a limiting extension stress and slope stay what they are there: finite numbers for an iterate that
# is never accepted. A state so close to the limit has 10^4 times the modulus at rest.
NEAREST_LIMIT = 1 - 1e-4


@nb.njit(cache=True, inline="always")
def principal_stress(law, constants, lam, beta, gamma):
    """Fill beta (3,) [MPa] and gamma (3, 3) [MPa] at lam (3,); return (energy [MPa], extension over its limit)."""
    if law == OGDEN:
        return _ogden(constants, lam, beta, gamma), 0.0
    I1 = 0.0
    I2 = 0.0
    for i in range(3):
        square = lam[i] * lam[i]
        beta[i] = square  # until the invariants' slopes need the place
        I1 += square
        I2 += 1.0 / square
    x = I1 - 3.0
    extension = 0.0
    W2 = 0.0
    if law == POLYNOMIAL:
        C10, C01, C20, C30 = constants[0], constants[1], constants[2], constants[3]
        energy = x * (C10 + x * (C20 + x * C30)) + C01 * (I2 - 3.0)
        W1 = C10 + x * (2.0 * C20 + x * 3.0 * C30)
        W2 = C01
        W11 = 2.0 * C20 + 6.0 * C30 * x
    else:  # GENT
        mu, Jm = constants[0], constants[1]
        extension = x / Jm
        room = 1.0 - min(extension, NEAREST_LIMIT)
        energy = -0.5 * mu * Jm * log(room)
        W1 = 0.5 * mu / room
        W11 = 0.5 * mu / (Jm * room * room)
    # f_i, g_i: dI1/d ln lam_i and dI2/d ln lam_i without their means; their own slopes are 2 f and -2 g before that.
    for i in range(3):
        fi = 2.0 * (beta[i] - I1 / 3.0)
        di = 4.0 * (W1 * beta[i] + W2 / beta[i])
        for j in range(i, 3):
            fj = 2.0 * (beta[j] - I1 / 3.0)
            dj = 4.0 * (W1 * beta[j] + W2 / beta[j])
            slope = 4.0 * (W1 * I1 + W2 * I2) / 9.0 - (di + dj) / 3.0 + W11 * fi * fj
            if i == j:
                slope += di
            gamma[i, j] = slope
            gamma[j, i] = slope
    for i in range(3):
        beta[i] = 2.0 * W1 * (beta[i] - I1 / 3.0) - 2.0 * W2 * (1.0 / beta[i] - I2 / 3.0)
    return energy, extension


@nb.njit(cache=True, inline="always")
def _ogden(constants, lam, beta, gamma):
    energy = 0.0
    log0, log1, log2 = log(lam[0]), log(lam[1]), log(lam[2])  # one logarithm serves all powers
    for i in range(3):
        beta[i] = 0.0
        for j in range(3):
            gamma[i, j] = 0.0
    for k in range(constants.shape[0] // 2):
        m = constants[2 * k]
        if m == 0.0:
            continue
        a = constants[2 * k + 1]
        p0 = exp(a * log0)
        p1 = exp(a * log1)
        p2 = exp(a * log2)
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
