"""Materials: raw tests to be fitted, or parameters that are given."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Discriminator, Field, Tag, model_validator

from gelforge.config.common import NonNegative, Positive, Section


class OgdenParameters(Section):
    """Ogden's law in the convention W = sum mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3)."""

    law: Literal["ogden"] = Field("ogden", description="law")
    mu_kPa: list[float] = Field(min_length=1, max_length=4, description="moduli mu_k [kPa]")
    alpha: list[float] = Field(min_length=1, max_length=4, description="exponents alpha_k [-]")

    @model_validator(mode="after")
    def _signs(self):
        if len(self.mu_kPa) != len(self.alpha):
            raise ValueError(f"{len(self.mu_kPa)} mu_kPa but {len(self.alpha)} alpha; give one alpha per mu")
        for mu, alpha in zip(self.mu_kPa, self.alpha):
            if not mu * alpha > 0:
                raise ValueError(f"mu_kPa {mu} and alpha {alpha} must have the same sign (mu_k alpha_k > 0)")
        return self


class NeoHookeParameters(Section):
    """The neo-Hookean law W = mu/2 (I1 - 3)."""

    law: Literal["neo_hooke"] = Field(description="law")
    mu_kPa: Positive = Field(description="shear modulus [kPa]")


class MooneyRivlinParameters(Section):
    """The Mooney-Rivlin law W = C10 (I1 - 3) + C01 (I2 - 3)."""

    law: Literal["mooney_rivlin"] = Field(description="law")
    C10_kPa: Positive = Field(description="C10 [kPa]")
    C01_kPa: NonNegative = Field(description="C01 [kPa]")


class YeohParameters(Section):
    """Yeoh's law W = sum C_k0 (I1 - 3)^k."""

    law: Literal["yeoh"] = Field(description="law")
    C10_kPa: Positive = Field(description="C10 [kPa]")
    C20_kPa: float = Field(0.0, description="C20 [kPa]")
    C30_kPa: NonNegative = Field(0.0, description="C30 [kPa]")


class GentParameters(Section):
    """Gent's law W = -mu Jm/2 ln(1 - (I1 - 3)/Jm)."""

    law: Literal["gent"] = Field(description="law")
    mu_kPa: Positive = Field(description="shear modulus [kPa]")
    Jm: Positive = Field(description="limit of I1 - 3 [-]")


def _law_of(content) -> str:
    """Return the law that given parameters are of; those without a name are Ogden's."""
    return content.get("law", "ogden") if isinstance(content, dict) else getattr(content, "law", "ogden")


LawParameters = Annotated[
    Annotated[OgdenParameters, Tag("ogden")]
    | Annotated[NeoHookeParameters, Tag("neo_hooke")]
    | Annotated[MooneyRivlinParameters, Tag("mooney_rivlin")]
    | Annotated[YeohParameters, Tag("yeoh")]
    | Annotated[GentParameters, Tag("gent")],
    Discriminator(_law_of),
]

LawName = Literal["neo_hooke", "mooney_rivlin", "yeoh", "gent", "ogden1", "ogden2", "ogden3", "ogden4"]
LAW_NAMES: tuple[str, ...] = get_args(LawName)


class Fitting(Section):
    """Which laws are fitted to tests, how, and how one is chosen."""

    laws: Annotated[list[LawName], Field(min_length=1)] = Field(
        ["ogden2"], description="laws to be fitted; ogden2: Ogden's law with two terms"
    )
    choose: Literal["aicc", "held_out", "first"] = Field(
        "aicc",
        description="law.json is the law of lowest AICc among those that describe the tests, the one that predicts"
        " tests left out best, or the first named",
    )
    loss: Literal["linear", "soft_l1"] = Field("linear", description="soft_l1 forgives outliers")
    bootstrap: int = Field(0, ge=0, le=100_000, description="refits over samples for further intervals [-]")

    @model_validator(mode="after")
    def _once(self):
        if len(set(self.laws)) < len(self.laws):
            raise ValueError(f"laws {self.laws}: each law once")
        return self

    def fitting_keys(self) -> dict:
        """Return what decides a fit besides its files."""
        return {name: getattr(self, name) for name in Fitting.model_fields}


class Material(Fitting):
    """One material: either raw tests to be fitted or parameters that are given."""

    tests: Path | None = Field(None, description="folder with samples.csv and one CSV per sample")
    mapping: Path | None = Field(
        None, description="YAML that says what other people's files in `tests` hold; null: samples.csv"
    )
    parameters: LawParameters | None = Field(None, description="a law that is given; nothing is fitted")

    @model_validator(mode="after")
    def _one_source(self):
        if (self.tests is None) == (self.parameters is None):
            raise ValueError(
                "give either `tests` (a folder to fit) or `parameters` (a law), not both or neither"
            )
        if self.mapping and self.parameters:
            raise ValueError("`mapping` describes the files of `tests`; with `parameters` nothing is read")
        return self
