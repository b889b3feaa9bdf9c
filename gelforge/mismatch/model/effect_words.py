"""What each effect of the catalogue means for a sensor, as a clause of a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from gelforge.mismatch.model.effect import Effect, Shape

# Of an effect as such; then, where one value says it all, with more and with less of it.
PHRASES: dict[str, tuple[str, ...]] = {
    "adhesion": ("the surface sticks to the indenter",),
    "ageing": (
        "the material changes with age",
        "the material stiffens with age",
        "the material softens with age",
    ),
    "base_bending": ("the base under the gel bends",),
    "body_stiffness": (
        "all layers differ in stiffness",
        "all layers are {share} stiffer than simulated",
        "all layers are {share} softer than simulated",
    ),
    "camera_pose": ("the camera stands or looks elsewhere than assumed",),
    "camera_scale": ("the camera's scale is off",),
    "clock_offset": ("the clocks of force sensor and stage disagree",),
    "compressibility": ("the gel is more compressible than simulated",),
    "contact_zero": (
        "the contact point is off",
        "the indenter goes {size} deeper than recorded",
        "the indenter goes {size} less deep than recorded",
    ),
    "cross_talk": ("the force sensor has cross-talk between its axes",),
    "delamination": ("the skin has come off the gel in one place",),
    "elastic_base": ("the base under the gel is compliant",),
    "force_drift": ("the force sensor's zero drifts",),
    "force_frame": ("forces are recorded in another frame than assumed",),
    "force_gain": ("the force sensor's gain is off",),
    "force_hysteresis": ("the force sensor has hysteresis",),
    "force_offset": ("the force sensor's zero is off",),
    "force_unit": ("forces are recorded in another unit than assumed",),
    "frame_compliance": ("the stage's frame is compliant",),
    "friction": (
        "friction differs",
        "friction is higher than simulated",
        "friction is lower than simulated",
    ),
    "friction_law": ("friction depends on the contact pressure",),
    "frictionless": ("friction is there or absent, unlike in the simulation",),
    "gel_stiffness": (
        "the gel differs in stiffness",
        "the gel is {share} stiffer than simulated",
        "the gel is {share} softer than simulated",
    ),
    "grid_scale": ("the stage's grid is scaled",),
    "inclusion": ("something hard is in the gel",),
    "indenter_radius": (
        "the indenter's radius differs",
        "the indenter's radius is {size} larger than assumed",
        "the indenter's radius is {size} smaller than assumed",
    ),
    "lateral_play": ("the stage has lateral play",),
    "law_exponent": ("the gel stiffens differently at large strain than its model",),
    "layer_thickness": (
        "the gel's thickness differs",
        "the gel is {size} thicker than assumed",
        "the gel is {size} thinner than assumed",
    ),
    "linear_elasticity": ("the gel is not linear elastic as simulated",),
    "misregistration": ("the sensor lies elsewhere on the stage than assumed",),
    "mullins": ("the material softens where it has been strained before",),
    "particle_settling": ("the particles have settled in the gel",),
    "prestretch": ("the gel is stretched before it is pressed",),
    "refraction": ("the camera looks through more refraction than assumed",),
    "skin_stiffness": (
        "the skin differs in stiffness",
        "the skin is {share} stiffer than simulated",
        "the skin is {share} softer than simulated",
    ),
    "small_strain": ("strains are large and simulated as small",),
    "temperature": ("the material changes with temperature",),
    "thickness_gradient": ("the gel is thicker on one side",),
    "tilt": ("the sensor is tilted under the indenter",),
    "toe_region": ("a soft film lies on the surface",),
    "viscoelastic": ("the material relaxes under load",),
    "void": ("there is a void in the gel",),
    "wall_gap": ("the gel has come off its wall",),
    "wall_side": ("the wall is broken, or the gel has come off it, on one side",),
    "wall_stiffness": (
        "the wall differs in stiffness",
        "the wall is {share} stiffer than simulated",
        "the wall is {share} softer than simulated",
    ),
    "yaw": ("the sensor is turned on the stage",),
}


def in_general(name: str) -> str:
    """Return what an effect means, whatever its value; its own name where none is known."""
    return PHRASES.get(name, (f"there is {name.replace('_', ' ')}",))[0]


def with_amount(effect: Effect, shape: Shape, amounts: Sequence[float]) -> str:
    """Return what an effect means at its parameter values, and where it lies if it has a place."""
    if "coefficient" in shape:  # of friction, where the simulation has none; 0 where it has some
        found, simulated = ("friction", "none") if shape["coefficient"] else ("no friction", "some")
        return f"there is {found}, and the simulation has {simulated}"
    phrases = PHRASES.get(effect.name, (in_general(effect.name),))
    place = f" near ({shape['x_mm']:.3g}, {shape['y_mm']:.3g}) mm" if "x_mm" in shape else ""
    if len(phrases) == 1 or not amounts[0]:
        return phrases[0] + place
    amount, unit = abs(float(amounts[0])), effect.parameters[0].unit
    said = phrases[1 if amounts[0] > 0 else 2]
    return said.format(share=f"{100 * amount:.2g} %", size=f"{amount:.2g} {unit}") + place
