"""Study, session and virtual-lab descriptions: YAML in, validated models out.

This is the only module that names configuration keys and the only one that reads YAML. Keys carry their unit; nothing is
converted here. An unknown or out-of-range key is refused with its full path, the value found and the limit.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

NAME = re.compile(r"[A-Za-z0-9_-]+")


class ConfigError(ValueError):
    """A configuration that cannot be used: where, what was found, what is allowed."""


def _check_name(name: str) -> str:
    if not NAME.fullmatch(name):
        raise ValueError(f"{name!r} is not a name; use letters, digits, '_' and '-'")
    return name


Name = Annotated[str, AfterValidator(_check_name)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, lt=1)]


class Section(BaseModel):
    """A block of keys; what it does not name is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


# ---------------------------------------------------------------------------------------------- materials
class OgdenParameters(Section):
    """Ogden's law in the convention W = sum mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3)."""

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


class Material(Section):
    """One material: either raw tests to be fitted or parameters that are given."""

    tests: Path | None = Field(None, description="folder with samples.csv and one CSV per sample")
    ogden_terms: int = Field(2, ge=1, le=3, description="number of Ogden terms K to be fitted [-]")
    parameters: OgdenParameters | None = Field(None, description="a law that is given; nothing is fitted")

    @model_validator(mode="after")
    def _one_source(self):
        if (self.tests is None) == (self.parameters is None):
            raise ValueError(
                "give either `tests` (a folder to fit) or `parameters` (a law), not both or neither"
            )
        return self


# ------------------------------------------------------------------------------------------------- sensor
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
    """Regular bins of the undeformed top surface that carry the label."""

    nx: int = Field(20, ge=1, le=200, description="number of bins along x [-]")
    ny: int = Field(20, ge=1, le=200, description="number of bins along y [-]")


class Sensor(Section):
    """A layered block on a rigid base; the frame's origin is a corner of the undeformed top surface."""

    width_x_mm: Positive = Field(32.0, description="outer width along x [mm]")
    width_y_mm: Positive = Field(32.0, description="outer width along y [mm]")
    layers: list[Layer] = Field(min_length=1, description="soft layers from the base up")
    wall_mm: NonNegative = Field(1.5, description="thickness of the side wall around the lower layers [mm]")
    flange: Flange | None = Field(None, description="rim of the wall's material on the base, or null")
    bins: Bins = Field(Bins(), description="surface bins of the label")

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
        return self

    @property
    def height_mm(self) -> float:
        return sum(layer.thickness_mm for layer in self.layers)


class Indenter(Section):
    """The rigid body that presses."""

    kind: Literal["sphere"] = Field("sphere", description="shape")
    radius_mm: Positive = Field(5.0, description="radius of the ball [mm]")


# --------------------------------------------------------------------------------------------------- plan
class Grid(Section):
    """A regular, centred grid of positions."""

    spacing_mm: Positive = Field(description="distance between neighbours [mm]")
    margin_mm: NonNegative = Field(5.0, description="distance of the outermost positions from the edges [mm]")


class Plan(Section):
    """Where and how deep the indenter presses: a grid with depths, or a CSV file."""

    grid: Grid | None = Field(None, description="regular grid of positions")
    depths_mm: list[Positive] | None = Field(None, description="increasing depths of every position [mm]")
    file: Path | None = Field(None, description="CSV with cell, x_mm, y_mm, depth_mm")
    symmetry: Literal["d4", "none"] = Field(
        "none", description="reuse cells that mirror and rotate into each other"
    )

    @model_validator(mode="after")
    def _one_source(self):
        if (self.grid is None) == (self.file is None):
            raise ValueError("give either `grid` with `depths_mm` or `file`, not both or neither")
        if (self.grid is None) != (self.depths_mm is None):
            raise ValueError("`depths_mm` belongs to `grid`; a plan file has its own depths")
        if self.depths_mm and any(b <= a for a, b in zip(self.depths_mm, self.depths_mm[1:])):
            raise ValueError(f"depths_mm {self.depths_mm} must increase")
        return self


# ---------------------------------------------------------------------------------------------- mechanics
class Mesh(Section):
    """Sizes of the graded hexahedral mesh."""

    near_mm: Positive = Field(0.5, description="element size under the contact [mm]")
    near_radius_mm: Positive = Field(3.6, description="half width of the fine region around the contact [mm]")
    far_mm: Positive = Field(1.5, description="largest horizontal element size [mm]")
    growth: float = Field(
        1.35, gt=1, le=3, description="growth of horizontal size per mm of distance + 1 [-]"
    )
    vertical_far_mm: Positive = Field(0.8, description="largest vertical element size, at the base [mm]")
    vertical_growth: float = Field(
        1.15, gt=1, le=3, description="growth of vertical size per mm of depth + 1 [-]"
    )
    wall_elements: int = Field(
        3, ge=1, le=20, description="least elements through a wall near the contact [-]"
    )


class Contact(Section):
    """Constants of the contact algorithm; results do not depend on them within the tolerance."""

    normal_stiffness_N_per_mm3: Positive = Field(20.0, description="augmentation stiffness [N/mm^3]")
    tangential_stiffness_N_per_mm3: Positive = Field(
        3.0, description="elastic slip stiffness of friction [N/mm^3]"
    )


class Solver(Section):
    """Stopping rules of the Newton iteration."""

    force_tolerance: float = Field(1e-6, gt=0, le=1e-2, description="unbalanced force over contact force [-]")
    gap_tolerance_mm: float = Field(
        1e-4, gt=0, le=1e-2, description="largest penetration of a contact node [mm]"
    )
    max_iterations: int = Field(40, ge=2, le=500, description="Newton iterations of one depth step [-]")
    max_halvings: int = Field(
        4, ge=0, le=10, description="times a depth step may be halved before giving up [-]"
    )
    linear_solver: Literal["auto", "pardiso", "superlu"] = Field("auto", description="sparse direct solver")


class Mechanics(Section):
    """The finite-element model of one press."""

    strain: Literal["finite", "small"] = Field(
        "finite", description="finite strain, or small-strain linear elasticity"
    )
    contact_normals: Literal["current", "initial"] = Field(
        "current", description="contact normals of the ball (current) or of the undeformed surface (initial)"
    )
    friction: float = Field(0.45, ge=0, le=2, description="Coulomb friction coefficient [-]")
    bulk_to_shear: float = Field(
        1000.0, ge=10, le=1e5, description="bulk modulus over shear modulus of each layer [-]"
    )
    binning: Literal["shape_function", "node"] = Field(
        "shape_function",
        description="share nodal forces by shape functions, or give them to the bin of the node",
    )
    mesh: Mesh = Field(Mesh(), description="mesh sizes")
    contact: Contact = Field(Contact(), description="contact constants")
    solver: Solver = Field(Solver(), description="stopping rules")
    store_displacement: bool = Field(False, description="keep the gel's displacement in the cell file")

    @model_validator(mode="after")
    def _normals(self):
        if self.contact_normals == "initial" and self.strain == "finite":
            raise ValueError("contact_normals: initial belongs to strain: small")
        return self


# ----------------------------------------------------------------------------- recordings, dataset, model
class Features(Section):
    """Optical-flow features of an image."""

    regions: int = Field(40, ge=1, le=200, description="image regions along each side; m = regions^2 [-]")
    flow_preset: Literal["ultrafast", "fast", "fine", "medium"] = Field(
        "fine",
        description="preset of Dense Inverse Search; fine: fast, but at half resolution without smoothing",
    )
    moved_px: NonNegative = Field(
        0.05, description="pixels that moved less do not vote on the direction [px]"
    )


class Dataset(Section):
    """How rows become shards and splits."""

    test_fraction: float = Field(0.2, gt=0, lt=1, description="share of cells held out for testing [-]")
    cells_per_shard: int = Field(16, ge=1, description="cells in one shard file [-]")


class Learning(Section):
    """The network of Sferrazza et al. 2019, table 2, and how it is trained."""

    input_form: Literal["vector", "polar"] = Field(
        "polar",
        description="feed each region's magnitude and direction (polar) or the flow's components (vector)",
    )
    hidden: list[Annotated[int, Field(ge=1)]] = Field(
        [800, 600, 400], description="widths of the hidden layers [-]"
    )
    dropout: float = Field(0.1, ge=0, lt=1, description="dropout after each hidden layer [-]")
    learning_rate: Positive = Field(1e-4, description="Adam's step size [-]")
    batch_size: int = Field(400, ge=1, description="rows per step [-]")
    epochs: int = Field(400, ge=1, description="passes over the training rows [-]")
    validation_fraction: float = Field(
        0.1, gt=0, lt=1, description="share of training cells that watch the loss [-]"
    )


class Study(Section):
    """Everything that decides a study's results."""

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
    virtual_lab: Path | None = Field(
        None, description="YAML of a virtual lab that makes the sessions (synthetic)"
    )

    @model_validator(mode="after")
    def _consistent(self):
        for layer in self.sensor.layers:
            if layer.material not in self.materials:
                raise ValueError(
                    f"layer {layer.name}: material {layer.material!r} is not among {sorted(self.materials)}"
                )
        if self.plan.depths_mm and self.plan.depths_mm[-1] >= 0.6 * self.sensor.height_mm:
            raise ValueError(
                f"depth {self.plan.depths_mm[-1]} mm is beyond 0.6 of the soft height {self.sensor.height_mm} mm;"
                " press less deep"
            )
        if self.plan.depths_mm and self.plan.depths_mm[-1] > self.indenter.radius_mm:
            raise ValueError(
                f"depth {self.plan.depths_mm[-1]} mm exceeds the ball's radius {self.indenter.radius_mm} mm"
            )
        return self

    @property
    def data_folder(self) -> Path:
        return self.data or Path("data") / self.study

    @property
    def results_folder(self) -> Path:
        return Path("results") / self.study

    def session_folder(self, session: str) -> Path:
        return self.data_folder / "recordings" / session


# --------------------------------------------------------------------------------------------- recordings
class ForceSensor(Section):
    """What makes a stranger's force readings readable."""

    acts_on: Literal["sensor", "indenter"] = Field(
        "sensor", description="body on which the recorded force acts"
    )
    axes: list[list[float]] = Field(
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        description="3x3 rotation from the recorded axes to the sensor frame [-]",
    )
    tared: bool = Field(
        False, description="zero already subtracted; if false each press's zero rows are used"
    )
    resolution_N: list[Positive] = Field([0.03, 0.03, 0.06], description="resolution of x, y, z [N]")
    range_N: list[Positive] | None = Field(None, description="largest force of x, y, z [N]")
    repeatability_N: NonNegative | None = Field(None, description="scatter of repeated readings [N]")

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
        for name in ("resolution_N", "range_N"):
            if getattr(self, name) is not None and len(getattr(self, name)) != 3:
                raise ValueError(f"{name} needs three numbers (x, y, z)")
        return self


class StageToSensor(Section):
    """Commanded stage position -> sensor frame: x_sensor = R(rotation) H x_stage + origin."""

    origin_mm: list[float] = Field(
        [0.0, 0.0], min_length=2, max_length=2, description="stage origin in the frame [mm]"
    )
    rotation_deg: float = Field(0.0, description="rotation about z, counter-clockwise [deg]")
    handedness: Literal["right", "left"] = Field(
        "right", description="left: the stage's y axis is flipped first"
    )


class DepthZero(Section):
    """How depth zero was found."""

    by: Literal["session", "press"] = Field("session", description="once per session or at every press")
    how: str = Field("", description="procedure in words")


class Camera(Section):
    """A camera under the gel that looks up; pixel (0, 0) is the centre of the image's top left pixel.

    Seen from below with y up, x runs to the left: u = centre - focal x / z. A mirrored image runs with x as from above.
    Either a pinhole (focal_px, position_mm is the pinhole) or a flat scale (mm_per_px, position_mm is seen at centre_px).
    """

    width_px: int = Field(gt=0, description="image width [px]")
    height_px: int = Field(gt=0, description="image height [px]")
    focal_px: Positive | None = Field(None, description="focal length of a pinhole camera [px]")
    mm_per_px: Positive | None = Field(None, description="flat scale, where intrinsics are unknown [mm/px]")
    centre_px: list[float] = Field(min_length=2, max_length=2, description="principal point u, v [px]")
    position_mm: list[float] = Field(
        min_length=3,
        max_length=3,
        description="pinhole, or the point seen at centre_px, in the sensor frame [mm]",
    )
    rotation_deg: list[float] = Field(
        [0.0, 0.0, 0.0],
        min_length=3,
        max_length=3,
        description="turns of the camera about the sensor's x, then y, then z axis, from looking straight up [deg]",
    )
    mirrored: bool = Field(
        True,
        description="true: u grows with x as seen from above (the image was flipped); false: as the camera sees it",
    )

    @model_validator(mode="after")
    def _one_scale(self):
        if (self.focal_px is None) == (self.mm_per_px is None):
            raise ValueError(
                "give either focal_px (a pinhole) or mm_per_px (a flat scale), not both or neither"
            )
        return self


class Session(Section):
    """One recording session: session.yaml."""

    session: Name = Field(description="name of the session, equal to its folder")
    synthetic: bool = Field(False, description="true: made by a virtual lab, not measured")
    sensor: str = Field("", description="serial or name of the sensor that was pressed")
    indenter: str = Field("", description="indenter used")
    date: str = Field("", description="date of the session")
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


# -------------------------------------------------------------------------------------------- virtual lab
class VirtualParticles(Section):
    """Tracer particles in the gel."""

    diameter_mm: float = Field(0.3, ge=0.15, le=0.6, description="particle diameter [mm]")
    volume_fraction: float = Field(0.0196, gt=0, le=0.1, description="share of the gel's volume [-]")


class VirtualImaging(Section):
    """How the virtual camera draws."""

    blur_px: NonNegative = Field(0.7, description="Gaussian blur of the optics, standard deviation [px]")
    noise_grey: NonNegative = Field(2.0, description="standard deviation of the sensor noise [grey levels]")
    background_grey: float = Field(
        24.0, ge=0, le=255, description="grey level of the skin behind the particles [-]"
    )
    particle_grey: float = Field(
        210.0, ge=0, le=255, description="grey level of the nearest particle's middle [-]"
    )
    images_per_press: int = Field(5, ge=1, description="images at the commanded depth [-]")


class VirtualForce(Section):
    """How the virtual force sensor reads."""

    noise_N: list[NonNegative] = Field(
        [0.008, 0.008, 0.015], min_length=3, max_length=3, description="noise [N]"
    )
    resolution_N: list[Positive] = Field(
        [0.03, 0.03, 0.06], min_length=3, max_length=3, description="steps [N]"
    )
    offset_N: list[NonNegative] = Field(
        [0.05, 0.05, 0.1],
        min_length=3,
        max_length=3,
        description="scatter of the untared zero of a session [N]",
    )
    touchdown_mm: NonNegative = Field(0.01, description="scatter of the touchdown of a press [mm]")


class VirtualSession(Section):
    """One session of the virtual lab."""

    session: Name = Field(description="name")
    date: str = Field(description="date written into session.yaml")
    share: float = Field(
        gt=0,
        le=1,
        description="share of the plan's cells pressed in this session, relative to the others [-]",
    )
    seed: int = Field(ge=0, description="seed of order, noise and touchdown [-]")
    acts_on: Literal["sensor", "indenter"] = Field(
        "indenter", description="body on which the recorded force acts"
    )
    axes: list[list[float]] = Field(
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        description="rotation from the force sensor's axes to the sensor frame [-]",
    )
    stage_to_sensor: StageToSensor = Field(StageToSensor(), description="how the stage stands to the sensor")


class VirtualSample(Section):
    """Scatter of the virtual material tests."""

    samples: int = Field(6, ge=1, description="samples per test [-]")
    stiffness_scatter: NonNegative = Field(0.02, description="standard deviation of a sample's stiffness [-]")
    noise: NonNegative = Field(0.005, description="reading noise over the largest reading [-]")
    seed: int = Field(7, ge=0, description="seed [-]")


class VirtualLab(Section):
    """A sensor whose true physics is known: makes synthetic recordings and material tests."""

    serial: Name = Field(description="serial of the virtual sensor; seeds its particles")
    materials: dict[Name, OgdenParameters] = Field(description="true laws of the coupons")
    stiffness_scale: dict[Name, Positive] = Field(
        {}, description="concealed factor on a layer's stiffness, by layer"
    )
    mechanics: Mechanics = Field(
        Mechanics(mesh=Mesh(near_mm=0.55, far_mm=1.2)),
        description="the virtual sensor's own model, on another mesh",
    )
    unload_depths_mm: list[Positive] = Field(
        [1.5, 1.0, 0.5], description="depths visited after the deepest press [mm]"
    )
    particles: VirtualParticles = Field(VirtualParticles(), description="tracer particles")
    camera: Camera = Field(description="camera")
    imaging: VirtualImaging = Field(VirtualImaging(), description="drawing")
    force: VirtualForce = Field(VirtualForce(), description="force sensor")
    sessions: list[VirtualSession] = Field(min_length=1, description="sessions")
    material_tests: VirtualSample = Field(VirtualSample(), description="material tests")

    @model_validator(mode="after")
    def _consistent(self):
        names = [session.session for session in self.sessions]
        if len(set(names)) < len(names):
            raise ValueError(f"sessions {names}: each session needs a name of its own")
        if any(b >= a for a, b in zip(self.unload_depths_mm, self.unload_depths_mm[1:])):
            raise ValueError(f"unload_depths_mm {self.unload_depths_mm} must decrease")
        if self.camera.focal_px is None:
            raise ValueError("camera: the virtual camera is a pinhole; give focal_px")
        return self


# -------------------------------------------------------------------------------------------------- files
def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; name a YAML file that exists") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: not valid YAML ({error})") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: a mapping of keys is expected, found {type(content).__name__}")
    return content


def _validated(model: type[Section], content: dict[str, Any], source: str):
    try:
        return model.model_validate(content)
    except ValidationError as error:
        lines = []
        for item in error.errors():
            key = ".".join(str(part) for part in item["loc"]) or "(whole file)"
            found = "" if isinstance(item["input"], dict) else f", found {item['input']!r}"
            remedy = (
                "unknown key; see config/schema.json for the keys"
                if item["type"] == "extra_forbidden"
                else item["msg"]
            )
            lines.append(f"{source}: {key}{found}: {remedy}")
        raise ConfigError("\n".join(lines)) from None


def study_from(content: dict[str, Any], source: str = "config") -> Study:
    """Return the validated study of a configuration mapping; `sensor` and `indenter` may name YAML files."""
    content = dict(content)
    for key in ("sensor", "indenter"):
        if isinstance(content.get(key), str):
            content[key] = _read_yaml(Path(content[key]))
    return _validated(Study, content, source)


def load_study(path: str | Path) -> Study:
    """Return the validated study described by a YAML file."""
    return study_from(_read_yaml(Path(path)), str(path))


def load_session(path: str | Path) -> Session:
    """Return the validated session described by a session.yaml."""
    return _validated(Session, _read_yaml(Path(path)), str(path))


def load_virtual_lab(path: str | Path) -> VirtualLab:
    """Return the validated virtual lab described by a YAML file."""
    return _validated(VirtualLab, _read_yaml(Path(path)), str(path))


def load_section(path: str | Path, model: type[Section]) -> Any:
    """Return the validated section of another kind (a mapping of columns, a small test) that a YAML file holds."""
    return _validated(model, _read_yaml(Path(path)), str(path))


def write_yaml(path: str | Path, section: Section) -> None:
    """Write a section as YAML, keys in the order of the model."""
    Path(path).write_text(yaml.safe_dump(section.model_dump(mode="json"), sort_keys=False), encoding="utf-8")


def schema() -> dict[str, Any]:
    """Return the JSON schema of a study's configuration; config/schema.json holds it."""
    return Study.model_json_schema()
