"""A law whose energy mixes the invariants: W_12 and W_22 are not zero."""

from dataclasses import dataclass
from typing import Literal

from gelforge.mechanics.laws.law import InvariantLaw
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.section import Positive


def mixed_point(constants, x, y):
    c, d, e = constants[0], constants[1], constants[2]
    return c * x + d * x * y + e * y * y, c + d * y, d * x + 2.0 * e * y, 0.0, d, 2.0 * e, 0.0


@dataclass(frozen=True)
class Mixed(InvariantLaw):
    """W = c (I1 - 3) + d (I1 - 3) (I2 - 3) + e (I2 - 3)^2."""

    c: float
    d: float
    e: float

    name = "mixed"
    point = staticmethod(mixed_point)

    @property
    def point_constants(self):
        return self.c, self.d, self.e

    def invariant_energy(self, I1, I2):
        return self.c * (I1 - 3) + self.d * (I1 - 3) * (I2 - 3) + self.e * (I2 - 3) ** 2

    def invariant_first(self, I1, I2):
        return self.c + self.d * (I2 - 3), self.d * (I1 - 3) + 2 * self.e * (I2 - 3)

    def invariant_second(self, I1, I2):
        return 0.0, self.d, 2 * self.e


class MixedParameters(GivenParameters):
    law: Literal["mixed"]
    c_kPa: Positive

    def constitutive_model(self):
        return Mixed(self.c_kPa / 1e3, 0.0, 0.0)


MODEL = Model(law=Mixed, parameters=MixedParameters, families=(), formula="W = c (I1 - 3) + ...; E = 6 c")
