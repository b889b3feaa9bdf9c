"""A study: everything that decides its results."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from gelforge.config.basis.variants import Variant
from gelforge.config.parts.learning import Dataset, Features, Learning
from gelforge.config.parts.materials import Material
from gelforge.config.parts.mechanics import Mechanics
from gelforge.config.parts.mismatch import Mismatch
from gelforge.config.parts.plan import Plan
from gelforge.config.parts.sensor import Indenter, Sensor
from gelforge.config.sessions.synthesis import Synthesis
from gelforge.section import GrownSection, Name

# Functions of gelforge.verification, in the order of the table.
Check = Literal[
    "uniaxial_stress",
    "patch_test",
    "rigid_modes",
    "manufactured_orders",
    "contact_patch",
    "hertz_presses",
    "bonded_layers",
    "balances",
    "energy_and_cycle",
    "augmentation_independence",
    "quarter_turn",
    "partial_slip",
    "pressed_stick_zone",
    "cone_edge",
    "frictionless_slide",
]
# Of the soft layers' height: beyond, a layer under a flat punch keeps less than 40 % of its thickness.
SOFT_SHARE = 0.6


class Study(GrownSection):
    """Everything that decides a study's results."""

    later = ("synthesis", "verification")
    study: Name = Field(description="name; results go to results/<study>")
    data: Path | None = Field(None, description="folder of raw inputs; data/<study> if null")
    seed: int = Field(0, ge=0, description="seed of splits and training [-]")
    materials: dict[Name, Material] = Field(description="materials by name")
    sensor: Sensor = Field(description="the sensor, or a YAML file that describes it")
    indenter: Indenter = Field(Indenter(), description="the indenter, or a YAML file that describes it")
    plan: Plan = Field(description="positions and depths")
    mechanics: Mechanics = Field(Mechanics(), description="the finite-element model")
    sessions: list[Name] = Field(
        [], description="recorded sessions under <data>/recordings; none: labels only"
    )
    features: Features = Field(Features(), description="image features")
    dataset: Dataset = Field(Dataset(), description="shards and splits")
    learning: Learning = Field(Learning(), description="network and training")
    mismatch: Mismatch = Field(Mismatch(), description="how recordings are judged against the simulation")
    variants: dict[Name, Variant] = Field(
        {}, description="indentations under other assumptions, which the report compares with the study's own"
    )
    synthesis: Synthesis | None = Field(
        None,
        description="a training set from simulated sensors: drawn indentations and images; null: none (synthetic)",
    )
    virtual_lab: Path | None = Field(
        None, description="YAML of a virtual lab that makes the sessions (synthetic)"
    )
    verification: list[Check] | None = Field(
        None,
        description="checks of the finite elements that the report has; null: all, a minute's work, and none where the study"
        " makes labels only",
    )

    def __repr__(self) -> str:
        s = self.sensor
        layers = ", ".join(f"{one.name} {one.thickness_mm:g} mm of {one.material}" for one in s.layers)
        given = {
            name: m.parameters.constitutive_model().name if m.parameters else f"from {m.source}"
            for name, m in self.materials.items()
        }
        materials = ", ".join(f"{name} ({source})" for name, source in given.items())
        return (
            f"Study {self.study}: sensor ({s.shape.kind}) {s.width_x_mm:g} x {s.width_y_mm:g} mm, {layers};"
            f" {s.bins.nx} x {s.bins.ny} bins\n  indenter: {self.indenter.kind}; materials: {materials}\n"
            f"  sessions: {', '.join(self.sessions) or 'none'}; results in {self.results_folder}"
        )

    __str__ = __repr__

    @field_validator("data")
    @classmethod
    def _without_braces(cls, folder: Path | None) -> Path | None:
        """Braces in a path are wildcards to the workflow."""
        if folder and set("{}") & set(str(folder)):
            raise ValueError(
                "braces cannot stand in the folder's name; rename the folder and give its new name"
            )
        return folder

    @model_validator(mode="after")
    def _consistent(self):
        for layer in self.sensor.layers:
            if layer.material not in self.materials:
                raise ValueError(
                    f"layer {layer.name}: material {layer.material!r} is not among {sorted(self.materials)}; describe it in"
                    " `materials`, or name one of these in the layer"
                )
        self._shape_consistent()
        if self.plan.depths_mm and self.plan.depths_mm[-1] >= SOFT_SHARE * self.sensor.height_mm:
            raise ValueError(
                f"depth {self.plan.depths_mm[-1]} mm is beyond {SOFT_SHARE} of the soft height {self.sensor.height_mm} mm;"
                " press less deep"
            )
        if self.mechanics.contact_normals == "initial" and self.indenter.kind != "sphere":
            raise ValueError(
                f"contact_normals: initial is for a sphere, not for kind: {self.indenter.kind}; use current"
            )
        if self.plan.symmetry == "d4" and not self.indenter.is_upright_and_round:
            raise ValueError(
                f"plan.symmetry: d4 needs a ball or an upright cylinder, found {self.indenter.words}; use symmetry: auto"
            )
        self.mechanics.effects.check(self.sensor)
        if self.plan.symmetry == "d4" and not self.mechanics.effects.has_symmetry_of_square:
            raise ValueError(
                "plan.symmetry: d4 does not hold for mechanics.effects that have a place, a direction or an order; "
                "use symmetry: auto"
            )
        return self

    def _shape_consistent(self) -> None:
        kind, elements = self.sensor.shape.kind, self.mechanics.mesh.elements
        if kind != "block" and elements == "hexahedra":
            raise ValueError(
                f"mechanics.mesh.elements: hexahedra mesh blocks only, found shape.kind: {kind}; use auto"
            )
        if self.sensor.flange and elements == "tetrahedra":
            raise ValueError("a flange is meshed by hexahedra only; use mechanics.mesh.elements: auto")
        if kind == "surfaces" and self.plan.symmetry == "d4":
            raise ValueError(
                "plan.symmetry: d4 is not known to hold for shape.kind: surfaces; use symmetry: auto"
            )
        if self.virtual_lab and (kind != "block" or elements == "tetrahedra"):
            raise ValueError("the virtual lab draws particles in hexahedra of a block; leave virtual_lab out")
        if self.synthesis and (kind != "block" or elements == "tetrahedra"):
            raise ValueError("synthesis draws particles in hexahedra of a block; leave synthesis out")
        if self.synthesis and self.synthesis.train_on == "both" and not self.sessions:
            raise ValueError(
                "synthesis.train_on: both needs a session; add one to sessions, or set simulated"
            )
        if self.plan.approach == "normal" and self.mechanics.contact_normals == "initial":
            raise ValueError("contact_normals: initial is for a vertical approach; use current")

    @property
    def stores_sensitivities(self) -> bool:
        """Whether the derivatives of every solved site's forces are stored (mismatch.sensitivities)."""
        return self.mismatch.sensitivities == "stored" or (
            self.mismatch.sensitivities == "auto" and self.judges
        )

    @property
    def judges(self) -> bool:
        """Whether a run of the study makes a verdict: it has sessions, and mismatch.judged does not leave it out."""
        return bool(self.sessions) and self.mismatch.judged

    @property
    def verifies(self) -> bool:
        """Whether a run checks the finite elements: not where it makes labels only and names no check."""
        return bool(self.sessions or self.synthesis or self.verification)

    @property
    def has_symmetry_of_square(self) -> bool:
        """Whether the pressed body looks the same from all sides of a square: every indentation has mirror images."""
        return self.sensor_has_symmetry_of_square and self.indenter.is_upright_and_round

    @property
    def sensor_has_symmetry_of_square(self) -> bool:
        """Whether the sensor looks the same from all sides of a square, whatever presses it."""
        square = self.sensor.width_x_mm == self.sensor.width_y_mm and self.sensor.shape.kind != "surfaces"
        return square and self.mechanics.effects.has_symmetry_of_square

    @property
    def mirrors_cells(self) -> bool:
        """Whether sites of the plan are made from their images, which lack derivatives and the gel's displacement."""
        if self.plan.symmetry != "auto":
            return self.plan.symmetry == "d4"
        asks_for_more = self.mechanics.store_displacement or bool(self.mechanics.sensitivities)
        bins = self.sensor.bins
        return self.has_symmetry_of_square and bins.nx == bins.ny and not asks_for_more

    @property
    def tetrahedra(self) -> bool:
        """Whether the sensor is meshed by tetrahedra."""
        return self.sensor.shape.kind != "block" or self.mechanics.mesh.elements == "tetrahedra"

    @property
    def data_folder(self) -> Path:
        return self.data or Path("data") / self.study

    @property
    def results_folder(self) -> Path:
        return Path("results") / self.study

    @property
    def dataset_settings(self) -> dict[str, Any]:
        """The settings that decide the dataset's content; how it is learned from and shown is not among them."""
        return self.model_dump(mode="json", exclude={"learning", "mismatch", "variants", "synthesis"})

    @property
    def training_settings(self) -> dict[str, Any]:
        """The settings that decide what is learnt from the dataset; whether the model is exported is not among them."""
        return self.model_dump(
            mode="json", include={"seed", "learning", "sensor"}, exclude={"learning": {"onnx"}}
        )

    def session_folder(self, session: str) -> Path:
        return self.data_folder / "recordings" / session
