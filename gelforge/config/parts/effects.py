"""Physics that a plain study leaves out: every default is nothing, and gives the plain result bit for bit.

Dictionaries are by region: the layers by name, and `wall`, `flange`, `base` where the sensor has them. Wall and flange
follow the top layer, whose material they are made of, unless they are named.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, model_validator

from gelforge.config.parts.sensor import Sensor
from gelforge.section import ConfigError, Fraction, Name, NonNegative, Pair, Positive, Section, Share, Triple

PoissonsRatio = Annotated[float, Field(gt=0, lt=0.5)]


class Particles(Section):
    """Tracer particles stiffen the gel: factor 1 / (1 - 5 phi / 2), phi their local volume share (Eshelby 1957)."""

    stiffening: Share = Field(
        0.0, description="share of the layer's particle_volume_fraction that stiffens it; 1: all [-]"
    )
    settling: float = Field(
        0.0, ge=-1, le=1, description="share that has sunk: phi (1 +- settling) at a layer's bottom, top [-]"
    )


class Circumstances(Section):
    """Age and temperature: a layer's stiffness is times 1 + rate x (value - reference) for each."""

    ageing_per_day: dict[Name, float] = Field({}, description="growth of the stiffness per day [1/d]")
    age_days: NonNegative = Field(0.0, description="age of the sensor in the session [d]")
    reference_age_days: NonNegative = Field(0.0, description="age at which the constitutive models hold [d]")
    stiffening_per_K: dict[Name, float] = Field({}, description="growth of the stiffness per kelvin [1/K]")
    temperature_C: float = Field(23.0, description="temperature of the session [degC]")
    reference_temperature_C: float = Field(
        23.0, description="temperature at which the constitutive models hold [degC]"
    )


class EnergyCorrection(Section):
    """More terms of the strain energy: W + mu/2 (c2 (I1 - 3)^2 + c3 (I1 - 3)^3), mu the model's initial shear modulus."""

    c2: float = Field(0.0, description="second-order term over half of the initial shear modulus [-]")
    c3: float = Field(0.0, description="third-order term over half of the initial shear modulus [-]")


class MaterialEffects(Section):
    """What the material is besides its constitutive model."""

    stiffness_factor: dict[Name, Positive] = Field(
        {}, description="factor on all moduli of a region, bulk modulus included [-]"
    )
    exponent_factor: dict[Name, Positive] = Field(
        {},
        description="factor on a constitutive model's exponents (Ogden), its growth with I1 - 3 (Yeoh) or 1/Jm"
        " (Gent), modulus kept [-]",
    )
    energy_correction: dict[Name, EnergyCorrection] = Field(
        {}, description="more terms of a constitutive model's strain energy, modulus kept"
    )
    linear_law: bool = Field(
        False, description="true: neo-Hookean constitutive models of the same shear moduli"
    )
    bulk_to_shear: dict[Name, Positive] = Field(
        {}, description="bulk modulus over shear modulus of a region instead of mechanics.bulk_to_shear [-]"
    )
    poissons_ratio: dict[Name, PoissonsRatio] = Field(
        {}, description="the same said by Poisson's ratio of the undeformed state [-]"
    )
    particles: Particles = Field(
        Particles(), description="stiffening by tracer particles, and their settling"
    )
    circumstances: Circumstances = Field(Circumstances(), description="age and temperature")

    @model_validator(mode="after")
    def _once(self):
        twice = sorted(set(self.bulk_to_shear) & set(self.poissons_ratio))
        if twice:
            raise ValueError(f"bulk_to_shear and poissons_ratio are both given for {twice}; give one")
        return self


class Thickness(Section):
    """Departure of a layer from its nominal thickness; the base stays flat and the top's middle at z = 0."""

    change_mm: float = Field(0.0, description="thicker by this much all over [mm]")
    gradient: Pair = Field([0.0, 0.0], description="growth of the thickness along x and y [mm/mm]")


class Base(Section):
    """A slab under the layers, held at its own bottom."""

    thickness_mm: Positive = Field(17.0, description="thickness of the slab [mm]")
    youngs_modulus_MPa: Positive | None = Field(
        0.97, description="Young's modulus of the slab, neo-Hookean [MPa]; null: rigid"
    )


class Inclusion(Section):
    """A ball of other stiffness inside the sensor: a void or bubble (factor << 1) or something hard (factor >> 1)."""

    centre_mm: Triple = Field(description="centre x, y, z in the sensor's frame, z <= 0 [mm]")
    radius_mm: Positive = Field(description="radius [mm]")
    factor: float = Field(
        1e-3, ge=1e-4, le=1e4, description="its stiffness over that of what it displaces [-]"
    )
    bulk_factor: float | None = Field(
        None,
        ge=1e-4,
        le=1e4,
        description="its bulk modulus over that of what it displaces, where it is not the same [-]",
    )


class Patch(Section):
    """A box of other stiffness; what stands around the layers (a wall, a flange) keeps its own."""

    low_mm: Triple = Field(description="lowest x, y, z in the sensor's frame [mm]")
    high_mm: Triple = Field(description="highest x, y, z [mm]")
    factor: float = Field(
        1.0, ge=1e-4, le=1e4, description="its stiffness over that of what it displaces [-]"
    )


class Toe(Section):
    """A soft thin part on top of the highest layer, which stays as soft: an uncured skin."""

    thickness_mm: Positive = Field(0.1, description="thickness of the soft part [mm]")
    factor: Positive = Field(1.0, ge=1e-3, description="its stiffness over that of the layer [-]")


class WallGap(Section):
    """A strip of the lower layers along the wall that has lost its bond to it."""

    width_mm: Positive = Field(0.5, description="width of the strip [mm]")
    loss: Share = Field(0.0, description="lost share of the strip's stiffness [-]")


Side = Literal["x_low", "x_high", "y_low", "y_high"]


class WallSide(Section):
    """A wall that is broken along one side of the sensor, or the gel's bond to it that is lost there."""

    side: Side = Field(description="side of the sensor: x or y, at the low or the high end")
    wall_loss: Share = Field(0.0, description="lost share of the wall's stiffness along the side [-]")
    bond_loss: Share = Field(
        0.0, description="lost share of the stiffness of a strip of the lower layers next to it [-]"
    )
    width_mm: Positive = Field(0.5, description="width of the strip [mm]")


class Delamination(Section):
    """A patch of a layer's upper or lower face that slides freely: a thin film there has lost its shear stiffness.

    The film keeps its bulk modulus, so pressure passes.
    """

    centre_mm: Pair = Field(description="centre x, y of the patch [mm]")
    radius_mm: Positive = Field(description="radius of the patch [mm]")
    layer: Name = Field(description="layer in which the film lies")
    face: Annotated[str, Field(pattern="^(top|bottom)$")] = Field(
        "top", description="top or bottom: the face of the layer that is loose"
    )
    film_mm: Positive = Field(0.3, description="thickness of the film, about that of an element there [mm]")
    loss: Share = Field(0.0, description="lost share of the film's shear stiffness [-]")


class GeometryEffects(Section):
    """How the sensor is not as drawn; only `base` changes the mesh, the others move its nodes or weaken its elements."""

    thickness: dict[Name, Thickness] = Field({}, description="departures of layers from nominal thickness")
    base: Base | None = Field(None, description="elastic slab below the layers, or null")
    inclusions: list[Inclusion] = Field([], description="voids and inclusions")
    patches: list[Patch] = Field([], description="boxes of other stiffness, one after the other")
    toe: Toe = Field(Toe(), description="soft thin part on top")
    wall_gap: WallGap = Field(WallGap(), description="strip that is not bonded to the wall")
    wall_sides: list[WallSide] = Field([], description="sides along which the wall or the bond to it is weak")
    delaminations: list[Delamination] = Field([], description="patches of a layer's face that slide freely")
    indenter_radius_change_mm: float = Field(0.0, description="ball larger than described [mm]")
    prestretch: dict[Name, Pair] = Field(
        {},
        description="residual stretch of a region along x and y, 1: none; the pressed state starts from its balance [-]",
    )


class Adhesion(Section):
    """Cohesive traction of surfaces that are near: it falls linearly from gap 0 to range_mm; area under it is the work.

    A node that has been touched parts with work_N_per_mm, one that has not is drawn with approach_N_per_mm.
    """

    work_N_per_mm: NonNegative = Field(
        0.0, description="work of separation per area; 1e-3 N/mm = 1 J/m2 [N/mm]"
    )
    approach_N_per_mm: NonNegative = Field(0.0, description="work of approach per area, not larger [N/mm]")
    range_mm: Positive = Field(0.05, description="gap beyond which there is no adhesion [mm]")


class Film(Section):
    """What gives way between indenter and surface, and is used up: dust, powder, roughness."""

    thickness_mm: NonNegative = Field(0.0, description="by which it gives way at most [mm]")
    pressure_MPa: Positive = Field(0.01, description="pressure at which half of it has [MPa]")


class PressureTerm(Section):
    """A factor (1 + p / reference_pressure)^-exponent of the coefficient of friction, which grows where it is negative."""

    exponent: float = Field(0.0, gt=-1, lt=1, description="exponent [-]")
    reference_pressure_MPa: Positive = Field(description="reference pressure [MPa]")


class ContactEffects(Section):
    """What friction and contact do besides Coulomb's law; its coefficient is mechanics.friction."""

    pressure_exponent: float = Field(
        0.0,
        ge=0,
        lt=1,
        description="n in mu (1 + p / reference_pressure)^-n; 1/3: Hertzian asperities (Schallamach 1952) [-]",
    )
    reference_pressure_MPa: Positive = Field(0.01, description="reference pressure [MPa]")
    pressure_terms: list[PressureTerm] = Field(
        [], description="further factors of the coefficient of friction that depend on the pressure"
    )
    adhesion: Adhesion = Field(Adhesion(), description="adhesion")
    film: Film = Field(Film(), description="film that gives way")

    @property
    def friction_exponents(self) -> tuple[float, ...]:
        """Return the exponents of all factors of the coefficient of friction."""
        return self.pressure_exponent, *(term.exponent for term in self.pressure_terms)

    @property
    def friction_pressures_MPa(self) -> tuple[float, ...]:
        """Return the reference pressures of these factors."""
        return self.reference_pressure_MPa, *(term.reference_pressure_MPa for term in self.pressure_terms)


class KinematicEffects(Section):
    """Where the indenter really is, given where it was sent; the mesh stays that of the commanded position."""

    misregistration_mm: Pair = Field([0.0, 0.0], description="shift of all positions along x, y [mm]")
    yaw_deg: float = Field(0.0, ge=-45, le=45, description="turn of the grid about the sensor's middle [deg]")
    grid_scale: float = Field(0.0, gt=-0.5, lt=0.5, description="growth of the grid from the middle [-]")
    contact_zero_mm: float = Field(0.0, description="pressed deeper than commanded [mm]")
    tilt_deg: Annotated[Pair, Field(description="tilt")] = Field(
        [0.0, 0.0], description="turn of the sensor about its x and y axes against the indenter's path [deg]"
    )
    zero_by: Annotated[str, Field(pattern="^(press|session)$")] = Field(
        "press",
        description="depth from each indentation's own first touch, or from that of the sensor's middle (session)",
    )
    frame_compliance_mm_per_N: NonNegative = Field(
        0.0, description="yielding of the frame along z per force; the gel is pressed less deep [mm/N]"
    )
    base_bending_mm_per_N: NonNegative = Field(
        0.0, description="yielding of the base plate, held at its edges, per force at its middle [mm/N]"
    )


class Prony(Section):
    """Relaxing overstresses in addition to the constitutive model, which holds at rest: moduli over its own, and times."""

    relative_moduli: list[NonNegative] = Field(
        min_length=1, description="overstress moduli over the constitutive model's [-]"
    )
    times_s: list[Positive] = Field(min_length=1, description="relaxation times [s]")

    @model_validator(mode="after")
    def _pairs(self):
        if len(self.relative_moduli) != len(self.times_s):
            raise ValueError(
                f"{len(self.relative_moduli)} relative_moduli but {len(self.times_s)} times_s; give pairs"
            )
        return self


class Mullins(Section):
    """Ogden-Roxburgh softening of a layer: stress times 1 - amount erf((W_max - W) / (m + beta W_max))."""

    amount: Fraction = Field(0.0, description="largest lost share of the stress, 1/r of the article [-]")
    m_kPa: Positive = Field(1.0, description="energy density that scales the softening [kPa = mJ/cm3]")
    beta: NonNegative = Field(0.0, description="growth of that scale with the largest energy density [-]")


class PressTiming(Section):
    """How a planned depth becomes a path in time where history matters; a timed plan has its own."""

    speed_mm_per_s: Positive = Field(1.0, description="speed down and up [mm/s]")
    dwell_s: NonNegative = Field(0.0, description="wait at the depth before the reading [s]")
    step_mm: Positive = Field(0.25, description="largest step of the indenter that is solved [mm]")
    dwell_steps: int = Field(4, ge=1, le=100, description="steps of the wait, growing [-]")


class HistoryEffects(Section):
    """What the material remembers; any of it makes every indentation a path of its own."""

    viscoelastic: dict[Name, Prony] = Field({}, description="finite-strain viscoelasticity by region")
    mullins: dict[Name, Mullins] = Field({}, description="softening by region")
    grid_mm: Positive = Field(0.25, description="spacing of the fixed grid that keeps the softening [mm]")
    timing: PressTiming = Field(PressTiming(), description="how planned depths become paths in time")

    @property
    def any(self) -> bool:
        return bool(self.viscoelastic or self.mullins)

    @property
    def softens(self) -> bool:
        """Whether an indentation leaves something behind for the next."""
        return any(mullins.amount for mullins in self.mullins.values())

    @property
    def relaxes(self) -> bool:
        """Whether forces depend on time."""
        return any(any(prony.relative_moduli) for prony in self.viscoelastic.values())


class Effects(Section):
    """Physics in addition to the plain model, by family."""

    material: MaterialEffects = Field(MaterialEffects(), description="material")
    geometry: GeometryEffects = Field(GeometryEffects(), description="geometry")
    contact: ContactEffects = Field(ContactEffects(), description="contact")
    kinematics: KinematicEffects = Field(KinematicEffects(), description="pose and machine")
    history: HistoryEffects = Field(HistoryEffects(), description="history")

    def check(self, sensor: Sensor) -> None:
        """Refuse regions that the sensor does not have and shapes for which an effect is not known."""
        material, geometry, history = self.material, self.geometry, self.history
        layers = [layer.name for layer in sensor.layers]
        regions = layers + ["wall"] * bool(sensor.wall_mm) + ["flange"] * bool(sensor.flange)
        regions += ["base"] * bool(geometry.base)
        circumstances = material.circumstances
        named_in: list[tuple[str, Iterable[str], list[str]]] = [
            ("material.stiffness_factor", material.stiffness_factor, regions),
            ("material.exponent_factor", material.exponent_factor, regions),
            ("material.energy_correction", material.energy_correction, regions),
            ("material.bulk_to_shear", material.bulk_to_shear, regions),
            ("material.poissons_ratio", material.poissons_ratio, regions),
            ("material.circumstances.ageing_per_day", circumstances.ageing_per_day, regions),
            ("material.circumstances.stiffening_per_K", circumstances.stiffening_per_K, regions),
            ("geometry.thickness", geometry.thickness, layers),
            ("geometry.prestretch", geometry.prestretch, regions),
            ("geometry.delaminations", [d.layer for d in geometry.delaminations], layers),
            ("history.viscoelastic", history.viscoelastic, regions),
            ("history.mullins", history.mullins, regions),
        ]
        for key, named, allowed in named_in:
            unknown = sorted(set(named) - set(allowed))
            if unknown:
                raise ConfigError(f"effects.{key}: {unknown} are not regions of the sensor; it has {allowed}")
        small = sorted(n for n, pair in geometry.prestretch.items() if min(pair) <= 0)
        if small:
            raise ConfigError(f"effects.geometry.prestretch: {small} have a stretch <= 0; 1 is none")
        shaped = (
            geometry.thickness
            or geometry.base
            or geometry.wall_gap.loss
            or geometry.wall_sides
            or geometry.delaminations
            or geometry.prestretch
            or geometry.toe.factor != 1
            or material.particles.settling
        )
        if sensor.shape.kind != "block" and shaped:
            raise ConfigError(
                f"effects.geometry and settling are known for shape.kind: block, found {sensor.shape.kind};"
                " leave thickness, base, wall_gap, wall_sides, delaminations, prestretch, toe and settling out"
            )
        for key, of_wall in (("wall_gap", geometry.wall_gap.loss), ("wall_sides", geometry.wall_sides)):
            if of_wall and not sensor.wall_mm:
                raise ConfigError(f"effects.geometry.{key}: the sensor has wall_mm 0; give it a wall")
        particles, phi = material.particles, [layer.particle_volume_fraction for layer in sensor.layers]
        if (particles.stiffening or particles.settling) and not any(phi):
            raise ConfigError(
                "effects.material.particles: no layer has particle_volume_fraction > 0; give the gel's"
            )
        if max(phi) * (particles.stiffening + abs(particles.settling)) >= 0.4:
            raise ConfigError(
                f"effects.material.particles: 1 / (1 - 5 phi / 2) has no value at phi = 0.4; found up to"
                f" {max(phi) * (particles.stiffening + abs(particles.settling)):.2g}; it is for a few per cent"
            )

    @property
    def has_symmetry_of_square(self) -> bool:
        """Whether indentations of a square sensor still have mirror images: nothing has a place, a direction or an order."""
        geometry, k = self.geometry, self.kinematics
        directed = [*k.tilt_deg, *k.misregistration_mm, k.yaw_deg]
        directed += [g for t in geometry.thickness.values() for g in t.gradient]
        directed += [x - y for x, y in geometry.prestretch.values()]
        placed = [*geometry.inclusions, *geometry.patches, *geometry.delaminations, *geometry.wall_sides]
        return not (any(directed) or placed or self.history.softens)
