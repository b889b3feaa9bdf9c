"""A constitutive model with a correction of its strain energy: what a fit of another form has left out.

.. math:: W = W_{model} + C_{20} (I_1 - 3)^2 + C_{30} (I_1 - 3)^3,

as the higher terms of Yeoh's model (Yeoh 1993, doi 10.5254/1.3538343): nothing at small strain, so the modulus is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.polynomial import PolynomialLaw


@dataclass(frozen=True)
class _Higher(PolynomialLaw):
    """The correction by itself."""

    C20: float  # MPa
    C30: float  # MPa

    @property
    def point_constants(self):
        return 0.0, 0.0, self.C20, self.C30


@dataclass(frozen=True)
class Corrected(PrincipalLaw):
    """A law with two more terms of its energy; the routine of a point is the law's own and these terms (`points`)."""

    law: PrincipalLaw
    C20: float  # MPa
    C30: float  # MPa

    def __post_init__(self):
        if isinstance(self.law, Corrected) or not np.isfinite([self.C20, self.C30]).all():
            raise ValueError(
                f"correction C20 {self.C20} MPa, C30 {self.C30} MPa of {type(self.law).__name__}; finite numbers and a"
                " law without a correction are needed"
            )

    @property
    def _higher(self) -> _Higher:
        return _Higher(self.C20, self.C30)

    @property
    def point_constants(self):
        return *self.law.point_constants, self.C20, self.C30

    @property
    def shear_modulus(self) -> float:
        return self.law.shear_modulus

    def description(self):
        return self.law.description() | {"C20_correction_MPa": self.C20, "C30_correction_MPa": self.C30}

    def stiffening_faster(self, factor):
        return Corrected(self.law.stiffening_faster(factor), self.C20, self.C30)

    def principal_energy(self, lam):
        return self.law.principal_energy(lam) + self._higher.principal_energy(lam)

    def principal_stress(self, lam):
        return self.law.principal_stress(lam) + self._higher.principal_stress(lam)

    def principal_tangent(self, lam):
        return self.law.principal_tangent(lam) + self._higher.principal_tangent(lam)

    def principal_slope(self, lam):
        return self.law.principal_slope(lam) + self._higher.principal_slope(lam)

    def admissible(self, lam):
        return self.law.admissible(lam)
