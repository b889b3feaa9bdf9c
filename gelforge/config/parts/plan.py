"""Where and how deep the indenter presses."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_serializer, model_validator

from gelforge.section import NonNegative, Positive, Section


class Grid(Section):
    """A regular, centred grid of positions."""

    spacing_mm: Positive = Field(description="distance between neighbours [mm]")
    margin_mm: NonNegative = Field(5.0, description="distance of the outermost positions from the edges [mm]")


class Interpolation(Section):
    """How far labels between solved sites may lie from what would be solved there; one of the two is given."""

    tolerance: Positive | None = Field(
        None, description="standard deviation of a label from it over the label's own error bar [-]"
    )
    tolerance_N: Positive | None = Field(
        None, description="the same of a bin's force, root mean square over the bins that are loaded [N]"
    )

    @model_validator(mode="after")
    def _one_tolerance(self):
        if (self.tolerance is None) == (self.tolerance_N is None):
            raise ValueError(
                "give one of `tolerance` (a share of the label's own error bar, e.g. 0.5) and `tolerance_N`"
            )
        return self


class Plan(Section):
    """Where and how deep the indenter presses: a grid with depths, a CSV file, or as the sessions did."""

    grid: Grid | None = Field(None, description="regular grid of positions")
    depths_mm: list[Positive] | None = Field(None, description="increasing depths of every position [mm]")
    file: Path | None = Field(
        None,
        description="CSV with cell (the site), x_mm, y_mm, depth_mm, for a path also phase, shear_x_mm, shear_y_mm, tilts"
        " and twist",
    )
    from_: Literal["sessions"] | None = Field(
        None,
        alias="from",
        description="sessions: positions and depths are those of the indentations that the study's sessions recorded",
    )
    tolerance_mm: Positive | None = Field(
        None,
        description="recorded indentations within this distance of a site are at the site; sites within it of each other or"
        " of each other's mirror images are not split into training and test; null: the larger of 0.01 mm and five times the"
        " sessions' stage_to_sensor.repeatability_mm [mm]",
    )
    mm_per_unit: Positive | None = Field(
        None,
        description="length of the plan file's unit: 1000 for metres; 1 confirms millimetres where these seem to be "
        "another unit; null: millimetres, asked about where they cannot be meant [mm]",
    )
    symmetry: Literal["auto", "d4", "none"] = Field(
        "auto",
        description="sites that mirror and rotate into each other are solved once: auto: where sensor, indenter and effects "
        "allow it; d4: an error where they do not; none: each is solved",
    )
    approach: Literal["vertical", "normal"] = Field(
        "vertical",
        description="the indenter comes down, or along the normal of the undeformed surface at the position",
    )

    interpolation: Interpolation | None = Field(
        None,
        description="solve as many sites as it takes and interpolate the labels of all others; none: every site is solved",
    )

    @field_validator("interpolation", mode="before")
    @classmethod
    def _none(cls, value):
        return None if value == "none" else value

    @model_serializer(mode="wrap")
    def _as_written(self, write) -> dict[str, Any]:
        """Return the keys; a later one only where it holds something, so that digests of older studies stay."""
        later = ("interpolation", "from_", "tolerance_mm")
        keys = {key: value for key, value in write(self).items() if value is not None or key not in later}
        return {"from" if key == "from_" else key: value for key, value in keys.items()}

    @model_validator(mode="after")
    def _one_source(self):
        if sum(source is not None for source in (self.grid, self.file, self.from_)) != 1:
            raise ValueError("give one of `grid` with `depths_mm`, `file` and `from: sessions`")
        if (self.grid is None) != (self.depths_mm is None):
            raise ValueError("`depths_mm` belongs to `grid`; plan files and sessions have their own depths")
        if self.depths_mm and any(b <= a for a, b in zip(self.depths_mm, self.depths_mm[1:])):
            raise ValueError(f"depths_mm {self.depths_mm} must increase")
        if self.file is None and self.mm_per_unit not in (None, 1.0):
            raise ValueError("mm_per_unit converts a plan `file`; grids and sessions are in millimetres")
        return self
