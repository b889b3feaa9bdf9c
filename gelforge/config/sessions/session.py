"""A recording session: force sensor, stage and camera."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from gelforge.config.parts.camera import Camera, Remap
from gelforge.section import GrownSection, Name, NonNegative, Pair, Positive, Section


def _for_each_axis(value: Any) -> Any:
    """Return one number as three, one per axis; anything else as it is."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return [value] * 3 if number else value


def _as_text(value: Any) -> Any:
    """Return a date that reads as a number (20240514 without quotes) as text; anything else as it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


class ForceSensor(GrownSection):
    """How the force readings of any laboratory are read."""

    later = ("turns_with",)
    acts_on: Literal["sensor", "indenter"] = Field(
        "sensor", description="body on which the recorded force acts"
    )
    axes: list[list[float]] = Field(
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        description="3x3 rotation from the recorded axes to the sensor frame [-]",
    )
    turns_with: Literal["sensor", "stage"] = Field(
        "sensor",
        description="what its axes keep to where sensor and stage are at an angle (tilt): the sensor under which it lies,"
        " or the stage",
    )
    tared: bool = Field(
        False, description="zero already subtracted; if false each indentation's zero rows are used"
    )
    resolution_N: list[Positive] = Field([0.03, 0.03, 0.06], description="resolution of x, y, z [N]")
    range_N: list[Positive] | None = Field(None, description="largest force of x, y, z [N]")
    repeatability_N: Annotated[list[NonNegative] | None, BeforeValidator(_for_each_axis)] = Field(
        None,
        description="standard deviation of repeated readings of x, y, z; one number stands for all three [N]",
    )

    delay_s: float = Field(
        0.0, description="how much later than the stage's clock ft.csv stamps its samples [s]"
    )

    @model_validator(mode="after")
    def _axes(self):
        A = self.axes
        if len(A) != 3 or any(len(row) != 3 for row in A):
            raise ValueError("axes must be 3 rows of 3 numbers")
        for i in range(3):
            for j in range(3):
                dot = sum(A[i][k] * A[j][k] for k in range(3))
                if abs(dot - (i == j)) > 1e-6:
                    raise ValueError(
                        f"axes rows {i} and {j} have product {dot:.4g}; the rows must be orthonormal"
                    )
        for name in ("resolution_N", "range_N", "repeatability_N"):
            if getattr(self, name) is not None and len(getattr(self, name)) != 3:
                raise ValueError(f"{name} needs three numbers (x, y, z)")
        return self


class StageToSensor(GrownSection):
    """Commanded stage position -> sensor frame: x_sensor = R(rotation) H x_stage + origin."""

    later = ("repeatability_mm",)
    origin_mm: Pair = Field([0.0, 0.0], description="stage origin in the frame [mm]")
    rotation_deg: float = Field(0.0, description="rotation about z, counter-clockwise [deg]")
    handedness: Literal["right", "left"] = Field(
        "right", description="left: the stage's y axis is flipped first"
    )
    repeatability_mm: NonNegative | None = Field(
        None,
        description="standard deviation along x and y of the positions that the stage reaches for one commanded position;"
        " null: positions are known to 0.01 mm [mm]",
    )


class DepthZero(Section):
    """How depth zero was found, and the two errors of the depth: one of each indentation, one of the whole session."""

    by: Literal["session", "press"] = Field("session", description="once per session or at every indentation")
    how: str = Field("", description="procedure in words")
    press_scatter_mm: NonNegative | None = Field(
        None,
        description="standard deviation of the depth from one indentation to the next, one draw each: the stage's"
        " repeatability and, "
        "with by: press, how well each indentation finds its zero; null: not known [mm]",
    )
    session_scatter_mm: NonNegative | None = Field(
        None,
        description="standard deviation of the session's contact point, one draw for all its indentations; null:"
        " not known [mm]",
    )

    @property
    def both_scatter_mm(self) -> float:
        """Return the standard deviation of an indentation's depth from both errors, as far as they are known [mm]."""
        return math.hypot(self.press_scatter_mm or 0.0, self.session_scatter_mm or 0.0)


class Session(GrownSection):
    """One recording session: session.yaml."""

    later = ("remap",)
    session: Name = Field(description="name of the session, equal to its folder")
    synthetic: bool = Field(False, description="true: made by a virtual lab, not measured")
    sensor: str = Field("", description="serial or name of the sensor that was pressed")
    indenter: str = Field("", description="indenter used")
    date: Annotated[str, BeforeValidator(_as_text)] = Field(
        "", description="date of the session, with quotes or without"
    )
    notes: str = Field("", description="anything else")
    temperature_C: float | None = Field(None, description="room temperature [degC]")
    sensor_age_days: NonNegative | None = Field(None, description="age of the sensor [d]")
    force: ForceSensor = Field(ForceSensor(), description="force/torque sensor")
    stage_to_sensor: StageToSensor = Field(StageToSensor(), description="stage frame")
    depth_zero: DepthZero = Field(DepthZero(), description="depth zero")
    base_parameters: Literal["exact", "from_fit"] = Field(
        "from_fit", description="exact: the material constants carry no uncertainty for this recording"
    )
    camera: Camera | None = Field(None, description="camera, null for a force-only recording")
    crop_px: list[int] | None = Field(
        None, min_length=4, max_length=4, description="left, top, width, height used of each image [px]"
    )
    remap: Remap | None = Field(
        None,
        description="reference view to which every image is remapped; null: images are used as recorded",
    )

    confirmed: list[str] = Field(
        [],
        description="tests of the session as a whole whose findings the laboratory confirms as right; they become notes",
    )

    @model_validator(mode="after")
    def _crop_inside(self):
        if self.crop_px:
            left, top, width, height = self.crop_px
            if left < 0 or top < 0 or width < 1 or height < 1:
                raise ValueError(f"crop_px {self.crop_px} must be left, top >= 0 and width, height >= 1")
            camera = self.camera
            if camera and (left + width > camera.width_px or top + height > camera.height_px):
                raise ValueError(
                    f"crop_px {self.crop_px} reaches beyond the image of {camera.width_px} x {camera.height_px} px"
                )
        return self

    @model_validator(mode="after")
    def _one_view(self):
        if self.remap and self.crop_px:
            raise ValueError(
                f"crop_px {self.crop_px} and remap are both given: remap.view already says which part is seen; remove"
                " crop_px, and give remap.view the size and centre_px of that part"
            )
        if self.remap and self.camera is None:
            raise ValueError("remap needs the camera that took the images; describe it under camera")
        return self
