"""The sensor, its layers and bins, and the indenter."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import Field, model_validator

from gelforge.section import Fraction, Name, NonNegative, Positive, Section, Triple

Known = TypeVar("Known")


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
    """Bins of the undeformed top surface that carry the label: a regular grid of it as seen from above, or unrolled."""

    nx: int = Field(20, ge=1, le=200, description="number of bins along x [-]")
    ny: int = Field(20, ge=1, le=200, description="number of bins along y [-]")
    over: Literal["plan", "surface"] = Field(
        "plan",
        description="plan: equal rectangles seen from above; surface: of a dome, equal areas of its surface, unrolled",
    )


class Shape(Section):
    """The outer form of a sensor: a block, a half-ellipsoid, or any closed surfaces."""

    kind: Literal["block", "dome", "surfaces"] = Field(
        "block",
        description="block; dome: half-ellipsoid over width_x_mm x width_y_mm, a core under layers; surfaces: any",
    )
    files: dict[Name, Path] = Field(
        {},
        description="of surfaces: each layer's closed surface (STL, PLY, OBJ), from the inside out; a point belongs to the "
        "first that encloses it; or slabs that touch",
    )
    mm_per_unit: Positive = Field(1.0, description="of surfaces: length of the files' unit [mm]")
    origin_mm: Triple = Field(
        [0.0, 0.0, 0.0],
        description="of surfaces: point of the files, in mm, that becomes the origin of the sensor's frame [mm]",
    )
    orientation_deg: Triple = Field(
        [0.0, 0.0, 0.0],
        description="of surfaces: turns about the sensor's x, then y, then z axis, about that point [deg]",
    )
    layout_confirmed: bool = Field(
        False,
        description="of surfaces, true: they may reach into one another (the first listed keeps what they share) or face "
        "each other across a thin gap",
    )
    base_mm: float | None = Field(
        None,
        description="of surfaces: boundary at or below this z is held; null: minus the layers' height [mm]",
    )

    @model_validator(mode="after")
    def _files(self):
        if (self.kind == "surfaces") != bool(self.files):
            raise ValueError("kind: surfaces and `files`, one closed surface per layer, belong together")
        if self.base_mm is not None and self.kind != "surfaces":
            raise ValueError(f"base_mm belongs to kind: surfaces; a {self.kind} stands on its lower face")
        keys = ("mm_per_unit", "origin_mm", "orientation_deg", "layout_confirmed")
        foreign = [key for key in keys if getattr(self, key) != Shape.model_fields[key].default]
        if foreign and self.kind != "surfaces":
            raise ValueError(f"{foreign} belong to kind: surfaces; a {self.kind} is drawn from its sizes")
        return self


class Sensor(Section):
    """A layered body on a rigid base; the frame's origin is a corner of the rectangle around it, z = 0 its highest point."""

    width_x_mm: Positive = Field(32.0, description="outer width along x [mm]")
    width_y_mm: Positive = Field(32.0, description="outer width along y [mm]")
    shape: Shape = Field(Shape(), description="outer form")
    layers: list[Layer] = Field(
        min_length=1, description="soft layers from the base up; thickness at the highest point"
    )
    wall_mm: NonNegative = Field(
        1.5, description="of a block: thickness of the side wall around the lower layers [mm]"
    )
    flange: Flange | None = Field(
        None, description="of a block: rim of the wall's material on the base, or null"
    )
    bins: Bins = Field(Bins(), description="surface bins of the label")
    size_confirmed: bool = Field(
        False, description="true: the sizes are meant, also outside what sensors usually have"
    )

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
        if self.flange and self.shape.kind != "block":
            raise ValueError(
                f"a flange belongs to a block, not to shape.kind: {self.shape.kind}; use flange: null"
            )
        if self.bins.over == "surface" and self.shape.kind == "surfaces":
            raise ValueError(
                "bins.over: surface unrolls a dome; surfaces from files cannot be unrolled, use plan"
            )
        names = [layer.name for layer in self.layers]
        if self.shape.kind == "surfaces" and list(self.shape.files) != names:
            raise ValueError(
                f"shape.files names {list(self.shape.files)}, the layers are {names}; name one surface for each, in order"
            )
        return self

    @property
    def height_mm(self) -> float:
        return sum(layer.thickness_mm for layer in self.layers)

    @property
    def imaged_layers(self) -> list[Layer]:
        """The layers whose motion the camera sees: those with particles; where none has any, all."""
        return [layer for layer in self.layers if layer.particle_volume_fraction > 0] or self.layers

    def by_layer(self, by_material: Mapping[str, Known]) -> dict[str, Known]:
        """Return by layer what is known by material."""
        return {layer.name: by_material[layer.material] for layer in self.layers}


class IndenterPart(Section):
    """One rigid shape: a ball about its middle, a cylinder or box on its lower face, or the inside of a closed surface."""

    kind: Literal["sphere", "cylinder", "box", "mesh"] = Field("sphere", description="shape")
    radius_mm: Positive = Field(5.0, description="radius of a ball or cylinder [mm]")
    length_mm: Positive = Field(10.0, description="length of a cylinder [mm]")
    size_mm: list[Positive] = Field(
        [6.0, 6.0, 10.0], min_length=3, max_length=3, description="sizes of a box along x, y, z [mm]"
    )
    edge_radius_mm: Positive = Field(
        0.5, description="rounding of the edges of a cylinder, box or mesh; faces stay where they are [mm]"
    )
    file: Path | None = Field(
        None, description="closed surface of a mesh: STL, PLY or OBJ; origin_mm is over the position"
    )
    mm_per_unit: Positive = Field(1.0, description="length of the file's unit [mm]")
    origin_mm: Triple | None = Field(
        None,
        description="point of the file, in mm, that is the shape's origin, over the position; null: the file's own, and "
        "then the body must lie over the position [mm]",
    )
    orientation_deg: Triple = Field(
        [0.0, 0.0, 0.0],
        description="turns about the sensor's x, then y, then z axis, about the shape's origin [deg]",
    )
    offset_mm: Triple = Field(
        [0.0, 0.0, 0.0],
        description="x, y from the position, and height of the lowest point over that of the lowest part [mm]",
    )
    size_confirmed: bool = Field(
        False, description="true: the size is meant, even if it is tiny or huge compared with the sensor"
    )
    need_not_touch: bool = Field(
        False, description="of one of several parts, true: it may stay clear of the sensor, as a ball's stem"
    )

    @model_validator(mode="after")
    def _sizes(self):
        belongs = SHAPE_KEYS.get(self.kind, {"parts"})
        others = set().union(*SHAPE_KEYS.values()) - belongs
        foreign = sorted(key for key in others if getattr(self, key) != type(self).model_fields[key].default)
        if foreign:
            raise ValueError(f"{foreign} do not belong to kind: {self.kind}, which has {sorted(belongs)}")
        if (self.kind == "mesh") != (self.file is not None):
            raise ValueError("kind: mesh needs `file`, the STL, PLY or OBJ of a closed surface")
        least = {"cylinder": min(self.radius_mm, self.length_mm / 2), "box": min(self.size_mm) / 2}.get(
            self.kind
        )
        if least is not None and self.edge_radius_mm > least:
            raise ValueError(
                f"edge_radius_mm {self.edge_radius_mm} is more than half of the {self.kind}'s least size ({least} mm); "
                "make it smaller"
            )
        return self

    @property
    def words(self) -> str:
        """The shape in words, for tables and figures."""
        edges = f", edges rounded by {self.edge_radius_mm:g} mm"
        text = {
            "sphere": f"ball of radius {self.radius_mm:g} mm",
            "cylinder": f"cylinder of radius {self.radius_mm:g} mm{edges}",
            "box": f"box of {' x '.join(f'{size:g}' for size in self.size_mm)} mm{edges}",
            "mesh": f"surface {self.file.name if self.file else ''}{edges}",
        }.get(self.kind, "")
        turned = f", turned by {self.orientation_deg} deg" if any(self.orientation_deg) else ""
        return text + (turned if self.kind != "sphere" else "")


SHAPE_KEYS = {
    "sphere": {"radius_mm"},
    "cylinder": {"radius_mm", "length_mm", "edge_radius_mm"},
    "box": {"size_mm", "edge_radius_mm"},
    "mesh": {"file", "mm_per_unit", "origin_mm", "edge_radius_mm"},
}


class Indenter(IndenterPart):
    """The rigid body that presses: one shape, or several that move together."""

    # wider than a part's: several shapes are no part of several
    kind: Literal["sphere", "cylinder", "box", "mesh", "several"] = Field(  # type: ignore[assignment]
        "sphere", description="shape"
    )
    parts: list[IndenterPart] = Field([], description="the shapes of kind: several")

    @model_validator(mode="after")
    def _parts(self):
        if (self.kind == "several") != bool(self.parts):
            raise ValueError("kind: several and `parts`, a list of shapes, belong together")
        if self.need_not_touch:
            raise ValueError(
                "need_not_touch is for one of several parts; an indenter that never touches has no labels"
            )
        if self.kind != "several" and any(self.offset_mm):
            raise ValueError(
                f"offset_mm {self.offset_mm} is for one of several parts; move the plan's positions instead"
            )
        return self

    @property
    def shapes(self) -> list[IndenterPart]:
        return self.parts or [self]

    @property
    def words(self) -> str:
        return "; ".join(part.words for part in self.parts) or super().words

    @property
    def is_upright_and_round(self) -> bool:
        """Whether it looks the same from all sides, as reused mirrored sites need."""
        return self.kind == "sphere" or (self.kind == "cylinder" and not any(self.orientation_deg[:2]))
