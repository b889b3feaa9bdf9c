"""A constitutive model as one file of `models` defines it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.parameters import GivenParameters


@dataclass(frozen=True)
class Model:
    """All that the package knows about a constitutive model, under the name of its law."""

    law: type[PrincipalLaw]
    parameters: type[GivenParameters]  # the section of a configuration that gives them
    families: tuple[Family, ...]  # what can be fitted
    formula: str  # energy and Young's modulus, as law.json states them

    @property
    def name(self) -> str:
        """Return the name in files and configurations, which is also that of its file."""
        return self.law.name

    def of_file(self, content: dict) -> PrincipalLaw:
        """Return the law [MPa] that the content of a law.json states. Raises ValueError for parameters of no family."""
        values = self.law.parameters_of_file(content)
        family = next((f for f in self.families if set(f.parameters) == set(values)), None)
        if family is None:
            known = " or ".join(str(list(f.parameters)) for f in self.families)
            raise ValueError(f"parameters {list(values)}; {self.name} has {known}")
        return family.law_of(np.array([values[name] for name in family.parameters]))
