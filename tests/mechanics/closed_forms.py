"""Closed forms of the laws, written down by hand from textbooks; imports nothing of the package, so that it can
judge it.

Stress in the four load cases of an incompressible sheet whose faces are free: nominal stress along the load,
Cauchy shear stress sigma_12 in simple shear (where the "stretch" is the amount of shear gamma). Ogden's law in the
convention W = sum mu/alpha (l1^alpha + l2^alpha + l3^alpha - 3) from Ogden 1972 (doi 10.1098/rspa.1972.0026,
secs. 4-6), laws of the invariants from Rivlin 1948 (Treloar 1975, sec. 5; Holzapfel 2000, sec. 6.5).
"""


def ogden(case, lam, mu, alpha):
    if case == "simple_shear":  # l1 = (gamma + sqrt(gamma^2 + 4)) / 2 = 1 / l2; sigma_12 = dW/dgamma
        l1 = (lam + (lam**2 + 4) ** 0.5) / 2
        return sum(m * (l1**a - l1**-a) for m, a in zip(mu, alpha)) / (l1 + 1 / l1)
    thinning = {"uniaxial": 0.5, "pure_shear": 1.0, "equibiaxial": 2.0}[case]  # l3 = lam^-thinning
    return sum(m * (lam ** (a - 1) - lam ** (-thinning * a - 1)) for m, a in zip(mu, alpha))


def neo_hooke(case, lam, mu):
    return _rivlin(case, lam, lambda I1, I2: (mu / 2, 0))


def mooney_rivlin(case, lam, C10, C01):
    return _rivlin(case, lam, lambda I1, I2: (C10, C01))


def yeoh(case, lam, C10, C20, C30):
    return _rivlin(case, lam, lambda I1, I2: (C10 + 2 * C20 * (I1 - 3) + 3 * C30 * (I1 - 3) ** 2, 0))


def gent(case, lam, mu, Jm):
    return _rivlin(case, lam, lambda I1, I2: (mu / 2 * Jm / (Jm - I1 + 3), 0))


def _rivlin(case, lam, derivatives):
    """Rivlin's formulas with W1, W2 = derivatives(I1, I2)."""
    if case == "uniaxial":
        W1, W2 = derivatives(lam**2 + 2 / lam, 2 * lam + lam**-2.0)
        return 2 * (lam - lam**-2.0) * (W1 + W2 / lam)
    if case == "pure_shear":
        W1, W2 = derivatives(lam**2 + 1 + lam**-2.0, lam**2 + 1 + lam**-2.0)
        return 2 * (lam - lam**-3.0) * (W1 + W2)
    if case == "equibiaxial":
        W1, W2 = derivatives(2 * lam**2 + lam**-4.0, 2 * lam**-2.0 + lam**4)
        return 2 * (lam - lam**-5.0) * (W1 + lam**2 * W2)
    W1, W2 = derivatives(3 + lam**2, 3 + lam**2)  # simple shear
    return 2 * (W1 + W2) * lam


def neo_hooke_energy(shear_modulus, F):
    """Return mu/2 (J^(-2/3) F:F - 3) of nested lists F: Ogden's law with mu = shear modulus, alpha = 2."""
    (a, b, c), (d, e, f), (g, h, i) = F
    J = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return shear_modulus / 2 * (J ** (-2 / 3) * sum(x * x for row in F for x in row) - 3)
