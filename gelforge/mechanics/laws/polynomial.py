"""The point routine of polynomials of the invariants, which neo-Hooke, Mooney-Rivlin and Yeoh share."""


def polynomial_point(constants, x, y):
    """Return W, W_1, W_2, W_11, W_12, W_22 [MPa] and the extension over its limit, 0: there is none.

    constants: C10, C01, C20, C30 [MPa] of W = C10 x + C01 y + C20 x^2 + C30 x^3.
    """
    C10, C01, C20, C30 = constants[0], constants[1], constants[2], constants[3]
    energy = x * (C10 + x * (C20 + x * C30)) + C01 * y
    return energy, C10 + x * (2.0 * C20 + x * 3.0 * C30), C01, 2.0 * C20 + 6.0 * C30 * x, 0.0, 0.0, 0.0
