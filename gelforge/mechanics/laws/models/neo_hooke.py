"""The neo-Hookean law: one modulus, nothing stiffens or softens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from gelforge.mechanics.laws.family import LinearFamily, first_invariant
from gelforge.mechanics.laws.law import check_constants
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.mechanics.laws.polynomial import PolynomialLaw
from gelforge.section import Positive


@dataclass(frozen=True)
class NeoHooke(PolynomialLaw):
    r"""The neo-Hookean law W = mu/2 (I_1 - 3) (Treloar 1943); mu > 0 is the shear modulus [MPa]."""

    mu: float

    name = "neo_hooke"

    def __post_init__(self):
        check_constants("Neo-Hooke", positive={"mu": self.mu})

    @property
    def point_constants(self):
        return self.mu / 2, 0.0, 0.0, 0.0

    def stiffening_faster(self, factor):
        return Ogden((self.mu,), (2.0,)).stiffening_faster(factor)


class NeoHookeFamily(LinearFamily):
    name, title, kind, free = "neo_hooke", "Neo-Hooke", NeoHooke, (False,)
    parameters, logarithmic = ("mu_kPa",), (True,)
    modulus_per_parameter = (3.0,)
    bound_means = "check the sign of the stress"

    def columns(self, points):
        return first_invariant(points)[:, None] / 2


FAMILY = NeoHookeFamily()


class NeoHookeParameters(GivenParameters):
    """The neo-Hookean model W = mu/2 (I1 - 3); C10 of Abaqus is mu/2, mu of ANSYS is mu."""

    family = FAMILY
    law: Literal["neo_hooke"] = Field(description="constitutive model")
    mu_kPa: Positive = Field(description="initial shear modulus, twice the C10 of Abaqus [kPa]")


MODEL = Model(
    law=NeoHooke,
    parameters=NeoHookeParameters,
    families=(FAMILY,),
    formula="W = mu/2 (I1 - 3), I1 = l1^2 + l2^2 + l3^2, l1 l2 l3 = 1; E = 3 mu",
)
