"""The effects that the finite elements know, by the names that a verdict uses: parameter, unit, plausible width, entry.

`apply(study, amount, place)` returns the study with a value of the effect; amount 0 gives the plain study's forces bit
for bit (where the mesh changes: those of the plain study on the same mesh). Effects of the force sensor, the clock and the
camera are no matter of the finite elements and not here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gelforge.config import Study, changed_study
from gelforge.indentation.effects.fields import (
    LOST,
    RIGID,
    bulk_factor_of,
    factor_of,
    far_field,
    volume_field,
)
from gelforge.indentation.effects.material import region_bulk


@dataclass(frozen=True)
class Place:
    """A ball in the sensor's frame [mm] where a located effect sits."""

    x_mm: float
    y_mm: float
    z_mm: float
    radius_mm: float


@dataclass(frozen=True)
class Effect:
    """One effect with one value."""

    name: str
    family: str  # material, history, contact, geometry or kinematics
    parameter: str  # what the value is
    unit: str
    width: float  # a plausible value
    apply: Callable[[Study, float, Place], Study]
    mesh_changes: bool = False
    history: bool = False  # every indentation is a path of its own
    binary: bool = False  # values are 0 and 1 only
    unloading: bool = False  # seen during unloading only
    step: float = 1e-2  # of the width: the value by which derivatives are taken

    def __call__(self, study: Study, amount: float, place: Place | None = None) -> Study:
        """Return the study with this value of the effect, located ones by default in the middle of the soft layers."""
        if self.binary and amount not in (0, 1):
            raise ValueError(f"{self.name} is on (1) or off (0), found {amount:g}")
        return self.apply(study, amount, place or middle_of(study))


def middle_of(study: Study) -> Place:
    """Return a ball of half the height in the middle of the lowest layer."""
    sensor = study.sensor
    lowest = sensor.layers[0].thickness_mm
    return Place(
        sensor.width_x_mm / 2, sensor.width_y_mm / 2, lowest / 2 - sensor.height_mm, sensor.height_mm / 4
    )


def with_keys(study: Study, **families) -> Study:
    """Return the study with other keys of mechanics.effects, checked anew.

    Parameters
    ----------
    study : Study
        The study to be changed.
    **families : dict
        Keys by family, e.g. kinematics={"yaw_deg": 1.0}.

    Returns
    -------
    Study
        A copy.

    Raises
    ------
    ConfigError
        A key or value that the configuration refuses.
    """
    return changed_study(study, {"mechanics": {"effects": families}})


def gel_layers(study: Study) -> list[str]:
    """Return the names of the layers under the skin.

    Parameters
    ----------
    study : Study
        With at least one layer.

    Returns
    -------
    list of str
        From the base up, without the top layer; that one of a sensor with a single layer.
    """
    names = [layer.name for layer in study.sensor.layers]
    return names[:-1] or names


def skin_layer(study: Study) -> str:
    """Return the name of the top layer, which the indenter touches.

    Parameters
    ----------
    study : Study
        With at least one layer.

    Returns
    -------
    str
        A name of `study.sensor.layers`.
    """
    return study.sensor.layers[-1].name


def _stiffness(study: Study, layers: list[str], amount: float) -> Study:
    factors = study.mechanics.effects.material.stiffness_factor
    changed = {name: (1 + amount) * factors.get(name, 1.0) for name in layers}
    return with_keys(study, material={"stiffness_factor": changed})


def _exponent(study, amount, place):
    factors = {layer.name: 1 + amount for layer in study.sensor.layers}
    return with_keys(study, material={"exponent_factor": factors})


def _compressibility(study, amount, place):
    K = study.mechanics.bulk_to_shear
    ratios = {layer.name: K / (1 + amount * K) for layer in study.sensor.layers}
    return with_keys(study, material={"bulk_to_shear": ratios})


def _elastic_base(study, amount, place):
    modulus = 1 / amount if amount else None
    return with_keys(study, geometry={"base": {"youngs_modulus_MPa": modulus}})


def _friction(study, amount, place):
    return changed_study(study, {"mechanics": {"friction": max(study.mechanics.friction + amount, 0.0)}})


def _prestretch(study, amount, place):
    return with_keys(study, geometry={"prestretch": {skin_layer(study): [1 + amount, 1 + amount]}})


def _rate(key):
    def apply(study, amount, place):
        return with_keys(study, material={"circumstances": {key: {n: amount for n in gel_layers(study)}}})

    return apply


# Least and largest stiffness of a ball over that around it: they do 0.998 of what an empty and 0.95 of what a rigid ball
# does (Eshelby 1957, far_field; tests/indentation/test_element_stiffness.py).
EMPTY, HARD = 1e-3, 50.0


def _ball(study, place, field, **keys):
    here = keys | {
        "centre_mm": [place.x_mm, place.y_mm, place.z_mm],
        "radius_mm": place.radius_mm,
        "factor": float(factor_of(np.clip(field, far_field(EMPTY), far_field(HARD)))),
    }
    others = [i.model_dump() for i in study.mechanics.effects.geometry.inclusions]
    return with_keys(study, geometry={"inclusions": [*others, here]})


def _bubble(study, amount, place):
    """Return a ball that does a share of what an empty one does, to shear and to pressure."""
    layers, bottom = study.sensor.layers, -study.sensor.height_mm
    tops = bottom + np.cumsum([layer.thickness_mm for layer in layers])
    layer = layers[min(int(np.searchsorted(tops, place.z_mm)), len(layers) - 1)].name
    ratio = region_bulk(study.sensor, study.mechanics, (layer,))[layer]
    bulk = bulk_factor_of(np.clip(amount, 0, 1) * volume_field(EMPTY, ratio), ratio)
    return _ball(study, place, amount * LOST, bulk_factor=float(bulk))


def _delamination(study, amount, place):
    here = {"centre_mm": [place.x_mm, place.y_mm], "radius_mm": place.radius_mm, "loss": amount}
    layer = {"layer": gel_layers(study)[-1], "face": "top"}
    return with_keys(study, geometry={"delaminations": [here | layer]})


def with_wall_side(study: Study, side: str, **losses: float) -> Study:
    """Return the study with losses of the wall, or of the bond to it, along one side in addition to those that it has.

    Parameters
    ----------
    study : Study
        Not changed.
    side : str
        "x_low", "x_high", "y_low" or "y_high".
    **losses : float
        Keys of WallSide: `wall_loss` and `bond_loss` [-], `width_mm` [mm].

    Returns
    -------
    Study
        A copy.
    """
    others = [one.model_dump() for one in study.mechanics.effects.geometry.wall_sides]
    return with_keys(study, geometry={"wall_sides": [*others, {"side": side, **losses}]})


def _thickness(study, layer, **keys):
    return with_keys(study, geometry={"thickness": {layer: keys}})


def _overstress(study, amount, place):
    branch = {"relative_moduli": [amount], "times_s": [1.0]}
    return with_keys(study, history={"viscoelastic": {name: branch for name in gel_layers(study)}})


def _softening(study, amount, place):
    softening = {"amount": amount, "m_kPa": 0.5, "beta": 0.1}
    return with_keys(study, history={"mullins": {name: softening for name in gel_layers(study)}})


def _one(family: str, key: str, pair: bool = False, of: Callable[[float], float] = float):
    """Return the function that sets one number, or the first of a pair, of a family."""

    def apply(study, amount, place):
        return with_keys(study, **{family: {key: [of(amount), 0.0] if pair else of(amount)}})

    return apply


CATALOGUE: dict[str, Effect] = {
    effect.name: effect
    for effect in [
        Effect("gel_stiffness", "material", "growth of the moduli under the skin", "1", 0.2,
               lambda study, amount, place: _stiffness(study, gel_layers(study), amount)),
        Effect("skin_stiffness", "material", "growth of the moduli of top layer, wall and flange", "1", 0.2,
               lambda study, amount, place: _stiffness(study, [skin_layer(study)], amount)),
        Effect("law_exponent", "material", "growth of the constitutive models' exponents, moduli unchanged", "1", 0.3,
               _exponent),
        Effect("compressibility", "material", "mu/K more than mechanics.bulk_to_shear says", "1", 0.02,
               _compressibility, step=1e-3),
        Effect("elastic_base", "material", "1/E of a slab of 17 mm below", "1/MPa", 1.0,
               _elastic_base, mesh_changes=True),
        Effect("linear_elasticity", "material", "neo-Hookean models in place of the fitted ones", "1", 1.0,
               lambda study, amount, place: with_keys(study, material={"linear_law": bool(amount)}), binary=True),
        Effect("small_strain", "material", "small-strain elasticity in place of finite strain", "1", 1.0,
               lambda study, amount, place: changed_study(study, {"mechanics": {"strain": "small"}}) if amount else study,
               binary=True),
        Effect("viscoelastic", "history", "overstress modulus of the soft layers over the elastic one, time 1 s", "1", 0.2,
               _overstress, history=True),
        Effect("mullins", "history", "largest lost share of the soft layers' stress", "1", 0.3, _softening, history=True),
        Effect("ageing", "history", "growth of the gel's stiffness per day of age", "1/d", 0.01, _rate("ageing_per_day")),
        Effect("temperature", "history", "growth of the gel's stiffness per kelvin", "1/K", 0.01,
               _rate("stiffening_per_K")),
        Effect("friction", "contact", "coefficient more than mechanics.friction", "1", 0.2,
               _friction),
        Effect("frictionless", "contact", "no friction", "1", 1.0,
               lambda study, amount, place: changed_study(study, {"mechanics": {"friction": 0.0}}) if amount else study,
               binary=True),
        Effect("friction_law", "contact", "exponent of its fall with the pressure", "1", 0.33,
               _one("contact", "pressure_exponent", of=lambda a: min(float(a), 0.99))),
        Effect("adhesion", "contact", "work of separation", "N/mm", 1e-4,
               lambda study, amount, place: with_keys(study, contact={"adhesion": {"work_N_per_mm": amount}}),
               unloading=True),
        Effect("toe_region", "contact", "thickness of a film that gives way and is used up", "mm", 0.05,
               lambda study, amount, place: with_keys(study, contact={"film": {"thickness_mm": amount}})),
        Effect("layer_thickness", "geometry", "thickness more than drawn of the layer under the skin", "mm", 0.5,
               lambda study, amount, place: _thickness(study, gel_layers(study)[-1], change_mm=amount)),
        Effect("thickness_gradient", "geometry", "its growth along x", "mm/mm", 0.02,
               lambda study, amount, place: _thickness(study, gel_layers(study)[-1], gradient=[amount, 0.0])),
        Effect("wall_stiffness", "geometry", "growth of the wall's moduli", "1", 0.5,
               lambda study, amount, place: _stiffness(study, ["wall"], amount)),
        Effect("wall_gap", "geometry", "lost share of the bond along the wall", "1", 1.0,
               lambda study, amount, place: with_keys(study, geometry={"wall_gap": {"loss": amount}})),
        Effect("wall_side", "geometry", "lost share of the stiffness of the wall along x = 0", "1", 1.0,
               lambda study, amount, place: with_wall_side(study, "x_low", wall_loss=amount)),
        Effect("delamination", "geometry", "lost share of the shear stiffness of a film under the skin", "1", 1.0,
               _delamination),
        Effect("void", "geometry", "share of what an empty ball does to all around it", "1", 1.0, _bubble, step=1e-3),
        Effect("inclusion", "geometry", "share of what a rigid ball does to all around it", "1", 1.0,
               lambda study, amount, place: _ball(study, place, amount * RIGID)),
        Effect("prestretch", "geometry", "residual stretch of the skin along x and y, less 1", "1", 0.05,
               _prestretch),
        Effect("indenter_radius", "geometry", "radius more than described", "mm", 0.25,
               _one("geometry", "indenter_radius_change_mm")),
        Effect("particle_settling", "geometry", "share of the particles' concentration that has sunk", "1", 0.5,
               lambda study, amount, place: with_keys(study, material={"particles": {"settling": amount}})),
        Effect("contact_zero", "kinematics", "pressed deeper than commanded", "mm", 0.1,
               _one("kinematics", "contact_zero_mm")),
        Effect("tilt", "kinematics", "turn of the sensor about x", "deg", 1.0, _one("kinematics", "tilt_deg", pair=True)),
        Effect("misregistration", "kinematics", "shift of all positions along x", "mm", 0.5,
               _one("kinematics", "misregistration_mm", pair=True)),
        Effect("yaw", "kinematics", "turn of the grid about the middle", "deg", 2.0, _one("kinematics", "yaw_deg")),
        Effect("grid_scale", "kinematics", "growth of the grid from the middle", "1", 0.01,
               _one("kinematics", "grid_scale")),
        Effect("frame_compliance", "kinematics", "yielding of the frame along the path", "mm/N", 0.05,
               _one("kinematics", "frame_compliance_mm_per_N")),
        Effect("base_bending", "kinematics", "yielding of the base plate at its middle", "mm/N", 0.05,
               _one("kinematics", "base_bending_mm_per_N")),
    ]
}  # fmt: skip
