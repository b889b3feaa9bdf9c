"""A camera under the gel: scale, lens, window and pose; and the one view to which a session's images are remapped."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from gelforge.section import GrownSection, NonNegative, Pair, Positive, Section, Triple

LENS = {"pinhole": ("k1", "k2", "p1", "p2", "k3"), "fisheye": ("k1", "k2", "k3", "k4")}


# Along a side: a camera of 150 megapixels has 14 204 (Phase One IQ4, 2018).
LARGEST_IMAGE_PX = 20_000


class Distortion(Section):
    """A lens as OpenCV describes it, in the pixels of the images as recorded, mirrored or not."""

    model: Literal["pinhole", "fisheye"] = Field(
        "pinhole", description="pinhole: radial and tangential; fisheye: by the angle of the ray"
    )
    coefficients: list[float] = Field(
        description="pinhole: k1, k2, p1, p2[, k3]; fisheye: k1, k2, k3, k4; OpenCV's order [-]"
    )

    @model_validator(mode="after")
    def _count(self):
        names, count = LENS[self.model], len(self.coefficients)
        if count != len(names) and not (self.model == "pinhole" and count == 4):
            raise ValueError(f"{count} coefficients; model {self.model} has {', '.join(names)}")
        return self


class Port(Section):
    """What light from below passes in turn: air, perhaps a clear pane, then the gel; flat faces across the sensor's z."""

    z_mm: float = Field(description="face on which air ends, in the sensor frame [mm]")
    index: float = Field(
        ge=1, le=3, description="refractive index of the gel; silicones have 1.40 to 1.43 [-]"
    )
    pane_mm: NonNegative = Field(0.0, description="thickness of a clear pane between air and gel [mm]")
    pane_index: float = Field(1.49, ge=1, le=3, description="refractive index of the pane; acrylic 1.49 [-]")


class Camera(GrownSection):
    """A camera under the gel that looks up; pixel (0, 0) is the centre of the image's top left pixel.

    Seen from below with y up, x runs to the left: u = centre - focal x / z. A mirrored image runs with x as from above.
    Either a pinhole (focal_px, position_mm is the pinhole) or a flat scale (mm_per_px, position_mm is seen at centre_px).
    Focal lengths, centre_px and distortion belong to the images as recorded: what a calibration with such images finds.
    """

    later = ("focal_y_px", "distortion", "port")
    width_px: int = Field(gt=0, le=LARGEST_IMAGE_PX, description="image width [px]")
    height_px: int = Field(gt=0, le=LARGEST_IMAGE_PX, description="image height [px]")
    focal_px: Positive | None = Field(
        None,
        description="focal length of a pinhole camera, along u; along v too unless focal_y_px differs [px]",
    )
    focal_y_px: Positive | None = Field(
        None, description="focal length along v; null: as along u, square pixels [px]"
    )
    mm_per_px: Positive | None = Field(None, description="flat scale, where intrinsics are unknown [mm/px]")
    centre_px: Pair = Field(description="principal point u, v [px]")
    distortion: Distortion | None = Field(None, description="lens; null: straight lines stay straight")
    port: Port | None = Field(None, description="window that bends light; null: it goes straight")
    position_mm: Triple = Field(
        description="pinhole, or the point seen at centre_px, in the sensor frame [mm]"
    )
    rotation_deg: Triple = Field(
        [0.0, 0.0, 0.0],
        description="turns of the camera about the sensor's x, then y, then z axis, from looking straight up [deg]",
    )
    mirrored: bool = Field(
        True,
        description="true: u grows with x as seen from above (the image was flipped); false: as the camera sees it",
    )

    @property
    def focals_px(self) -> tuple[float, float] | None:
        """Return the focal lengths along u and v [px]; None for a flat scale."""
        return None if self.focal_px is None else (self.focal_px, self.focal_y_px or self.focal_px)

    @model_validator(mode="after")
    def _one_scale(self):
        if (self.focal_px is None) == (self.mm_per_px is None):
            raise ValueError(
                "give either focal_px (a pinhole) or mm_per_px (a flat scale), not both or neither"
            )
        for key in ("focal_y_px", "distortion", "port"):
            if self.focal_px is None and getattr(self, key) is not None:
                raise ValueError(f"{key} belongs to a pinhole; give focal_px instead of mm_per_px")
        if self.port and self.position_mm[2] >= self.port.z_mm:
            raise ValueError(
                f"position_mm z = {self.position_mm[2]:g} mm is not below port.z_mm {self.port.z_mm:g}; the camera "
                "stands in air under the port (one cast into the gel has no port)"
            )
        return self


class Remap(Section):
    """The one view to which every image of a session is remapped before its flow is searched.

    A pixel of the view shows what the session's camera sees at the same point of the plane z = plane_z_mm.
    """

    plane_z_mm: float = Field(
        description="plane on which both views are the same: the mean depth of the particles, sensor frame [mm]"
    )
    view: Camera = Field(description="the reference view: size, focal length, centre and pose")
