"""Polynomials of the invariants, which neo-Hooke, Mooney-Rivlin, Yeoh and the correction of an energy share."""

from __future__ import annotations

from gelforge.mechanics.laws.law import InvariantLaw


def polynomial_point(constants, x, y):
    """Return W, W_1, W_2, W_11, W_12, W_22 [MPa] and the extension over its limit, 0: there is none.

    constants: C10, C01, C20, C30 [MPa] of W = C10 x + C01 y + C20 x^2 + C30 x^3.
    """
    C10, C01, C20, C30 = constants[0], constants[1], constants[2], constants[3]
    energy = x * (C10 + x * (C20 + x * C30)) + C01 * y
    return energy, C10 + x * (2.0 * C20 + x * 3.0 * C30), C01, 2.0 * C20 + 6.0 * C30 * x, 0.0, 0.0, 0.0


class PolynomialLaw(InvariantLaw):
    """A law W = C10 (I_1 - 3) + C01 (I_2 - 3) + C20 (I_1 - 3)^2 + C30 (I_1 - 3)^3 by its point_constants, in that order."""

    point = staticmethod(polynomial_point)

    def invariant_energy(self, I1, I2):
        C10, C01, C20, C30 = self.point_constants
        x = I1 - 3
        return x * (C10 + x * (C20 + x * C30)) + C01 * (I2 - 3)

    def invariant_first(self, I1, I2):
        C10, C01, C20, C30 = self.point_constants
        x = I1 - 3
        return C10 + x * (2 * C20 + x * 3 * C30), C01

    def invariant_second(self, I1, I2):
        *_, C20, C30 = self.point_constants
        return 2 * C20 + 6 * C30 * (I1 - 3), 0.0, 0.0
