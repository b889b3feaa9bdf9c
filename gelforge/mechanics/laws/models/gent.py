"""Gent's law: chains of limited extension."""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import Literal

import numpy as np
from pydantic import Field

from gelforge.mechanics.laws.family import Family, first_invariant
from gelforge.mechanics.laws.law import NEAREST_LIMIT, InvariantLaw, check_constants
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.section import Positive


def gent_point(constants, x, y):
    """Return W, W_1, W_2, W_11, W_12, W_22 [MPa] and the extension over its limit; constants mu [MPa], Jm."""
    mu, Jm = constants[0], constants[1]
    extension = x / Jm
    room = 1.0 - min(extension, NEAREST_LIMIT)
    energy = -0.5 * mu * Jm * log(room)
    return energy, 0.5 * mu / room, 0.0, 0.5 * mu / (Jm * room * room), 0.0, 0.0, extension


@dataclass(frozen=True)
class Gent(InvariantLaw):
    r"""Gent's law of limiting chain extension (Gent 1996, doi 10.5254/1.3538357, eq. 2).

    .. math:: W = -\frac{\mu J_m}{2} \ln\left(1 - \frac{I_1 - 3}{J_m}\right), \qquad I_1 - 3 < J_m.

    mu > 0 is the shear modulus [MPa], J_m > 0 the limit of I_1 - 3. Beyond it no stress exists: ValueError.
    """

    mu: float
    Jm: float

    name = "gent"
    point = staticmethod(gent_point)

    def __post_init__(self):
        check_constants("Gent", positive={"mu": self.mu, "Jm": self.Jm})

    @property
    def point_constants(self):
        return self.mu, self.Jm

    def stiffening_faster(self, factor):
        """I_1 - 3 is multiplied beyond the first order."""
        return Gent(self.mu, self.Jm / factor)

    def admissible(self, lam):
        lam = np.asarray(lam, dtype=float)
        return (lam**2).sum(axis=-1) - 3 < self.Jm

    def invariant_energy(self, I1, I2):
        return -self.mu * self.Jm / 2 * np.log1p(-self._extension(I1))

    def invariant_first(self, I1, I2):
        return self.mu / (2 * (1 - self._extension(I1))), 0.0

    def invariant_second(self, I1, I2):
        return self.mu / (2 * self.Jm * (1 - self._extension(I1)) ** 2), 0.0, 0.0

    def _extension(self, I1):
        x = (I1 - 3) / self.Jm
        if not (x < 1).all():
            raise ValueError(
                f"Gent: I_1 - 3 = {np.max(I1) - 3:.4g}, the chains' limit is Jm = {self.Jm:.4g};"
                " take a smaller stretch or step"
            )
        return x


class GentFamily(Family):
    """Gent's law; theta = (ln mu, ln Jm), Jm above every I_1 - 3 of the tests."""

    name, title, kind, simpler = "gent", "Gent", Gent, "neo_hooke"
    parameters, logarithmic = ("mu_kPa", "Jm"), (True, True)
    modulus_per_parameter = (3.0, 0.0)
    bound_means = "the curves show no limiting stretch; take neo_hooke, or test further"

    def law(self, theta):
        return Gent(*(float(v) for v in np.exp(theta)))

    def values(self, theta):
        values = np.exp(theta) * [1e3, 1.0]
        return values, np.diag(values)

    def unknowns(self, values):
        return np.log(values / [1e3, 1.0])

    def stress(self, points, theta):
        mu, Jm = np.exp(theta)
        share = (points.I1 - 3) / Jm
        stress = first_invariant(points) * mu / 2 / (1 - share)
        return stress, np.column_stack([stress, -stress * share / (1 - share)])

    def bounds(self, points, stiffness):
        reached = np.log((points.I1 - 3).max())
        low = [np.log(stiffness * 1e-4), reached + np.log(1.001)]
        # the law is neo-Hookean long before
        return np.array(low), np.array([np.log(stiffness * 1e4), reached + np.log(1e4)])

    def starts(self, points, weight, stress, stiffness):
        reached, starts = (points.I1 - 3).max(), []
        for factor in (1.02, 1.1, 1.5, 3.0, 10.0, 100.0):  # of Jm over the largest tested I_1 - 3
            unit = weight * self.stress(points, np.array([0.0, np.log(factor * reached)]))[0]
            mu = max((unit @ (weight * stress)) / (unit @ unit), stiffness * 1e-3)
            misfit = np.linalg.norm(mu * unit - weight * stress)
            starts.append((misfit, np.array([np.log(mu), np.log(factor * reached)])))
        return [theta for _, theta in sorted(starts, key=lambda s: s[0])]


FAMILY = GentFamily()


class GentParameters(GivenParameters):
    """Gent's model W = -mu Jm/2 ln(1 - (I1 - 3)/Jm), as in ANSYS; initial shear modulus mu."""

    family = FAMILY
    law: Literal["gent"] = Field(description="constitutive model")
    mu_kPa: Positive = Field(description="initial shear modulus [kPa]")
    Jm: Positive = Field(description="limit of I1 - 3 [-]")


MODEL = Model(
    law=Gent,
    parameters=GentParameters,
    families=(FAMILY,),
    formula="W = -mu Jm/2 ln(1 - (I1 - 3)/Jm), l1 l2 l3 = 1; E = 3 mu",
)
