"""A virtual lab: true laws, drawing, noise and sessions of synthetic recordings."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gelforge.config.parts.camera import Camera
from gelforge.config.parts.mechanics import Mechanics, Mesh
from gelforge.config.sessions.session import StageToSensor
from gelforge.mechanics.laws.models.ogden import OgdenParameters
from gelforge.section import Fraction, GrownSection, Name, NonNegative, Positive, Section


class PrintedDots(Section):
    """A square grid of dots on one plane in the gel, as printed under a coating, about the sensor's middle.

    Each serial has its own shift and turn of the grid.
    """

    spacing_mm: Positive = Field(description="distance of neighbouring dots [mm]")
    depth_mm: NonNegative = Field(0.0, description="depth of the plane below the top surface [mm]")
    offset_mm: NonNegative = Field(
        0.2, description="shift of the grid, standard deviation of each of x and y [mm]"
    )
    rotation_deg: NonNegative = Field(1.0, description="turn of the grid about z, standard deviation [deg]")


class VirtualParticles(GrownSection):
    """What the camera sees move: tracer particles in the gel, or printed dots."""

    later = ("dots",)
    diameter_mm: float = Field(0.3, ge=0.15, le=0.6, description="diameter of a particle or dot [mm]")
    volume_fraction: float = Field(
        0.0196, gt=0, le=0.1, description="share of the gel's volume; without meaning for dots [-]"
    )
    dots: PrintedDots | None = Field(None, description="printed dots in place of particles; null: particles")


Colour = Annotated[list[Annotated[float, Field(ge=0, le=255)]], Field(min_length=3, max_length=3)]


class VirtualImaging(GrownSection):
    """How the virtual camera draws."""

    later = (
        *("vignetting", "uneven_light", "defocus_px_per_mm", "focus_z_mm", "exposure_drift"),
        *("background_rgb", "particle_rgb"),
    )
    blur_px: NonNegative = Field(0.7, description="Gaussian blur of the optics, standard deviation [px]")
    noise_grey: NonNegative = Field(2.0, description="standard deviation of the sensor noise [grey levels]")
    background_grey: float = Field(
        24.0, ge=0, le=255, description="grey level of the skin behind the particles [-]"
    )
    particle_grey: float = Field(
        210.0, ge=0, le=255, description="grey level of the nearest particle's middle [-]"
    )
    images_per_press: int = Field(5, ge=1, description="images at the commanded depth [-]")
    vignetting: Fraction = Field(
        0.0,
        description="share of the light lost in the image's corners, growing with the square of the radius [-]",
    )
    uneven_light: float = Field(
        0.0, ge=-1, le=1, description="light at the right border less that at the left, over the mean [-]"
    )
    defocus_px_per_mm: NonNegative = Field(
        0.0, description="further blur, standard deviation, per mm of height from the plane in focus [px/mm]"
    )
    focus_z_mm: float | None = Field(
        None, description="plane in focus, sensor frame; null: the mean height of the particles [mm]"
    )
    exposure_drift: float = Field(
        0.0, gt=-1, le=1, description="brightness of the last indentation over that of the first, less 1 [-]"
    )

    background_rgb: Colour | None = Field(
        None,
        description="red, green and blue of the skin as the camera shows it, in place of background_grey; images are then "
        "in colour, null: grey [-]",
    )
    particle_rgb: Colour | None = Field(
        None, description="of the nearest particle's middle, in place of particle_grey [-]"
    )

    @model_validator(mode="after")
    def _both_colours(self):
        if (self.background_rgb is None) != (self.particle_rgb is None):
            missing = "background_rgb" if self.background_rgb is None else "particle_rgb"
            raise ValueError(
                f"{missing} is missing: a camera in colour shows both; give it, or remove the other"
            )
        return self


Forces = Annotated[list[NonNegative], Field(min_length=3, max_length=3)]


class VirtualForce(Section):
    """How the virtual force sensor reads."""

    noise_N: Forces = Field([0.008, 0.008, 0.015], description="noise [N]")
    resolution_N: Annotated[list[Positive], Field(min_length=3, max_length=3)] = Field(
        [0.03, 0.03, 0.06], description="steps [N]"
    )
    offset_N: Forces = Field([0.05, 0.05, 0.1], description="scatter of the untared zero of a session [N]")
    contact_point_scatter_mm: NonNegative = Field(
        0.01, description="standard deviation of the contact point from one indentation to the next [mm]"
    )


class VirtualSession(Section):
    """One session of the virtual lab."""

    session: Name = Field(description="name")
    date: str = Field(description="date written into session.yaml")
    share: float = Field(
        gt=0,
        le=1,
        description="share of the plan's sites pressed in this session, relative to the others [-]",
    )
    seed: int = Field(ge=0, description="seed of order, noise and contact point [-]")
    acts_on: Literal["sensor", "indenter"] = Field(
        "indenter", description="body on which the recorded force acts"
    )
    axes: list[list[float]] = Field(
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        description="rotation from the force sensor's axes to the sensor frame [-]",
    )
    stage_to_sensor: StageToSensor = Field(StageToSensor(), description="how the stage stands to the sensor")


class VirtualSample(Section):
    """Scatter of the virtual material tests."""

    samples: int = Field(6, ge=1, description="samples per test [-]")
    stiffness_scatter: NonNegative = Field(0.02, description="standard deviation of a sample's stiffness [-]")
    noise: NonNegative = Field(0.005, description="reading noise over the largest reading [-]")
    seed: int = Field(7, ge=0, description="seed [-]")


class VirtualLab(Section):
    """A sensor whose true physics is known: makes synthetic recordings and material tests."""

    serial: Name = Field(description="serial of the virtual sensor; seeds its particles")
    materials: dict[Name, OgdenParameters] = Field(description="true constitutive models of the coupons")
    stiffness_scale: dict[Name, Positive] = Field(
        {}, description="concealed factor on a layer's stiffness, by layer"
    )
    mechanics: Mechanics = Field(
        Mechanics(mesh=Mesh(near_mm=0.35, far_mm=1.4)),
        description="the virtual sensor's own model, on another mesh",
    )
    unload_depths_mm: list[Positive] = Field(
        [1.5, 1.0, 0.5], description="depths visited after the deepest indentation [mm]"
    )
    particles: VirtualParticles = Field(VirtualParticles(), description="tracer particles")
    camera: Camera = Field(description="camera")
    imaging: VirtualImaging = Field(VirtualImaging(), description="drawing")
    force: VirtualForce = Field(VirtualForce(), description="force sensor")
    sessions: list[VirtualSession] = Field(min_length=1, description="sessions")
    material_tests: VirtualSample = Field(VirtualSample(), description="material tests")

    @model_validator(mode="after")
    def _consistent(self):
        names = [session.session for session in self.sessions]
        if len(set(names)) < len(names):
            raise ValueError(f"sessions {names}: each session needs a name of its own")
        if any(b >= a for a, b in zip(self.unload_depths_mm, self.unload_depths_mm[1:])):
            raise ValueError(f"unload_depths_mm {self.unload_depths_mm} must decrease")
        if self.camera.focal_px is None:
            raise ValueError("camera: the virtual camera is a pinhole; give focal_px")
        return self
