"""Initial moduli of constitutive models in words, and the question about those that no soft sensor has."""

from __future__ import annotations

from gelforge.config import ConfigError
from gelforge.materials.fitting.law_file import MaterialLaw
from gelforge.mechanics.laws.law import PrincipalLaw

# Young's moduli [kPa] of what soft sensors are cast from: the softest gels have about 1 kPa, hard silicones and
# polyurethanes 5 MPa. A modulus in Pa or MPa instead of kPa, 1000 times off, lies beyond one end for almost all of them
# (tests/materials/test_stiffness.py).
PLAUSIBLE_KPA = (0.5, 5000.0)


def stiffness_words(law: PrincipalLaw) -> str:
    """Return the initial moduli of a constitutive model in words.

    Parameters
    ----------
    law : PrincipalLaw
        Moduli in MPa.

    Returns
    -------
    str
        Initial shear and Young's modulus in kPa, to four digits.
    """
    G, E = (float(f"{1e3 * modulus:.4g}") for modulus in (law.shear_modulus, law.youngs_modulus))
    return f"initial shear modulus {G:.10g} kPa, Young's modulus {E:.10g} kPa"


def check_stiffness(material: MaterialLaw, confirmed: bool) -> None:
    """Refuse a constitutive model whose initial Young's modulus is not plausible, unless it is confirmed.

    Parameters
    ----------
    material : MaterialLaw
        Moduli in MPa.
    confirmed : bool
        The stiffness is meant.

    Raises
    ------
    ConfigError
        Names the modulus, the limits, the unit that was probably meant, and the key that confirms it.
    """
    low, high = PLAUSIBLE_KPA
    E = 1e3 * material.law.youngs_modulus
    if confirmed or low <= E <= high:
        return
    unit, factor = ("Pa", 1e-3) if E > high else ("MPa", 1e3)
    likely = f"; are its moduli in {unit}? write them in kPa" if low <= factor * E <= high else ""
    source = "parameters" if material.samples is None else "tests"
    raise ConfigError(
        f"materials.{material.material}: {stiffness_words(material.law)}, plausible are {low:g} to {high:g} kPa for Young's"
        f" modulus{likely}; correct its {source}, or set stiffness_confirmed: true if it is meant"
    )
