"""Demiray's model: stiffens exponentially."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Literal

import numpy as np
from pydantic import Field

from gelforge.mechanics.laws.family import Family, first_invariant
from gelforge.mechanics.laws.law import InvariantLaw, check_constants
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.section import Positive


def demiray_point(constants, x, y):
    """Return W, W_1, W_2, W_11, W_12, W_22 [MPa] and the extension over its limit, 0: there is none."""
    mu, b = constants[0], constants[1]
    grown = exp(b * x)
    return 0.5 * mu / b * (grown - 1.0), 0.5 * mu * grown, 0.0, 0.5 * mu * b * grown, 0.0, 0.0, 0.0


@dataclass(frozen=True)
class Demiray(InvariantLaw):
    r"""W = mu/(2 b) (exp(b (I_1 - 3)) - 1); mu > 0 is the shear modulus [MPa], b > 0 says how fast it stiffens."""

    mu: float
    b: float

    name = "demiray"
    point = staticmethod(demiray_point)

    def __post_init__(self):
        check_constants("Demiray", positive={"mu": self.mu, "b": self.b})

    @property
    def point_constants(self):
        return self.mu, self.b

    def stiffening_faster(self, factor):
        return Demiray(self.mu, self.b * factor)

    def invariant_energy(self, I1, I2):
        return self.mu / (2 * self.b) * np.expm1(self.b * (I1 - 3))

    def invariant_first(self, I1, I2):
        return self.mu / 2 * np.exp(self.b * (I1 - 3)), 0.0

    def invariant_second(self, I1, I2):
        return self.mu * self.b / 2 * np.exp(self.b * (I1 - 3)), 0.0, 0.0


class DemirayFamily(Family):
    """theta = (ln mu, ln b)."""

    name, title, kind = "demiray", "Demiray", Demiray
    parameters, logarithmic = ("mu_kPa", "b"), (True, True)
    modulus_per_parameter = (3.0, 0.0)
    bound_means = "the curves do not stiffen, or at once; try neo_hooke or gent"

    def law(self, theta):
        return Demiray(*(float(v) for v in np.exp(theta)))

    def values(self, theta):
        values = np.exp(theta) * [1e3, 1.0]
        return values, np.diag(values)

    def unknowns(self, values):
        return np.log(values / [1e3, 1.0])

    def stress(self, points, theta):
        mu, b = np.exp(theta)
        exponent = b * (points.I1 - 3)
        stress = first_invariant(points) * mu / 2 * np.exp(exponent)
        return stress, np.column_stack([stress, stress * exponent])

    def bounds(self, points, stiffness):
        reached = (points.I1 - 3).max()
        low, high = (stiffness * 1e-4, 1e-4 / reached), (stiffness * 1e4, 30.0 / reached)
        return np.log(low), np.log(high)

    def starts(self, points, weight, stress, stiffness):
        reached, found = (points.I1 - 3).max(), []
        for exponent in (0.01, 0.1, 1.0, 3.0):
            b = np.log(exponent / reached)
            unit = weight * self.stress(points, np.array([0.0, b]))[0]
            mu = max(unit @ (weight * stress) / (unit @ unit), stiffness * 1e-3)
            found.append((np.linalg.norm(mu * unit - weight * stress), np.array([np.log(mu), b])))
        return [theta for _, theta in sorted(found, key=lambda each: each[0])]


FAMILY = DemirayFamily()


class DemirayParameters(GivenParameters):
    """Demiray's model W = mu/(2 b) (exp(b (I1 - 3)) - 1); initial shear modulus mu."""

    family = FAMILY
    law: Literal["demiray"] = Field(description="constitutive model")
    mu_kPa: Positive = Field(description="initial shear modulus [kPa]")
    b: Positive = Field(description="how fast it stiffens [-]")


MODEL = Model(
    law=Demiray,
    parameters=DemirayParameters,
    families=(FAMILY,),
    formula="W = mu/(2 b) (exp(b (I1 - 3)) - 1), l1 l2 l3 = 1; E = 3 mu",
)
