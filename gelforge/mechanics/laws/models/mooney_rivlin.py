"""The Mooney-Rivlin law: linear in both invariants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from gelforge.mechanics.laws.family import LinearFamily, first_invariant
from gelforge.mechanics.laws.law import check_constants
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.mechanics.laws.polynomial import PolynomialLaw
from gelforge.section import Positive


@dataclass(frozen=True)
class MooneyRivlin(PolynomialLaw):
    r"""The Mooney-Rivlin law W = C_10 (I_1 - 3) + C_01 (I_2 - 3) (Mooney 1940, doi 10.1063/1.1712836).

    C_10 > 0 and C_01 >= 0 [MPa] make it stable at every deformation; the shear modulus is 2 (C_10 + C_01).
    """

    C10: float
    C01: float

    name = "mooney_rivlin"

    def __post_init__(self):
        check_constants("Mooney-Rivlin", positive={"C10": self.C10}, not_negative={"C01": self.C01})

    @property
    def point_constants(self):
        return self.C10, self.C01, 0.0, 0.0

    def stiffening_faster(self, factor):
        terms = [(2 * C, a) for C, a in ((self.C10, 2.0), (-self.C01, -2.0)) if C]
        return Ogden(*zip(*terms)).stiffening_faster(factor)


class MooneyRivlinFamily(LinearFamily):
    name, title, kind, free = "mooney_rivlin", "Mooney-Rivlin", MooneyRivlin, (False, False)
    parameters, logarithmic = ("C10_kPa", "C01_kPa"), (True, False)
    modulus_per_parameter = (6.0, 6.0)
    bound_means = "the curves do not follow this model; try ogden1"

    def columns(self, points):
        l1, l3 = points.lam[:, 0], points.lam[:, 2]
        return np.column_stack([first_invariant(points), 2 * points.scale * (l3**-2 - l1**-2)])


FAMILY = MooneyRivlinFamily()


class MooneyRivlinParameters(GivenParameters):
    """The Mooney-Rivlin model W = C10 (I1 - 3) + C01 (I2 - 3), as in Abaqus, ANSYS; initial shear modulus 2 (C10 + C01)."""

    family = FAMILY
    law: Literal["mooney_rivlin"] = Field(description="constitutive model")
    C10_kPa: Positive = Field(description="C10, as in Abaqus and ANSYS [kPa]")
    C01_kPa: float = Field(description="C01, as in Abaqus and ANSYS [kPa]")

    @model_validator(mode="after")
    def _stable(self):
        if self.C01_kPa < 0:
            raise ValueError(
                f"C01_kPa {self.C01_kPa:g}: with C01 < 0 the stiffness falls without limit in compression; C01 >= 0 is "
                "needed, describe the tests by law: yeoh or ogden instead"
            )
        return self


MODEL = Model(
    law=MooneyRivlin,
    parameters=MooneyRivlinParameters,
    families=(FAMILY,),
    formula="W = C10 (I1 - 3) + C01 (I2 - 3), I2 = l1^-2 + l2^-2 + l3^-2, l1 l2 l3 = 1; E = 6 (C10 + C01)",
)
