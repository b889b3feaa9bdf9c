"""Yeoh's law: a polynomial of the first invariant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from gelforge.mechanics.laws.family import LinearFamily, first_invariant
from gelforge.mechanics.laws.law import check_constants
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.mechanics.laws.polynomial import PolynomialLaw
from gelforge.section import Positive


@dataclass(frozen=True)
class Yeoh(PolynomialLaw):
    r"""Yeoh's law W = sum_k C_k0 (I_1 - 3)^k, k = 1..3 (Yeoh 1993, doi 10.5254/1.3538343, eq. 4).

    The shear modulus is 2 C_10 > 0 [MPa]. C_20 is often negative (the stress-stretch curve is S-shaped), C_30 < 0 softens
    at large stretch; whether the model stays stable is a question of the range used (stability.check_stable).
    """

    C10: float
    C20: float
    C30: float

    name = "yeoh"

    def __post_init__(self):
        check_constants("Yeoh", positive={"C10": self.C10}, free={"C20": self.C20, "C30": self.C30})

    @property
    def point_constants(self):
        return self.C10, 0.0, self.C20, self.C30

    def stiffening_faster(self, factor):
        """I_1 - 3 is multiplied beyond the first order."""
        return Yeoh(self.C10, self.C20 * factor, self.C30 * factor**2)


class YeohFamily(LinearFamily):
    name, title, kind, free = "yeoh", "Yeoh", Yeoh, (False, True, False)
    parameters, logarithmic = ("C10_kPa", "C20_kPa", "C30_kPa"), (True, False, False)
    modulus_per_parameter = (6.0, 0.0, 0.0)
    bound_means = "the curves do not follow this model; try ogden2"

    def columns(self, points):
        x = points.I1 - 3
        return first_invariant(points)[:, None] * np.column_stack([np.ones_like(x), 2 * x, 3 * x**2])


FAMILY = YeohFamily()


class YeohParameters(GivenParameters):
    """Yeoh's model W = sum C_k0 (I1 - 3)^k, as in Abaqus and ANSYS; initial shear modulus 2 C10.

    C20 and C30 may be negative: an indentation is refused where the model is unstable at stretches that it may reach.
    """

    family = FAMILY
    law: Literal["yeoh"] = Field(description="constitutive model")
    C10_kPa: Positive = Field(description="C10, half the initial shear modulus, as in Abaqus and ANSYS [kPa]")
    C20_kPa: float = Field(0.0, description="C20, as in Abaqus and ANSYS [kPa]")
    C30_kPa: float = Field(0.0, description="C30, as in Abaqus and ANSYS [kPa]")


MODEL = Model(
    law=Yeoh,
    parameters=YeohParameters,
    families=(FAMILY,),
    formula="W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3, l1 l2 l3 = 1; E = 6 C10",
)
