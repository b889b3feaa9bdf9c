"""Hencky's law of the logarithmic strain: a second law of the stretches themselves, next to Ogden's."""

from dataclasses import dataclass
from math import log
from typing import Literal

import numpy as np

from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.section import Positive


def hencky_point(constants, lam):
    mu = constants[0]
    e0, e1, e2 = log(lam[0]), log(lam[1]), log(lam[2])
    mean, own, other = (e0 + e1 + e2) / 3.0, 4.0 / 3.0 * mu, -2.0 / 3.0 * mu
    beta = 2.0 * mu * (e0 - mean), 2.0 * mu * (e1 - mean), 2.0 * mu * (e2 - mean)
    return mu * (e0**2 + e1**2 + e2**2), beta, (own, own, own, other, other, other), 0.0


@dataclass(frozen=True)
class Hencky(PrincipalLaw):
    """W = mu sum (ln lam_i)^2."""

    mu: float

    name = "hencky"
    point = staticmethod(hencky_point)

    @property
    def point_constants(self):
        return (self.mu,)

    @property
    def shear_modulus(self):
        return self.mu

    def principal_energy(self, lam):
        return self.mu * (np.log(lam) ** 2).sum(axis=-1)

    def principal_stress(self, lam):
        return 2 * self.mu * np.log(lam)

    def principal_tangent(self, lam):
        return np.broadcast_to(2 * self.mu * np.eye(3), (*lam.shape, 3))

    def principal_slope(self, lam):
        return np.full((*lam.shape, 3), 2 * self.mu)


class HenckyParameters(GivenParameters):
    law: Literal["hencky"]
    mu_kPa: Positive

    def constitutive_model(self):
        return Hencky(self.mu_kPa / 1e3)


MODEL = Model(law=Hencky, parameters=HenckyParameters, families=(), formula="W = mu sum (ln l)^2; E = 3 mu")
