"""The laws and bulk moduli of the mesh's regions."""

from __future__ import annotations

import numpy as np

from gelforge.config import ConfigError, Effects, Mechanics, Sensor
from gelforge.config.parts.effects import EnergyCorrection
from gelforge.mechanics.bodies.body import bulk_to_shear_of
from gelforge.mechanics.laws.corrected import Corrected
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.laws.stability import UnstableLaw, check_stable

OF_TOP = ("wall", "flange")  # regions of the top layer's material
# Logarithmic strain of an element over the compression that layers in series take: the most that was measured in solutions
# with balls of radius 2 to 8 mm, a flat cylinder and 1 to 3 layers of 4 mm, soft under, over and between stiff ones, at
# 0.13 to 0.5 of their height, elements of 0.5 mm. The softest layer's was 0.3 to 1.17 and 0.4 to 1.87.
STRETCHING, COMPRESSION = 1.2, 1.9
# Measured with elements of 0.3 instead of 0.6 mm: strains at 0.3 of the height grow by 1 % or less under a ball on two
# layers and by 7 % on one; points inside an element are strained more than its mean, and other sensors may be beyond those
# tried.
MARGIN = 1.1


def by_region(values: dict, regions: tuple[str, ...], top: str, default) -> dict:
    """Return the value of each region; wall and flange follow the top layer unless they are named."""
    of_top = dict.fromkeys(OF_TOP, values.get(top, default))
    return {name: values.get(name, of_top.get(name, default)) for name in regions}


def region_laws(
    sensor: Sensor, effects: Effects, regions: tuple[str, ...], laws: dict[str, PrincipalLaw]
) -> dict[str, PrincipalLaw]:
    """Return the constitutive model of each region of the mesh.

    Parameters
    ----------
    sensor : Sensor
        Its layers.
    effects : Effects
        Linear models, exponents, corrections and the elastic base.
    regions : tuple of str
        Names of the layers, and wall, flange and base where there are some.
    laws : dict of str to PrincipalLaw
        By layer [MPa]; wall and flange follow the top layer unless they are named.

    Returns
    -------
    dict of str to PrincipalLaw
        By region [MPa].
    """
    top, material, base = sensor.layers[-1].name, effects.material, effects.geometry.base
    chosen = {name: laws.get(name, laws[top]) for name in regions if name != "base"}
    if "base" in regions:  # rigid: held itself, its law never matters
        assert base is not None  # it has made the region
        chosen["base"] = NeoHooke((base.youngs_modulus_MPa or 1.0) / 3)
    if material.linear_law:  # its stress is linear in b: nothing stiffens or softens
        chosen = {name: NeoHooke(law.shear_modulus) for name, law in chosen.items()}
    factors = by_region(material.exponent_factor, regions, top, 1.0)
    chosen = {name: law.with_exponents(factors[name]) for name, law in chosen.items()}
    more = by_region(material.energy_correction, regions, top, None)
    return {name: _corrected(law, more[name]) for name, law in chosen.items()}


def _corrected(law: PrincipalLaw, more: EnergyCorrection | None) -> PrincipalLaw:
    """Return a law with more terms of its energy; itself where there are none."""
    if more is None or not (more.c2 or more.c3):
        return law
    half = law.shear_modulus / 2
    return Corrected(law, more.c2 * half, more.c3 * half)


def region_bulk(sensor: Sensor, mechanics: Mechanics, regions: tuple[str, ...]) -> dict[str, float]:
    """Return the bulk modulus over the shear modulus of each region.

    Parameters
    ----------
    sensor : Sensor
        Its layers.
    mechanics : Mechanics
        `bulk_to_shear`, and effects that replace it in regions.
    regions : tuple of str
        As of `region_laws`.

    Returns
    -------
    dict of str to float
        K/mu by region.
    """
    material = mechanics.effects.material
    by_ratio = {name: bulk_to_shear_of(nu) for name, nu in material.poissons_ratio.items()}
    return by_region(
        material.bulk_to_shear | by_ratio, regions, sensor.layers[-1].name, mechanics.bulk_to_shear
    )


def stretches_ahead(
    sensor: Sensor, effects: Effects, laws: dict[str, PrincipalLaw], regions: tuple[str, ...], share: float
) -> dict[str, tuple[float, float]]:
    """Return by region the smallest and largest principal stretch that an indentation may reach; laws are given by layer.

    share: of the soft height that the indenter really presses. Layers in series take it by their compliance h / mu, so a
    soft layer among stiff ones is strained more than the whole: e = share max(1, w H / h), and the stretches are
    exp(-COMPRESSION e) and exp(STRETCHING e), each with MARGIN. A residual stretch of any region strains its neighbours too.
    """
    layers, factors = sensor.layers, effects.material.stiffness_factor
    mu = np.array([laws[layer.name].shear_modulus * factors.get(layer.name, 1.0) for layer in layers])
    thickness = np.array([layer.thickness_mm for layer in layers])
    strained = np.maximum(1.0, thickness.sum() / mu / (thickness / mu).sum())
    residual = [s for x, y in effects.geometry.prestretch.values() for s in (x, y, 1 / (x * y))] + [1.0]
    stretches = {}
    for name in regions:
        factor = dict(zip([layer.name for layer in layers], strained)).get(name, 1.0)
        e = MARGIN * max(share, 0.0) * factor
        smallest, largest = min(residual) * np.exp(-COMPRESSION * e), max(residual) * np.exp(STRETCHING * e)
        stretches[name] = float(smallest), float(largest)
    return stretches


def check_laws(laws: dict[str, PrincipalLaw], stretches: dict[str, tuple[float, float]]) -> None:
    """Refuse laws that are unstable, or have no stress, between the smallest and largest stretch of their region."""
    for name, law in laws.items():
        try:
            check_stable(law, *stretches[name], name)
        except UnstableLaw as error:
            raise ConfigError(str(error)) from None
