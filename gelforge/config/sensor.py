"""The sensor, its layers and bins, and the indenter."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from gelforge.config.common import Fraction, Name, NonNegative, Positive, Section


class Layer(Section):
    """One soft layer over the whole inner area of the sensor."""

    name: Name = Field(description="name of the layer")
    thickness_mm: Positive = Field(description="thickness [mm]")
    material: Name = Field(description="a key of `materials`")
    particle_volume_fraction: Fraction = Field(0.0, description="volume share of tracer particles [-]")


class Flange(Section):
    """A flat rim of the wall's material on the base, around the wall."""

    width_mm: Positive = Field(description="width beyond the outer edge [mm]")
    height_mm: Positive = Field(description="height above the base [mm]")


class Bins(Section):
    """Regular bins of the undeformed top surface that carry the label."""

    nx: int = Field(20, ge=1, le=200, description="number of bins along x [-]")
    ny: int = Field(20, ge=1, le=200, description="number of bins along y [-]")


class Sensor(Section):
    """A layered block on a rigid base; the frame's origin is a corner of the undeformed top surface."""

    width_x_mm: Positive = Field(32.0, description="outer width along x [mm]")
    width_y_mm: Positive = Field(32.0, description="outer width along y [mm]")
    layers: list[Layer] = Field(min_length=1, description="soft layers from the base up")
    wall_mm: NonNegative = Field(1.5, description="thickness of the side wall around the lower layers [mm]")
    flange: Flange | None = Field(None, description="rim of the wall's material on the base, or null")
    bins: Bins = Field(Bins(), description="surface bins of the label")

    @model_validator(mode="after")
    def _fits(self):
        if 2 * self.wall_mm >= min(self.width_x_mm, self.width_y_mm):
            raise ValueError(
                f"wall_mm {self.wall_mm} leaves no gel inside the sensor's width; make it thinner"
            )
        if self.flange and self.flange.height_mm >= self.height_mm:
            raise ValueError(
                f"flange height_mm {self.flange.height_mm} reaches the top ({self.height_mm} mm)"
            )
        return self

    @property
    def height_mm(self) -> float:
        return sum(layer.thickness_mm for layer in self.layers)


class Indenter(Section):
    """The rigid body that presses."""

    kind: Literal["sphere"] = Field("sphere", description="shape")
    radius_mm: Positive = Field(5.0, description="radius of the ball [mm]")
