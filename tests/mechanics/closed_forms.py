"""Closed forms of Ogden's law, written down by hand from textbooks; imports nothing of the package, so that
it can judge it.

Convention W = sum mu/alpha (l1^alpha + l2^alpha + l3^alpha - 3). Nominal stress of an incompressible sheet
whose faces are free (Ogden 1972, doi 10.1098/rspa.1972.0026, secs. 4-6; Holzapfel 2000, sec. 6.5).
"""

import math


def uniaxial(mu, alpha, lam):
    return sum(m * (lam ** (a - 1) - lam ** (-a / 2 - 1)) for m, a in zip(mu, alpha))


def pure_shear(mu, alpha, lam):
    return sum(m * (lam ** (a - 1) - lam ** (-a - 1)) for m, a in zip(mu, alpha))


def equibiaxial(mu, alpha, lam):
    return sum(m * (lam ** (a - 1) - lam ** (-2 * a - 1)) for m, a in zip(mu, alpha))


def neo_hooke_energy(shear_modulus, F):
    """Return mu/2 (J^(-2/3) F:F - 3) of nested lists F: Ogden's law with mu = shear modulus, alpha = 2."""
    (a, b, c), (d, e, f), (g, h, i) = F
    J = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return shear_modulus / 2 * (J ** (-2 / 3) * sum(x * x for row in F for x in row) - 3)


def simple_shear_stress(mu, alpha, gamma):
    """Return the shear stress sigma_12 of Ogden's law in simple shear F = I + gamma e1 x e2.

    l1 = (gamma + sqrt(gamma^2 + 4)) / 2 = 1 / l2; sigma_12 = dW/dgamma = sum mu (l1^a - l1^-a) / (l1 + 1 /
    l1).
    """
    lam = (gamma + math.sqrt(gamma**2 + 4)) / 2
    return sum(m * (lam**a - lam**-a) for m, a in zip(mu, alpha)) / (lam + 1 / lam)
