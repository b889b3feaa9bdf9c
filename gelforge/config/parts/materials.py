"""Materials: raw tests to be fitted, parameters that are given, or the file of a constitutive model fitted elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Union

from pydantic import Discriminator, Field, Tag, model_validator

from gelforge.mechanics.laws.models import FAMILIES, MODELS
from gelforge.mechanics.laws.parameters import GivenParameters
from gelforge.section import GrownSection, Section


def _law_of(content) -> str:
    """Return the law that given parameters are of; those without a name are Ogden's."""
    return content.get("law", "ogden") if isinstance(content, dict) else getattr(content, "law", "ogden")


# Of the files in mechanics/laws/models: the sections of given parameters, the names of what can be fitted.
LAW_NAMES: tuple[str, ...] = tuple(FAMILIES)
if TYPE_CHECKING:  # a type checker cannot read the folder
    LawParameters = GivenParameters
    LawName = str
else:
    LawParameters = Annotated[
        Union[tuple(Annotated[model.parameters, Tag(name)] for name, model in MODELS.items())],  # noqa: UP007
        Discriminator(_law_of),
    ]
    LawName = Literal[LAW_NAMES]


class Fitting(Section):
    """Which laws are fitted to tests, how, and how one is chosen."""

    laws: Annotated[list[LawName], Field(min_length=1)] = Field(
        ["ogden2"], description="constitutive models to be fitted; ogden2: Ogden's model with two terms"
    )
    choose: Literal["aicc", "held_out", "first"] = Field(
        "aicc",
        description="law.json is the constitutive model of lowest AICc among those that describe the tests, the one"
        " that predicts"
        " held-out tests best, or the first named",
    )
    loss: Literal["linear", "soft_l1"] = Field(
        "linear", description="linear: least squares; soft_l1: robust against outliers"
    )
    bootstrap: int = Field(
        0, ge=0, le=100_000, description="bootstrap fits over specimens, for further intervals [-]"
    )

    @model_validator(mode="after")
    def _once(self):
        if len(set(self.laws)) < len(self.laws):
            raise ValueError(f"laws {self.laws}: each constitutive model once")
        return self

    def fitting_keys(self) -> dict:
        """Return what decides a fit besides its files."""
        return {name: getattr(self, name) for name in Fitting.model_fields}


class Material(Fitting, GrownSection):
    """One material: raw tests to be fitted, parameters that are given, or the file of a constitutive model."""

    later = ("file",)
    tests: Path | None = Field(None, description="folder with samples.csv and one CSV per sample")
    mapping: Path | None = Field(
        None, description="YAML that says what other people's files in `tests` hold; null: samples.csv"
    )
    parameters: LawParameters | None = Field(
        None, description="a constitutive model that is given; nothing is fitted"
    )
    file: Path | None = Field(
        None,
        description="file of a constitutive model with its covariance, as `gelforge calibrate` and `gelforge characterise`"
        " write it; nothing is fitted",
    )
    stiffness_confirmed: bool = Field(
        False, description="true: the initial Young's modulus is meant, also outside 0.5 to 5000 kPa"
    )

    @model_validator(mode="before")
    @classmethod
    def _constants_inside(cls, content):
        if isinstance(content, dict) and "law" in content and "parameters" not in content:
            inside = ", ".join(
                f"{key}: {value}" for key, value in content.items() if key not in cls.model_fields
            )
            raise ValueError(f"a model's constants stand inside `parameters`: write parameters: {{{inside}}}")
        return content

    @model_validator(mode="after")
    def _one_source(self):
        if [self.tests, self.parameters, self.file].count(None) != 2:
            raise ValueError(
                "give exactly one of `tests` (a folder to fit), `parameters` and `file` (of a constitutive model)"
            )
        if self.mapping and not self.tests:
            raise ValueError("`mapping` describes the files of `tests`; without `tests` nothing is read")
        return self

    @property
    def source(self) -> Path | None:
        """Return the folder or file that the constitutive model comes from; None where the configuration holds it."""
        return self.tests or self.file
