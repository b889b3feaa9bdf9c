"""The section of a configuration that gives a constitutive model's parameters; each model has its own."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import model_validator

from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.section import Section

# Keys with which other programs state compressibility, which belongs to mechanics here
COMPRESSIBILITY = {"D1", "D2", "D3", "D", "d", "d1", "K", "nu", "K_kPa", "D1_kPa", "D1_per_kPa"}


class GivenParameters(Section):
    """Parameters of a constitutive model that are given; all are of the incompressible (isochoric) part."""

    family: ClassVar[Family]  # whose parameters the keys are

    @model_validator(mode="before")
    @classmethod
    def _isochoric_only(cls, content):
        keys = sorted(COMPRESSIBILITY & set(content)) if isinstance(content, dict) else []
        if keys:
            raise ValueError(
                f"{keys} state(s) compressibility, which is mechanics.bulk_to_shear (K/mu; for D1 of Abaqus or d of ANSYS "
                "2 / (D1 mu), and D1 = 0 is incompressible: leave the default); take the key(s) out"
            )
        return content

    def constitutive_model(self) -> PrincipalLaw:
        """Return the law [MPa] of these parameters."""
        return self.family.law_of(np.array([getattr(self, name) for name in self.family.parameters]))
