"""The laws and bulk moduli of the mesh's regions."""

from __future__ import annotations

from gelforge.config import ConfigError, Effects, Mechanics, Sensor
from gelforge.mechanics.body import bulk_to_shear_of
from gelforge.mechanics.law_changes import neo_hookean, with_exponents
from gelforge.mechanics.laws import NeoHooke, PrincipalLaw
from gelforge.mechanics.stability import UnstableLaw, check_stable

OF_TOP = ("wall", "flange")  # regions of the top layer's material
# Largest principal stretch of an element's mean deformation over the depth's share of the soft height, in the presses of
# this project's sensors: 1.18 to 1.32 at a share of 0.3. A law must be stable at least that far; how far it is really used
# is stored with the cell.
STRETCH_PER_SHARE = 1.0


def by_region(values: dict, regions: tuple[str, ...], top: str, default) -> dict:
    """Return the value of each region; wall and flange follow the top layer unless they are named."""
    return {
        name: values.get(name, values.get(top, default) if name in OF_TOP else default) for name in regions
    }


def region_laws(
    sensor: Sensor, effects: Effects, regions: tuple[str, ...], laws: dict[str, PrincipalLaw]
) -> dict[str, PrincipalLaw]:
    """Return the law [MPa] of each region of the mesh; laws are given by layer."""
    top, material, base = sensor.layers[-1].name, effects.material, effects.geometry.base
    chosen = {name: laws.get(name, laws[top]) for name in regions if name != "base"}
    if "base" in regions:  # rigid: held itself, its law is never felt
        chosen["base"] = NeoHooke((base.youngs_modulus_MPa or 1.0) / 3)
    if material.linear_law:
        chosen = {name: neo_hookean(law) for name, law in chosen.items()}
    factors = by_region(material.exponent_factor, regions, top, 1.0)
    return {name: with_exponents(law, factors[name]) for name, law in chosen.items()}


def region_bulk(sensor: Sensor, mechanics: Mechanics, regions: tuple[str, ...]) -> dict[str, float]:
    """Return the bulk modulus over the shear modulus of each region."""
    material = mechanics.effects.material
    given = material.bulk_to_shear | {
        name: bulk_to_shear_of(nu) for name, nu in material.poissons_ratio.items()
    }
    return by_region(given, regions, sensor.layers[-1].name, mechanics.bulk_to_shear)


def check_laws(laws: dict[str, PrincipalLaw], depth_mm: float, height_mm: float) -> None:
    """Refuse laws that are unstable, or have no stress, at the stretches that a press of this depth reaches."""
    largest = 1 + STRETCH_PER_SHARE * depth_mm / height_mm
    for name, law in laws.items():
        try:
            check_stable(law, largest, name)
        except UnstableLaw as error:
            raise ConfigError(str(error)) from None
