"""A training set from simulated sensors: which indentations are drawn, and how their images vary."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from gelforge.config.parts.camera import Camera
from gelforge.config.sessions.virtual_lab import VirtualImaging, VirtualParticles
from gelforge.section import NonNegative, Section, Share


def _increasing(given: list[float]) -> list[float]:
    if len(given) != 2 or given[0] > given[1]:
        raise ValueError(f"{given} must be two numbers, least and greatest")
    return given


Range = Annotated[list[NonNegative], AfterValidator(_increasing)]


class DrawnShapes(Section):
    """Indenters that are drawn, each in proportion to its weight."""

    own: NonNegative = Field(4.0, description="weight of the study's own indenter [-]")
    ball: NonNegative = Field(4.0, description="weight of balls [-]")
    punch: NonNegative = Field(2.0, description="weight of flat, round punches [-]")
    edge: NonNegative = Field(1.0, description="weight of straight edges, turned about z [-]")
    pair: NonNegative = Field(1.0, description="weight of pairs of balls, turned about z [-]")
    mesh: NonNegative = Field(0.0, description="weight of the surfaces of `files`, turned about z [-]")
    ball_radius_mm: Range = Field([2.0, 7.0], description="radii of balls, least and greatest [mm]")
    punch_radius_mm: Range = Field([2.0, 5.0], description="radii of punches [mm]")
    edge_length_mm: Range = Field([6.0, 14.0], description="lengths of edges [mm]")
    pair_gap_mm: Range = Field(
        [4.0, 9.0], description="distances of a pair's middles; radii are 2 to 3 mm [mm]"
    )
    files: list[Path] = Field(
        [], description="closed surfaces: STL, PLY or OBJ, in mm, origin over the position"
    )

    @model_validator(mode="after")
    def _something(self):
        if self.mesh and not self.files:
            raise ValueError("mesh has a weight, but files names no surface; name some or set mesh: 0")
        if not any((self.own, self.ball, self.punch, self.edge, self.pair, self.mesh)):
            raise ValueError("no shape has a weight; give one to own, ball, punch, edge, pair or mesh")
        return self


class DrawnViews(Section):
    """Standard deviations of what differs from one image series to the next; each has its own particles.

    Those of the camera are what a calibration and a remap leave. A network cannot distinguish a camera that looks 1 px
    aside from an indentation that is aside, so larger ones blur the places that it predicts.
    """

    focal_share: NonNegative = Field(0.002, description="focal length, share of it [-]")
    centre_px: NonNegative = Field(0.5, description="principal point, each of u and v [px]")
    rotation_deg: NonNegative = Field(0.05, description="turns of the camera about each axis [deg]")
    brightness_share: NonNegative = Field(
        0.1, description="grey levels of particles and background, share [-]"
    )
    blur_share: NonNegative = Field(0.2, description="blur of the optics, share [-]")
    noise_share: NonNegative = Field(0.2, description="noise of the camera, share [-]")


class DrawnRows(Section):
    """Classes of training rows, each in proportion to its weight, so that batches drawn from all rows are balanced."""

    straight: NonNegative = Field(
        4.0, description="weight of straight presses of the study's own indenter [-]"
    )
    light: NonNegative = Field(2.0, description="weight of its light presses, up to a fifth of the depth [-]")
    paths: NonNegative = Field(6.0, description="weight of the steps of solved paths, moved and turned [-]")

    @model_validator(mode="after")
    def _something(self):
        if not any((self.straight, self.light, self.paths)):
            raise ValueError("no class of rows has a weight; give one to straight, light or paths")
        return self


class Synthesis(Section):
    """A training set of simulated sensors: a few solved presses, moved to many places, and drawn images of each."""

    rows: int = Field(8000, ge=32, le=1_000_000, description="training rows [-]")
    rows_per_shard: int = Field(1000, ge=32, le=100_000, description="rows of one job and file [-]")
    sites: int = Field(
        8,
        ge=2,
        le=40,
        description="solved places along half the width between which straight presses are interpolated; on a symmetric "
        "sensor n (n + 1) / 2 sites are solved [-]",
    )
    paths: int = Field(
        80,
        ge=1,
        le=10_000,
        description="solved paths of drawn indenters, whose steps are moved and turned [-]",
    )
    seed: int = Field(0, ge=0, description="seed of all draws [-]")
    train_on: Literal["simulated", "both"] = Field(
        "simulated",
        description="simulated: all rows of recordings are for testing; both: their training rows are learnt from too",
    )
    classes: DrawnRows = Field(DrawnRows(), description="classes of rows")
    shapes: DrawnShapes = Field(DrawnShapes(), description="indenters of paths")
    depth_mm: Range = Field(
        [0.3, 2.0],
        description="deepest depths of paths, least and greatest; straight presses reach the greatest [mm]",
    )
    steps: int = Field(5, ge=1, le=50, description="loading steps of each path, evenly spaced [-]")
    sheared: Share = Field(0.5, description="share of paths that then move sideways [-]")
    shear_mm: Range = Field([0.2, 1.2], description="how far, any direction [mm]")
    tilted: Share = Field(0.15, description="share of those not sheared that is tilted at depth [-]")
    tilt_deg: Range = Field([1.0, 4.0], description="how far, about any axis in the plane [deg]")
    twisted: Share = Field(
        0.0, description="share of those neither sheared nor tilted that is twisted at depth [-]"
    )
    twist_deg: Range = Field([3.0, 15.0], description="how far, about z, either way [deg]")
    unloaded: Share = Field(0.3, description="share that is unloaded step by step [-]")
    margin_mm: NonNegative = Field(3.0, description="least distance of a position from the sides [mm]")
    particles: VirtualParticles = Field(VirtualParticles(), description="particles")
    camera: Camera = Field(description="camera, a pinhole; that of the recordings, or its reference view")
    imaging: VirtualImaging = Field(VirtualImaging(), description="how the camera draws")
    views: DrawnViews = Field(DrawnViews(), description="how image series differ")

    @model_validator(mode="after")
    def _pinhole(self):
        if self.camera.focal_px is None:
            raise ValueError("camera: images are drawn by a pinhole; give focal_px")
        return self
