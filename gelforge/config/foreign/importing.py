"""An import: a declared description of a laboratory's raw logs of one session, YAML in, a validated model out.

`gelforge.config` does not import this module: a study does not contain an import (see `mapping`).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from gelforge.config.foreign.session_keys import check_acts_on
from gelforge.config.foreign.table_form import Rows, TableForm
from gelforge.config.studies.files import load_section
from gelforge.section import NonNegative, Positive, Section
from gelforge.units import UNITS, unit_named


def _known(unit: str, quantity: str, key: str) -> str:
    """Return a unit as UNITS spells it. Raises ValueError unless it is known and belongs to the quantity."""
    known = unit_named(unit)
    if known is None or UNITS[known][0] != quantity:
        fitting = [name for name, (q, _, _) in UNITS.items() if q == quantity]
        raise ValueError(f"{key}: unit {unit!r} is no {quantity}; one of {fitting}")
    return known


class Stamp(Section):
    """The column, or the two columns, that hold the time of a row."""

    column: str | list[str] = Field(
        description="name in the header, or the number from 1 where there is none; two names: a date and a time of day, or"
        " seconds and their fraction"
    )
    unit: str | list[str] = Field(
        "iso",
        description="unit of the stamps (s, ms, us, ns, min, h:mm:ss), of each of two columns of numbers, or iso: date and"
        " time, ISO 8601 unless `format` says otherwise",
    )
    format: str | None = Field(
        None,
        min_length=1,
        description="format of date and time for strptime: '%m/%d/%Y %I:%M:%S.%f %p'",
    )

    @model_validator(mode="after")
    def _unit_known(self):
        if not 1 <= len(self.columns) <= 2:
            raise ValueError("column is one name, or two")
        if self.is_date:
            return self
        if self.format:
            raise ValueError(f"format is for dates, unit {self.unit!r} for numbers; leave one of them out")
        if len(self.units) != len(self.columns):
            raise ValueError(
                f"{len(self.columns)} columns of stamps and {len(self.units)} units; give each its unit"
            )
        for unit in self.units:
            _known(unit, "time", "unit (or iso)")
        return self

    @property
    def columns(self) -> list[str]:
        """Return the names of the columns."""
        return [self.column] if isinstance(self.column, str) else self.column

    @property
    def units(self) -> list[str]:
        """Return the unit of each column."""
        return [self.unit] if isinstance(self.unit, str) else self.unit

    @property
    def is_date(self) -> bool:
        """Return whether the columns hold texts of date and time."""
        return self.unit == "iso"


class Stamped(Section):
    """When the rows or frames of one source were taken."""

    time: Stamp | None = Field(None, description="column of time stamps")
    rate_hz: Positive | None = Field(
        None,
        description="in place of stamps: rate of rows or frames, if none is lost [1/s]",
    )
    even: bool = Field(
        False, description="evenly spaced; the stamps are replaced by the straight line through them"
    )

    @model_validator(mode="after")
    def _even_stamps(self):
        if self.even and not self.time:
            raise ValueError("even is about time stamps; name their column under `time`")
        return self


class Rowed(Section):
    """Which rows of a file are read, and how it is written."""

    topic: str | None = Field(None, description="of a bag or MCAP file: the topic whose messages are rows")
    frame_id: str | None = Field(
        None, description="of such a topic: only the messages of this frame are read"
    )
    table: TableForm = Field(TableForm(), description="how the table is written")
    rows: list[Rows] = Field([], description="which rows of the table are read; none: all")


class Clock(Stamped):
    """When the rows or frames of one source were taken, and how its clock stands to the stage's."""

    lag_s: float | None = Field(
        None,
        description="delay of this clock relative to the stage's; null: estimated by correlation [s]",
    )
    drift: bool = Field(
        False,
        description="the rate of this clock is estimated too; false: a drift of more than 6 ms is refused",
    )

    @model_validator(mode="after")
    def _one_time(self):
        if self.time and self.rate_hz:
            raise ValueError(
                "time and rate_hz are both given; keep the one that says when the rows were taken"
            )
        return self


class ForceSource(Rowed, Clock):
    """The log of the force/torque sensor."""

    file: str = Field(description="CSV, ROS bag or MCAP, from the mapping's folder")
    columns: list[str] = Field(
        min_length=3, max_length=3, description="columns of the force along the sensor's x, y and z"
    )
    unit: str = Field(description="unit of the force: N, mN, lbf, ...")
    counts_per_unit: Positive | None = Field(
        None,
        description="counts per unit of force, where the columns hold counts; null: as a line above the header says, if the"
        " values are whole numbers",
    )

    @model_validator(mode="after")
    def _complete(self):
        _known(self.unit, "force", "force.unit")
        if not (self.time or self.rate_hz):
            raise ValueError("no time: name the column of stamps under `time`, or give rate_hz")
        return self


class GCode(Section):
    """How a stage runs G-code: every motion begins and ends at rest."""

    acceleration_mm_s2: Positive | None = Field(
        None, description="of every motion along its path; null: unlimited [mm/s2]"
    )
    rapid_mm_s: Positive | None = Field(None, description="speed of G0; null: the last F, as of G1 [mm/s]")
    rate_hz: Positive = Field(100.0, description="rows per second of the log that is computed [1/s]")


class Polar(Section):
    """Columns of polar positions: x = radius cos(angle), y = radius sin(angle)."""

    radius: str = Field(description="column of the distance from the origin, in the stage's unit")
    angle: str = Field(description="column of the angle from x towards y [deg]")


class StageSource(Rowed, Stamped):
    """The log of the stage or robot; its clock is that of the session."""

    file: str = Field(description="CSV, ROS bag, MCAP or G-code, from the mapping's folder")
    gcode: GCode | None = Field(
        None,
        description="the file is G-code that the stage ran; x, y, z are axes, X, Y, Z; its clock starts at 0",
    )
    x: str | float | None = Field(
        None, description="column of x, or the position itself where it does not change [mm]"
    )
    y: str | float | None = Field(
        None, description="column of y, or the position itself where it does not change [mm]"
    )
    polar: Polar | None = Field(None, description="in place of x and y: columns of polar positions")
    z: str = Field(description="column of the axis that presses")
    unit: str = Field(description="unit of the positions: mm, um, m, in")
    pressing: Literal["+z", "-z"] = Field(description="direction of that axis that increases the depth")

    @model_validator(mode="after")
    def _complete(self):
        _known(self.unit, "length", "stage.unit")
        if self.polar and (self.gcode or self.topic):
            raise ValueError("polar positions are columns of a table; leave polar out")
        if (self.polar is None) != (self.x is not None) or (self.x is None) != (self.y is None):
            raise ValueError("where it presses is said once: give x and y, or polar")
        if self.gcode:
            if self.time or self.rate_hz or self.even or self.topic or self.unit != "mm":
                raise ValueError(
                    "gcode makes times from feed rates, in mm; leave out time, rate_hz, even, topic; unit: mm"
                )
            return self
        if bool(self.time) == bool(self.rate_hz):
            raise ValueError("name the column of stamps under `time`, or give rate_hz")
        return self


class CameraSource(Clock):
    """A video file, a topic of images in a bag or MCAP file, or a folder of frames."""

    video: str | None = Field(None, description="video file, from the mapping's folder")
    topic: str | None = Field(
        None, description="of a bag or MCAP file named by `video`: the topic whose messages are images"
    )
    frames: str | None = Field(None, description="folder of frames, in the order of their names")
    times: str | None = Field(
        None, description="CSV with one row per frame, in their order; `time` names its column of stamps"
    )
    table: TableForm = Field(TableForm(), description="how that table is written")
    from_name: str | None = Field(
        None,
        description="regular expression whose only group is the stamp in a frame's name; unit: name_unit",
    )
    name_unit: str = Field("s", description="unit of the stamps in the names")
    container: bool = Field(False, description="true: the stamps of the video or bag are used")

    @model_validator(mode="after")
    def _complete(self):
        if (self.video is None) == (self.frames is None):
            raise ValueError("give either video (a file) or frames (a folder)")
        if (self.times is None) != (self.time is None):
            raise ValueError("times (a CSV) and time (its column) go together; give both or neither")
        if self.from_name is not None:
            _known(self.name_unit, "time", "name_unit")
            try:
                groups = re.compile(self.from_name).groups
            except re.error as error:
                raise ValueError(f"from_name {self.from_name!r} is no regular expression ({error})") from None
            if groups != 1 or self.frames is None:
                raise ValueError(
                    "from_name has one group, the stamp in the name of a frame; it goes with frames"
                )
        if self.container and self.video is None:
            raise ValueError("container is about the stamps of a video; a folder of frames has none")
        ways = [bool(self.times), bool(self.from_name), self.container, self.rate_hz is not None]
        if sum(ways) != 1:
            raise ValueError(
                "say once when frames were taken: times and time (a CSV of stamps), from_name (stamps in names), rate_hz "
                "(evenly, none dropped), or container: true (the video's own stamps)"
            )
        return self


class Surface(Section):
    """A known contact point."""

    at_mm: float = Field(description="position of the pressing axis at depth zero, as the log has it, in mm")


class ImportMapping(Section):
    """Raw logs of one session: which column is what, in which unit, and what makes the numbers readable."""

    describes: str = Field(description="whose logs these are, in words")
    force: ForceSource = Field(description="log of the force/torque sensor")
    stage: StageSource = Field(description="log of the stage or robot; its clock is that of the session")
    camera: CameraSource | None = Field(
        None, description="video, images of a bag, or folder of frames; null: none"
    )
    depth_zero: Literal["session", "press"] | Surface = Field(
        description="session: the median contact point; press: the contact point of each indentation; at_mm: a known one"
    )
    session: dict[str, Any] = Field(
        description="keys of session.yaml: sensor, indenter, stage_to_sensor, camera, ...; force.acts_on is required"
    )
    skip: list[int] = Field([], description="indentations to leave out, by their number in import.png")
    incomplete: Literal["refuse", "drop"] = Field(
        "refuse", description="what happens to indentations that the begin or end of a log cuts"
    )
    least_retreat_mm: Positive = Field(
        0.2, description="smallest retreat of the stage between indentations [mm]"
    )
    least_dwell_s: Positive = Field(0.3, description="shortest standstill of the stage that is a wait [s]")
    contact_within_mm: Positive = Field(
        0.1,
        description="of depth_zero session or at_mm: largest distance of contact points from their median [mm]",
    )
    ramp_depths_mm: list[Positive] = Field(
        [],
        description="depths at which loading and unloading without a wait are read [mm]; none: the deepest",
    )
    frames_per_dwell: int = Field(3, ge=1, le=1000, description="readings of a wait, each with its frame [-]")
    settle_s: NonNegative = Field(0.1, description="time from arrival to the first of these [s]")

    @model_validator(mode="after")
    def _session_keys(self):
        check_acts_on(self.session)
        if "session" in self.session:
            raise ValueError("session.session is the name of the folder that is written; leave it out")
        if "by" in (self.session.get("depth_zero") or {}):
            raise ValueError("session.depth_zero.by follows from depth_zero; leave it out")
        return self


def load_import(path: str | Path) -> ImportMapping:
    """Return the mapping that says what the columns of a session's logs mean.

    Parameters
    ----------
    path : str or Path
        YAML.

    Returns
    -------
    ImportMapping
        Validated.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key, column or unit.
    """
    return load_section(path, ImportMapping)
