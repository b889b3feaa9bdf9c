"""Materials: raw tests to be fitted, or parameters that are given."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Discriminator, Field, Tag, model_validator

from gelforge.config.common import Positive, Section

# Keys with which other programs state compressibility, which belongs to mechanics here
COMPRESSIBILITY = {"D1", "D2", "D3", "D", "d", "d1", "K", "nu", "K_kPa", "D1_kPa", "D1_per_kPa"}


class GivenParameters(Section):
    """Parameters of a constitutive model that are given; all are of the incompressible (isochoric) part."""

    @model_validator(mode="before")
    @classmethod
    def _isochoric_only(cls, content):
        found = sorted(COMPRESSIBILITY & set(content)) if isinstance(content, dict) else []
        if found:
            raise ValueError(
                f"{found} state(s) compressibility, which is mechanics.bulk_to_shear (K/mu; for D1 of Abaqus or d of ANSYS "
                "2 / (D1 mu), and D1 = 0 is incompressible: leave the default); take the key(s) out"
            )
        return content


# By convention: the energy's factor of the term k, the initial shear modulus, who writes it so.
OGDEN_CONVENTIONS = {
    "ogden": ("mu_k/alpha_k", "sum mu_k alpha_k / 2", "Ogden, ANSYS, LS-DYNA, COMSOL"),
    "ansys": ("mu_k/alpha_k", "sum mu_k alpha_k / 2", "Ogden, ANSYS, LS-DYNA, COMSOL"),
    "abaqus": ("2 mu_k/alpha_k^2", "sum mu_k", "Abaqus, Radioss law 82"),
}


class OgdenParameters(GivenParameters):
    """Ogden's model W = sum c_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3), c_k as its convention says."""

    law: Literal["ogden"] = Field("ogden", description="constitutive model")
    mu_kPa: list[float] = Field(min_length=1, max_length=4, description="moduli mu_k [kPa]")
    alpha: list[float] = Field(min_length=1, max_length=4, description="exponents alpha_k [-]")
    convention: Literal["ogden", "ansys", "abaqus"] = Field(
        "ogden",
        description="what mu_kPa means: ogden, ansys: c_k = mu_k/alpha_k, initial shear modulus sum mu_k alpha_k / 2; "
        "abaqus: c_k = 2 mu_k/alpha_k^2, initial shear modulus sum mu_k",
    )

    @model_validator(mode="after")
    def _signs(self):
        if len(self.mu_kPa) != len(self.alpha):
            raise ValueError(f"{len(self.mu_kPa)} mu_kPa but {len(self.alpha)} alpha; give one alpha per mu")
        for mu, alpha in zip(self.mu_kPa, self.alpha):
            if alpha == 0:
                raise ValueError("alpha 0: the term has no energy; leave it out")
            if not (mu > 0 if self.convention == "abaqus" else mu * alpha > 0):
                raise ValueError(self._softening(mu, alpha))
        return self

    def _softening(self, mu: float, alpha: float) -> str:
        """Return why a term is refused, and how the other convention writes it."""
        other = "ogden" if self.convention == "abaqus" else "abaqus"
        own, meant = OGDEN_CONVENTIONS[self.convention], OGDEN_CONVENTIONS[other]
        needed = "mu_k > 0" if self.convention == "abaqus" else "mu_k alpha_k > 0, both of the same sign,"
        return (
            f"mu_kPa {mu:g} with alpha {alpha:g} is a term of negative stiffness: {needed} is needed in convention: "
            f"{self.convention}, energy factor {own[0]}, initial shear modulus {own[1]} ({own[2]}); for parameters written "
            f"with {meant[0]}, initial shear modulus {meant[1]} ({meant[2]}), set convention: {other}"
        )

    @property
    def ogden_mu_kPa(self) -> tuple[float, ...]:
        """The moduli in Ogden's own convention, c_k = mu_k/alpha_k [kPa]."""
        if self.convention == "abaqus":
            return tuple(2 * mu / alpha for mu, alpha in zip(self.mu_kPa, self.alpha))
        return tuple(self.mu_kPa)


class NeoHookeParameters(GivenParameters):
    """The neo-Hookean model W = mu/2 (I1 - 3); C10 of Abaqus is mu/2, mu of ANSYS is mu."""

    law: Literal["neo_hooke"] = Field(description="constitutive model")
    mu_kPa: Positive = Field(description="initial shear modulus, twice the C10 of Abaqus [kPa]")


class MooneyRivlinParameters(GivenParameters):
    """The Mooney-Rivlin model W = C10 (I1 - 3) + C01 (I2 - 3), as in Abaqus, ANSYS; initial shear modulus 2 (C10 + C01)."""

    law: Literal["mooney_rivlin"] = Field(description="constitutive model")
    C10_kPa: Positive = Field(description="C10, as in Abaqus and ANSYS [kPa]")
    C01_kPa: float = Field(description="C01, as in Abaqus and ANSYS [kPa]")

    @model_validator(mode="after")
    def _stable(self):
        if self.C01_kPa < 0:
            raise ValueError(
                f"C01_kPa {self.C01_kPa:g}: with C01 < 0 the stiffness falls without limit in compression; C01 >= 0 is "
                "needed, describe the tests by law: yeoh or ogden instead"
            )
        return self


class YeohParameters(GivenParameters):
    """Yeoh's model W = sum C_k0 (I1 - 3)^k, as in Abaqus and ANSYS; initial shear modulus 2 C10.

    C20 and C30 may be negative: a press is refused where the model is unstable at stretches that it may reach.
    """

    law: Literal["yeoh"] = Field(description="constitutive model")
    C10_kPa: Positive = Field(description="C10, half the initial shear modulus, as in Abaqus and ANSYS [kPa]")
    C20_kPa: float = Field(0.0, description="C20, as in Abaqus and ANSYS [kPa]")
    C30_kPa: float = Field(0.0, description="C30, as in Abaqus and ANSYS [kPa]")


class GentParameters(GivenParameters):
    """Gent's model W = -mu Jm/2 ln(1 - (I1 - 3)/Jm), as in ANSYS; initial shear modulus mu."""

    law: Literal["gent"] = Field(description="constitutive model")
    mu_kPa: Positive = Field(description="initial shear modulus [kPa]")
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
        ["ogden2"], description="constitutive models to be fitted; ogden2: Ogden's model with two terms"
    )
    choose: Literal["aicc", "held_out", "first"] = Field(
        "aicc",
        description="law.json is the constitutive model of lowest AICc among those that describe the tests, the one"
        " that predicts"
        " tests left out best, or the first named",
    )
    loss: Literal["linear", "soft_l1"] = Field("linear", description="soft_l1 forgives outliers")
    bootstrap: int = Field(0, ge=0, le=100_000, description="refits over samples for further intervals [-]")

    @model_validator(mode="after")
    def _once(self):
        if len(set(self.laws)) < len(self.laws):
            raise ValueError(f"laws {self.laws}: each constitutive model once")
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
    parameters: LawParameters | None = Field(
        None, description="a constitutive model that is given; nothing is fitted"
    )
    stiffness_confirmed: bool = Field(
        False, description="true: the initial Young's modulus is meant, also outside 0.5 to 5000 kPa"
    )

    @model_validator(mode="after")
    def _one_source(self):
        if (self.tests is None) == (self.parameters is None):
            raise ValueError(
                "give either `tests` (a folder to fit) or `parameters` (a constitutive model), not both or neither"
            )
        if self.mapping and self.parameters:
            raise ValueError("`mapping` describes the files of `tests`; with `parameters` nothing is read")
        return self
