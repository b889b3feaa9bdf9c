"""Mappings: a declared description of somebody else's files of mechanical tests, YAML in, validated models out.

A mapping says how the table is written and which column is what, in which unit, sign and measure; the readers
need no code for a new machine. `gelforge.config` does not import this module: a study does not contain a mapping, and
the table reader behind it loads pandas, which a site's job does without.
"""

from __future__ import annotations

import re
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from gelforge.config.foreign.table_form import Rows, TableForm
from gelforge.config.studies.files import load_section
from gelforge.section import ConfigError, Name, Positive, Section
from gelforge.units import UNITS, known_unit

STRAIN_QUANTITY = {
    "stretch": "number",
    "engineering": "number",
    "true": "number",
    "shear": "number",
    "displacement": "length",
    "gap": "length",
}
STRESS_QUANTITY = {
    "nominal": "pressure",
    "cauchy": "pressure",
    "cauchy_difference": "pressure",
    "force": "force",
    "inflation": "pressure",
}


def _file_name(name: str) -> str:
    if not name or set(name) & set("/\\\0*?[") or name in (".", ".."):
        raise ValueError(f"{name!r} is not the name of a file; name a file without its folder")
    return name


FileName = Annotated[str, AfterValidator(_file_name)]


class Column(Section):
    """A column, its unit and sign."""

    column: str = Field(description="name in the header, or the number from 1 where there is none")
    unit: str = Field(description="unit of the values in the file")
    sign: Literal[-1, 1] = Field(1, description="-1 turns the sign (compression is negative here)")

    @model_validator(mode="after")
    def _unit_known(self):
        known_unit(self.unit)
        return self

    @property
    def known_unit(self) -> str:
        """Return the unit as UNITS spells it."""
        return known_unit(self.unit)

    def require(self, quantity: str, what: str) -> None:
        """Raise ValueError unless the unit belongs to the quantity."""
        if UNITS[self.known_unit][0] != quantity:
            fitting = [unit for unit, (q, _, _) in UNITS.items() if q == quantity]
            raise ValueError(f"{what}: unit {self.unit!r} is no {quantity}; one of {fitting}")


class Strain(Column):
    """What the file calls a strain."""

    unit: str = Field("1", description="unit of the values in the file")
    measure: Literal["stretch", "engineering", "true", "shear", "displacement", "gap"] = Field(
        description="what the column holds; gap: distance between the plates, its first value is the gauge length unless"
        " that is given"
    )

    @model_validator(mode="after")
    def _quantity(self):
        self.require(STRAIN_QUANTITY[self.measure], f"measure {self.measure}")
        return self


class Stress(Column):
    """What the file calls a stress."""

    measure: Literal["nominal", "cauchy", "cauchy_difference", "force", "inflation"] = Field(
        description="what the column holds; cauchy_difference: sigma_1 - sigma_2; inflation: pressure inside a membrane"
    )
    at: Strain | None = Field(None, description="own stretch of this stress, where it is not that of the row")

    @model_validator(mode="after")
    def _quantity(self):
        self.require(STRESS_QUANTITY[self.measure], f"measure {self.measure}")
        return self


class Time(Column):
    """The time column."""

    unit: str = Field("s", description="unit of the values in the file")
    restarts_with: str | None = Field(
        None, description="column in whose every new value the time begins at 0 again"
    )


class Lateral(Section):
    """The second in-plane direction of a biaxial test; one way of giving its stretch."""

    strain: Strain | None = Field(None, description="its own column")
    extension_ratio: float | None = Field(None, description="lam_2 - 1 = ratio (lam_1 - 1)")
    stress: Stress | None = Field(None, description="its stress, where measured")


class FromName(Section):
    """Values that a file's name holds; read only where this is declared."""

    pattern: str = Field(
        description="regular expression on the name without suffix; named groups: sample, material, rate_per_s, age_days,"
        " temperature_C, dose, cycle"
    )
    decimal: str = Field(".", description="stands for the decimal point in the name, e.g. d in 0d05")

    @model_validator(mode="after")
    def _groups(self):
        try:
            groups = set(re.compile(self.pattern).groupindex)
        except re.error as error:
            raise ValueError(f"pattern {self.pattern!r} is no regular expression ({error})") from None
        known = {"sample", "material", "rate_per_s", "age_days", "temperature_C", "dose", "cycle"}
        if not groups or groups - known:
            raise ValueError(f"pattern names {sorted(groups)}; groups may be {sorted(known)}")
        return self


class Corrections(Section):
    """What is changed only when it is asked for here; otherwise it is reported."""

    toe: Literal["keep", "remove"] = Field(
        "keep", description="move the origin of stretch to the zero of stress"
    )
    zero_force: bool = Field(False, description="subtract the stress of the rows at rest")
    zero_strain: bool = Field(False, description="let the first row be at rest")
    time: Literal["refuse", "sort", "set_aside"] = Field(
        "refuse",
        description="a time that goes back: refuse the file, sort its rows, or read it without a time",
    )
    odd_rows: Literal["refuse", "keep"] = Field(
        "refuse",
        description="single rows far off their curve, and a start under load: refuse, or keep as right",
    )
    unsorted: Literal["refuse", "sort"] = Field(
        "refuse",
        description="rows in no order, as digitised points: refuse, or sort by stretch (without a time)",
    )
    after_fall: Literal["refuse", "cut", "keep"] = Field(
        "refuse",
        description="rows after a sudden fall of the stress (rupture, slip of the grip): refuse, cut there, or keep",
    )
    repeated_time: Literal["keep", "average"] = Field("keep", description="rows with the same time stamp")


class TestMapping(Section):
    """Files of one kind."""

    __test__ = False  # not a test case for pytest

    files: list[str] = Field(min_length=1, description="patterns of file names, e.g. '*__UT.csv'")
    optional: bool = Field(False, description="whether the entry may find no file")
    kind: Literal[
        "uniaxial",
        "compression",
        "pure_shear",
        "equibiaxial",
        "biaxial",
        "simple_shear",
        "indentation",
        "force_pair",
    ] = Field(description="what was done to the material")
    history: Literal["monotonic", "cyclic", "relaxation"] = Field("monotonic", description="in which order")
    table: TableForm = Field(TableForm(), description="how the table is written")
    rows: list[Rows] = Field([], description="which rows are read, e.g. those of one cycle; none: all")
    material: Name | None = Field(None, description="name of the material")
    strain: Strain | None = Field(
        None, description="what the test machine moved, or a strain measured next to it"
    )
    stress: Stress | None = Field(None, description="its answer, a stress or a force")
    lateral: Lateral | None = Field(None, description="biaxial: the second in-plane direction")
    time: Time | None = Field(None, description="time of the rows; needed for rates, holds and cycles")
    radius: Column | None = Field(None, description="radius of curvature at the apex of a membrane")
    height: Column | None = Field(None, description="indentation: position, growing with depth once signed")
    force: Column | None = Field(None, description="indentation or first load cell")
    force_2: Column | None = Field(None, description="second load cell")
    rate: Column | None = Field(None, description="column with the stretch rate of the loading")
    temperature: Column | None = Field(None, description="column with the temperature of the specimen")
    also: list[Strain | Stress] = Field([], description="the same test in other measures: must agree")
    split: str | None = Field(None, description="column whose every value is a sample of its own")
    segment: str | None = Field(None, description="column that names the segments, or places of a force pair")
    from_name: FromName | None = Field(None, description="values that the file's name holds")
    gauge_length_mm: Positive | None = Field(
        None, description="undeformed length between clamps or marks; needed with measure displacement"
    )
    cross_section_mm2: Positive | None = Field(
        None, description="undeformed width times thickness; needed with measure force"
    )
    thickness_mm: Positive | None = Field(None, description="membrane: undeformed thickness")
    ball_radius_mm: Positive | None = Field(None, description="indentation: radius of the ball")
    layer_thickness_mm: Positive | None = Field(
        None, description="indentation: thickness on a rigid base; null: half space"
    )
    rigid_board: FileName | None = Field(
        None,
        description="indentation: name of the file of the same motion on a rigid board (the machine's own compliance)",
    )
    spring_constant_N_per_m: Positive | None = Field(None, description="AFM: bending F/k leaves the depth")
    rate_per_s: Positive | None = Field(None, description="stretch rate of the loading, as declared")
    age_days: float | None = Field(None, description="age of the specimen since curing")
    temperature_C: float | None = Field(None, description="temperature of the specimen")
    plausible_shear_modulus_kPa: tuple[Positive, Positive] = Field(
        (0.5, 5000.0), description="outside, a unit must be wrong; narrow it where the material is known"
    )
    plausible_stiffness_N_per_m: tuple[Positive, Positive] = Field(
        (1e-5, 1e6), description="indentation: range of force over travel; outside, a unit must be wrong"
    )
    plausible_force_N: tuple[Positive, Positive] = Field((1e-3, 1e4), description="load cells: largest force")
    corrections: Corrections = Field(
        Corrections(), description="what is changed in the curves; the rest is only reported"
    )

    @model_validator(mode="after")
    def _complete(self):
        needed = {"indentation": ("height", "force"), "force_pair": ("force", "force_2")}
        for name in needed.get(self.kind, ("strain", "stress")):
            if getattr(self, name) is None:
                raise ValueError(f"kind {self.kind} needs `{name}`; declare its column")
        quantities = {
            "time": "time",
            "rate": "rate",
            "temperature": "temperature",
            "force": "force",
            "force_2": "force",
            "height": "length",
            "radius": "length",
        }
        for name, quantity in quantities.items():
            if getattr(self, name) is not None:
                getattr(self, name).require(quantity, name)
        if self.strain and (self.strain.measure == "shear") != (self.kind == "simple_shear"):
            raise ValueError(
                f"measure {self.strain.measure} in a test of kind {self.kind}; shear goes with shear"
            )
        if self.strain and self.strain.measure == "displacement" and self.gauge_length_mm is None:
            raise ValueError("measure displacement needs gauge_length_mm; give the length between the clamps")
        if self.stress and self.stress.measure == "force" and self.cross_section_mm2 is None:
            raise ValueError(
                "measure force needs cross_section_mm2; give the undeformed width times thickness"
            )
        if self.stress and self.stress.measure == "inflation":
            if self.kind != "equibiaxial" or self.radius is None or self.thickness_mm is None:
                raise ValueError("measure inflation needs kind equibiaxial, `radius` and `thickness_mm`")
        return self


class Mapping(Section):
    """A folder's files: each is read by the first entry one of whose patterns fits its name, and by all entries that repeat
    that pattern: curves side by side in one table."""

    describes: str = Field(description="whose files these are, in words")
    ignore: list[str] = Field(
        ["LICENSE*", "License*", "README*"], description="patterns of files that are no tests"
    )
    common: dict[str, Any] = Field({}, description="keys that every entry has unless it gives its own")
    tests: list[TestMapping] = Field(
        min_length=1,
        description="entries; a file is read by the first one with a pattern that fits its name, and by others with the"
        " same pattern",
    )

    @model_validator(mode="before")
    @classmethod
    def _with_common(cls, content):
        if isinstance(content, dict) and isinstance(content.get("tests"), list):
            common = content.get("common") or {}
            tests = [{**common, **entry} if isinstance(entry, dict) else entry for entry in content["tests"]]
            content = {**content, "tests": tests}
        return content

    def entries_for(self, name: str) -> list[TestMapping]:
        """Return the entries that read a file of this name (relative to the folder); none for an ignored one."""
        short = name.rsplit("/", 1)[-1]
        if any(fnmatch(short, pattern) for pattern in self.ignore):
            return []
        for entry in self.tests:
            for pattern in entry.files:
                if fnmatch(name, pattern) or fnmatch(short, pattern):
                    return [other for other in self.tests if other is entry or pattern in other.files]
        patterns = [pattern for entry in self.tests for pattern in entry.files]
        raise ConfigError(f"{name}: no entry of the mapping fits this file; its patterns are {patterns}")

    def entry_for(self, name: str) -> TestMapping | None:
        """Return the first entry that reads a file of this name (relative to the folder), None for an ignored one."""
        return next(iter(self.entries_for(name)), None)


# A ball as wide as the widest sensor (SENSOR_MM in indentation/sensor/sizes.py).
LARGEST_BALL_MM = 200.0


class Microindentation(Section):
    """The sidecar <name>.yaml of a microindentation <name>.csv (depth_mm, force_N)."""

    ball_radius_mm: Positive = Field(
        le=LARGEST_BALL_MM, description="radius of the ball; a larger one is given in another unit [mm]"
    )
    layer_thickness_mm: Positive | None = Field(
        None, description="thickness on a rigid base; null: half space [mm]"
    )
    rigid_board: FileName | None = Field(
        None,
        description="CSV in the same folder: the same motion on a rigid board, for the machine's own compliance",
    )
    odd_rows: Literal["refuse", "keep"] = Field(
        "refuse",
        description="single rows far off their curve, and a modulus that no gel has: refuse, or keep as right",
    )


def load_microindentation(path: str | Path) -> Microindentation:
    """Return the settings of a microindentation that a YAML file next to it gives.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Microindentation
        Validated: ball radius and thickness [mm].

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key or a value out of range.
    """
    return load_section(path, Microindentation)


def load_mapping(path: str | Path) -> Mapping:
    """Return the mapping that says what the columns of material tests mean.

    Parameters
    ----------
    path : str or Path
        YAML.

    Returns
    -------
    Mapping
        Validated.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key, column or unit.
    """
    return load_section(path, Mapping)
