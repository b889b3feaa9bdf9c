"""What can be calibrated: for each kind of parameter its unit, how it enters the study, and what is known before."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gelforge.calibration.priors import Prior
from gelforge.config import ConfigError, Study
from gelforge.config.parts.mismatch import Known
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.model.effect import Effect, Parameter
from gelforge.mismatch.model.places import FirstOrder

Laws = Mapping[str, PrincipalLaw]  # by material
Layers = Sequence[str]  # of one material
# Of a prior's standard deviation: a million roundings of 1e-16, and no difference that an interval shows.
ROUNDING = 1e-9
MATERIAL_KINDS = ("modulus", "exponent")  # of a constitutive model: they go to its file and not to the study


@dataclass(frozen=True)
class Kind:
    """One kind of parameter. `to_study` gives the study with another value, from one that has the value `value`."""

    unit: str
    words: str
    value: Callable[[Study, Laws, Layers], float]
    to_study: Callable[[Study, Layers, float, float], Study]  # study, layers, present value, other value
    bounds: tuple[float, float]  # physical, in the unit; of a layer's as shares of the study's value
    factor: float | None = None  # by which 90 % of the values differ from the study's; None: see `width`
    width: float | None = None  # half of the range about the study's value that holds 90 % of the others
    source: str = ""
    effect: str | None = None  # of the catalogue of mismatch, whose entry into the study this is
    per_layer: bool = False
    logarithmic: bool = True
    applies: Callable[[Study], bool] = field(default=lambda study: True)


def _factors(study: Study, key: str, layers: Layers, now: float, then: float) -> Study:
    present = getattr(study.mechanics.effects.material, key)
    return with_keys(study, material={key: {name: present.get(name, 1.0) * then / now for name in layers}})


def _thicker(study: Study, layers: Layers, now: float, then: float) -> Study:
    known = study.mechanics.effects.geometry.thickness
    present = {name: known[name].change_mm if name in known else 0.0 for name in layers}
    changed = {name: {"change_mm": round(change + then - now, 9)} for name, change in present.items()}
    return with_keys(study, geometry={"thickness": changed})


def _thickness(study: Study, laws: Laws, layers: Layers) -> float:
    (layer,) = [one for one in study.sensor.layers if one.name == layers[0]]
    departs = study.mechanics.effects.geometry.thickness.get(layer.name)
    return layer.thickness_mm + (departs.change_mm if departs else 0.0)


def _modulus(study: Study, laws: Laws, layers: Layers) -> float:
    (material,) = {one.material for one in study.sensor.layers if one.name in layers}
    return 1e3 * laws[material].youngs_modulus * _factor(study, "stiffness_factor", layers)


def _factor(study: Study, key: str, layers: Layers) -> float:
    return getattr(study.mechanics.effects.material, key).get(layers[0], 1.0)


def _by_effect(name: str) -> Callable[[Study, Layers, float, float], Study]:
    """Return the entry of an effect whose value is what is more than the study has."""

    def to_study(study: Study, layers: Layers, now: float, then: float) -> Study:
        enter = CATALOGUE[name].to_study
        assert enter is not None  # effects of the force sensor are not entered so
        return enter(study, {}, (then - now,))

    return to_study


def _gain(study: Study) -> float:
    gains = (known.parameters for known in study.mismatch.known if known.effect == "force_gain")
    return 1 + next((gain.get("z", 0.0) for gain in gains), 0.0)


def _with_gain(study: Study, layers: Layers, now: float, then: float) -> Study:
    """Return the study whose force sensor is known to read all axes with a gain."""
    others = [known for known in study.mismatch.known if known.effect != "force_gain"]
    known = [*others, Known(effect="force_gain", parameters=dict.fromkeys("xyz", then - 1))]
    return study.model_copy(update={"mismatch": study.mismatch.model_copy(update={"known": known})})


KINDS: dict[str, Kind] = {
    "modulus": Kind(
        "kPa", "initial Young's modulus", _modulus,
        lambda study, layers, now, then: _factors(study, "stiffness_factor", layers, now, then),
        (0.02, 50.0), factor=3.0, per_layer=True, source="a factor of three about the study's modulus",
    ),
    "exponent": Kind(
        "1", "factor on the constitutive model's exponents",
        lambda study, laws, layers: _factor(study, "exponent_factor", layers),
        lambda study, layers, now, then: _factors(study, "exponent_factor", layers, now, then),
        (0.1, 3.0), factor=1.6, per_layer=True,
        source="exponents of fits to different tests of one material differ by tens of per cent (judgement)",
    ),
    "thickness": Kind(
        "mm", "thickness", _thickness, _thicker, (0.5, 1.6), factor=1.2, per_layer=True,
        source="a layer poured by weight (judgement)", applies=CATALOGUE["layer_thickness"].applies,
    ),
    "friction": Kind(
        "1", "coefficient of friction", lambda study, laws, layers: study.mechanics.friction, _by_effect("friction"),
        (0.02, 1.9), factor=3.0, effect="friction", applies=CATALOGUE["friction"].applies,
        source="silicone on steel or plastic, dusted or clean, runs from 0.2 to above 1 (judgement)",
    ),
    "base.compliance": Kind(
        "1/MPa", "1/E of a slab of 17 mm below", lambda study, laws, layers: _slab(study), _by_effect("elastic_base"),
        (0.0, 10.0), width=1.645, effect="elastic_base", logarithmic=False,
        applies=CATALOGUE["elastic_base"].applies, source="a slab of 1 MPa, a silicone rubber (judgement)",
    ),
    "contact_point": Kind(
        "mm", "pressed deeper than recorded",
        lambda study, laws, layers: study.mechanics.effects.kinematics.contact_zero_mm, _by_effect("contact_zero"),
        (-0.5, 0.5), width=0.16, effect="contact_zero", logarithmic=False,
        source="touch found by a force threshold on a soft surface (judgement)",
    ),
    "force_gain": Kind(
        "1", "gain of the force sensor, all axes", lambda study, laws, layers: _gain(study), _with_gain, (0.5, 2.0),
        effect="force_gain", source="a reference load",
    ),
}  # fmt: skip


def _slab(study: Study) -> float:
    base = study.mechanics.effects.geometry.base
    return 1 / base.youngs_modulus_MPa if base and base.youngs_modulus_MPa else 0.0


@dataclass(frozen=True)
class Free:
    """A parameter that is estimated; its coordinate is the logarithm of its value, or the value, less the prior's mean."""

    name: str
    kind: Kind
    layers: Layers  # none: it is of the sensor as a whole
    material: str | None
    prior: Prior
    start: float  # the study's value

    @property
    def width(self) -> float:
        """Return the prior's standard deviation of the coordinate."""
        return self.prior.normal(self.kind.logarithmic)[1]

    @property
    def bounds(self) -> tuple[float, float]:
        """Return the coordinates of the physical bounds."""
        low, high = self.kind.bounds
        if self.kind.per_layer:
            low, high = (share * self.start for share in (low, high))
        return self.coordinate(low), self.coordinate(high)

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        here = float(np.log(value)) if self.kind.logarithmic else value
        return here - self.prior.normal(self.kind.logarithmic)[0]

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate."""
        moved = coordinate + self.prior.normal(self.kind.logarithmic)[0]
        return float(np.exp(moved)) if self.kind.logarithmic else float(moved)

    def to_study(self, study: Study, now: float, then: float) -> Study:
        """Return the study at another coordinate than that which it has."""
        if abs(then - now) < ROUNDING * self.width:
            return study
        return self.kind.to_study(study, self.layers, self.value(now), self.value(then))

    def effect_about(self, at: float) -> Effect:
        """Return the change by the parameter as an effect of the verdict, 0 at a coordinate."""
        low, high = self.bounds
        known = CATALOGUE[self.kind.effect] if self.kind.effect else None
        solved = known is None or known.solved
        return Effect(
            name=self.name,
            family=known.family if known else "material",
            parameters=(Parameter("by", "1", self.width, (low, high), self.prior.source),),
            signature=self.kind.words,
            to_study=(lambda study, _, a: self.to_study(study, at, at + a[0])) if solved else None,
            to_forces=FirstOrder(self.name)
            if solved
            else lambda context, _, force, a: force * (self.value(at + a[0]) / self.value(at)),
            mesh_changes=bool(known and known.mesh_changes),
        )


def names_of(study: Study) -> list[str]:
    """Return the parameters that a study's sensor has."""
    kinds = [(name, kind) for name, kind in KINDS.items() if kind.applies(study)]
    layers = [layer.name for layer in study.sensor.layers]
    per_layer = [f"{layer}.{name}" for layer in layers for name, kind in kinds if kind.per_layer]
    return per_layer + [name for name, kind in kinds if not kind.per_layer]


def free_of(study: Study, laws: Laws, names: Sequence[str], priors: Mapping[str, Prior]) -> list[Free]:
    """Return the named parameters of a study with their priors. Raises ConfigError for one that it does not have."""
    offered = names_of(study)
    if wrong := [name for name in [*names, *priors] if name not in offered]:
        raise ConfigError(f"no parameter {wrong} of this sensor; it has {', '.join(offered)}")
    if unused := sorted(set(priors) - set(names)):
        raise ConfigError(f"--prior {unused}: not among --free; add it there")
    parameters = [_free(study, laws, name, priors.get(name)) for name in dict.fromkeys(names)]
    for kind in MATERIAL_KINDS:
        materials = [one.material for one in parameters if one.name.endswith(f".{kind}")]
        if len(materials) > len(set(materials)):
            raise ConfigError(f"two layers of one material have one {kind}; name one of them in --free")
    return parameters


def _free(study: Study, laws: Laws, name: str, prior: Prior | None) -> Free:
    layer, _, kind_name = name.rpartition(".")
    kind = KINDS.get(name) or KINDS[kind_name]
    layers: list[str] = []
    material = None
    if kind.per_layer:
        of_layer = next(one.material for one in study.sensor.layers if one.name == layer)
        same_material = [one.name for one in study.sensor.layers if one.material == of_layer]
        of_material = kind_name in MATERIAL_KINDS
        layers, material = (same_material if of_material else [layer]), (of_layer if of_material else None)
    value = kind.value(study, laws, layers)
    if prior is None and kind.factor:
        prior = Prior(value / kind.factor, value * kind.factor, kind.source)
    elif prior is None and kind.width:
        prior = Prior(value - kind.width, value + kind.width, kind.source)
    if prior is None:
        raise ConfigError(
            f"{name}: presses cannot tell it from the moduli; weigh a reference load and give what it says,"
            f" --prior {name}=0.99:1.01"
        )
    if kind.logarithmic and prior.low <= 0:
        raise ConfigError(f"--prior {name}: {prior.low:g} to {prior.high:g}; values above 0 are needed")
    return Free(name, kind, tuple(layers), material, prior, value)
