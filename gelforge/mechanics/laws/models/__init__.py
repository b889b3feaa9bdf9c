"""The constitutive models: every file of this folder is one and defines `MODEL`."""

from __future__ import annotations

import numpy as np

from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.registry import defined, names_in

MODELS: dict[str, Model] = {name: defined(__name__, name, "MODEL", Model) for name in names_in(__path__)}
FAMILIES: dict[str, Family] = {family.name: family for model in MODELS.values() for family in model.families}


def family_of(law: PrincipalLaw) -> Family:
    """Return the family of a constitutive model.

    Parameters
    ----------
    law : PrincipalLaw
        Such as an Ogden model of two terms.

    Returns
    -------
    Family
        It fits models of this kind.

    Raises
    ------
    ValueError
        For a model that cannot be fitted.
    """
    family = next((family for family in FAMILIES.values() if family.holds(law)), None)
    if family is None:
        raise ValueError(f"{law} is of no family that can be fitted; one of {', '.join(FAMILIES)} is needed")
    return family


def parameters_of(law: PrincipalLaw) -> np.ndarray:
    """Return the parameters of a constitutive model in the units of files.

    Parameters
    ----------
    law : PrincipalLaw
        Moduli in MPa.

    Returns
    -------
    numpy.ndarray
        (p,) in the order of its family; moduli in kPa.

    Raises
    ------
    ValueError
        For a model that cannot be fitted.
    """
    return family_of(law).parameters_of(law)


def section_of(law: PrincipalLaw) -> GivenParameters:
    """Return the section of a configuration that gives a law: its constants under their keys, moduli in kPa.

    Parameters
    ----------
    law : PrincipalLaw
        One of MODELS, moduli in MPa.

    Returns
    -------
    GivenParameters
        The section of the law's own kind, validated.
    """
    section = MODELS[law.name].parameters
    keys = [key for key in section.model_fields if hasattr(law, key.removesuffix("_kPa"))]
    constants = {
        key: np.multiply(getattr(law, key.removesuffix("_kPa")), 1e3 if key.endswith("_kPa") else 1).tolist()
        for key in keys
    }
    return section.model_validate({"law": law.name, **constants})
