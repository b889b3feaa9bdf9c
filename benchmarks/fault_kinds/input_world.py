"""A small study with every kind of input file that gelforge reads; SYNTHETIC, made from formulas in a second.

The recordings follow Hertz's ball on a half-space with a load cell's noise and rounding, the material tests an Ogden law.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

MODULUS_MPA, RADIUS_MM = 0.06, 5.0
MU_MPA = 0.02  # neo-Hookean, of the gel's tests
DEPTHS_MM = (0.4, 0.8)
SITES = [(x, y) for x in (10.0, 16.0, 22.0) for y in (10.0, 16.0, 22.0)]
SIZE_PX = (128, 96)


@dataclass(frozen=True)
class Input:
    """One input file: where it lies, which command reads it, and what its columns are."""

    path: str
    command: str  # a name of inputs.COMMANDS
    numbers: tuple[str, ...] = ()  # columns of a table that decide results, each with a value in every row
    separator: str = ","

    @property
    def is_table(self) -> bool:
        return bool(self.numbers)


STUDY = """\
study: small
data: data
seed: 3
materials:
  gel: {tests: data/materials/gel, laws: [neo_hooke]}
  foreign: {tests: data/exports, mapping: mapping.yaml, laws: [neo_hooke]}
  skin: {parameters: {mu_kPa: [85.1168, -0.0020], alpha: [2.8991, -8.2915]}}
sensor: sensor.yaml
indenter: indenter.yaml
plan: {file: plan.csv, approach: vertical}
mechanics:
  friction: 0.45
  bulk_to_shear: 1000.0
  mesh: {near_mm: 1.0, near_radius_mm: 3.0, far_mm: 3.0}
  effects:
    material: {stiffness_factor: {gel: 1.02}}
    geometry: {thickness: {gel: {change_mm: 0.1}}}
sessions: [day, night]
features: {regions: 8, moved_px: 0.05}
dataset: {cells_per_shard: 4, test_fraction: 0.3}
learning: {hidden: [32, 16], steps: 5, validation_fraction: 0.3}
mismatch: {sites: 4}
"""
SENSOR = """\
width_x_mm: 32.0
width_y_mm: 32.0
layers:
  - {name: gel, thickness_mm: 4.5, material: gel, particle_volume_fraction: 0.02}
  - {name: cover, thickness_mm: 1.5, material: skin}
wall_mm: 1.5
flange: {width_mm: 6.5, height_mm: 1.5}
bins: {nx: 20, ny: 20}
"""
INDENTER = (
    "kind: cylinder\nradius_mm: 3.0\nlength_mm: 10.0\nedge_radius_mm: 1.0\norientation_deg: [0, 0, 0]\n"
)
SESSION = """\
session: {name}
sensor: S1
indenter: steel pin
date: 2026-03-02
notes: made from formulas, SYNTHETIC
temperature_C: 22.5
sensor_age_days: 30
force:
  acts_on: sensor
  axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
  tared: false
  resolution_N: [0.002, 0.002, 0.002]
  range_N: [20, 20, 40]
stage_to_sensor: {{origin_mm: [1.0, 2.0], rotation_deg: 0.0, handedness: right}}
depth_zero: {{by: session, how: force threshold}}
"""
CAMERA = """\
camera:
  width_px: 128
  height_px: 96
  focal_px: 80.0
  centre_px: [64.0, 48.0]
  position_mm: [16.0, 16.0, -25.0]
  mirrored: true
"""
MAPPING = """\
describes: strips pulled by somebody's machine, SYNTHETIC
tests:
  - files: ['strip_*.csv']
    kind: uniaxial
    material: foreign
    table: {separator: ';', decimal: ',', header_begins_with: Zeit}
    time: {column: Zeit, unit: s}
    strain: {column: Weg, unit: mm, measure: displacement}
    stress: {column: Kraft, unit: N, measure: force}
    gauge_length_mm: 40
    cross_section_mm2: 12.5
    plausible_shear_modulus_kPa: [10, 100]
"""
LAB = """\
serial: V1
materials:
  gel: {mu_kPa: [7.9652, 0.3093], alpha: [1.2769, 3.5676]}
  skin: {mu_kPa: [85.1168, -0.0020], alpha: [2.8991, -8.2915]}
stiffness_scale: {gel: 1.05}
mechanics: {friction: 0.4, mesh: {near_mm: 0.9, near_radius_mm: 3.0, far_mm: 2.5}}
unload_depths_mm: [0.6, 0.3]
camera: {width_px: 128, height_px: 96, focal_px: 80.0, centre_px: [64.0, 48.0], position_mm: [16.0, 16.0, -25.0]}
force: {noise_N: [0.008, 0.008, 0.015], resolution_N: [0.03, 0.03, 0.06]}
sessions:
  - {session: day, date: '2026-03-02', share: 1.0, seed: 1}
material_tests: {samples: 3, stiffness_scatter: 0.02, noise: 0.005, seed: 7}
"""
LOGS_MAPPING = """\
describes: logs of a stage and a force sensor, SYNTHETIC
force: {file: ft.csv, time: {column: time_s, unit: s}, columns: [fx_N, fy_N, fz_N], unit: N}
stage: {file: stage.csv, time: {column: time_s, unit: s}, x: x_mm, y: y_mm, z: z_mm, unit: mm, pressing: -z}
depth_zero: session
session: {sensor: S1, indenter: ball, synthetic: true, force: {acts_on: sensor}}
"""
FORCES = ("fx_N", "fy_N", "fz_N")
PLACES = ("x_mm", "y_mm", "depth_mm")
INPUTS = [
    Input("study.yaml", "plan"),
    Input("sensor.yaml", "plan"),
    Input("indenter.yaml", "plan"),
    Input("plan.csv", "plan", PLACES),
    Input("lab.yaml", "lab"),
    Input("data/recordings/day/session.yaml", "day"),
    Input("data/recordings/day/indentations.csv", "day", ("order", "time_s", "x_mm", "y_mm", *FORCES)),
    Input("data/recordings/night/session.yaml", "night"),
    Input("data/recordings/night/indentations.csv", "night", ("order", "time_s", "x_mm", "y_mm")),
    Input("data/recordings/night/ft.csv", "night", ("time_s", *FORCES)),
    Input("data/materials/gel/samples.csv", "gel", ("width_mm", "thickness_mm")),
    Input("data/materials/gel/uniaxial_1.csv", "gel", ("time_s", "force_N", "stretch_1")),
    Input(
        "data/materials/gel/inflation_1.csv", "gel", ("time_s", "pressure_kPa", "apex_radius_mm", "stretch_1")
    ),
    Input("data/materials/gel/curve.csv", "gel", ("stretch_1", "nominal_stress_kPa")),
    Input("data/materials/gel/friction.csv", "gel", ("tilt_deg",)),
    Input("data/materials/gel/thickness.csv", "gel", ("thickness_mm",)),
    Input("data/materials/gel/ball.csv", "gel", ("depth_mm", "force_N")),
    Input("data/materials/gel/ball.yaml", "gel"),
    Input("mapping.yaml", "foreign"),
    Input("data/exports/strip_1.csv", "foreign", ("Zeit", "Weg", "Kraft"), ";"),
]
EXPORT = INPUTS[-1]
LOGS = [
    Input("ft.csv", "logs", ("time_s", *FORCES)),
    Input("stage.csv", "logs", ("time_s", "x_mm", "y_mm", "z_mm")),
]
SURFACE = Input("ball.obj", "surface")


def write_world(folder: Path) -> None:
    """Write the study into an empty folder."""
    for name, text in {
        "study.yaml": STUDY,
        "sensor.yaml": SENSOR,
        "indenter.yaml": INDENTER,
        "mapping.yaml": MAPPING,
        "lab.yaml": LAB,
        "logs.yaml": LOGS_MAPPING,
    }.items():
        (folder / name).write_text(text)
    (folder / "synthetic.yaml").write_text(
        STUDY.replace("[day, night]", "[day]").replace("data: data", "data: lab_data")
        + "virtual_lab: lab.yaml\n"
    )
    rows = [f"s{i},{x:g},{y:g},{d:g}" for i, (x, y) in enumerate(SITES) for d in DEPTHS_MM]
    (folder / "plan.csv").write_text("\n".join(["cell,x_mm,y_mm,depth_mm", *rows]) + "\n")
    _write_tests(folder / "data/materials/gel")
    _write_exports(folder / "data/exports")
    _write_logs(folder)
    _write_ball(folder / "ball.obj")
    for seed, name in enumerate(("day", "night")):
        _write_recording(folder / "data/recordings" / name, seed, images=name == "day", log=name == "night")


def _table(path: Path, columns: dict, form: str = "{:.6g}", separator: str = ",") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cells = [[v if isinstance(v, str) else form.format(v) for v in values] for values in columns.values()]
    lines = [separator.join(columns), *(separator.join(row) for row in zip(*cells))]
    path.write_text("\n".join(lines) + "\n")


def _write_tests(folder: Path) -> None:
    rng = np.random.default_rng(5)
    lam = np.linspace(1.0, 1.8, 60)
    samples = []
    for k in (1, 2, 3):
        mu = MU_MPA * (1 + 0.02 * (k - 2))
        force = 20 * mu * (lam - lam**-2) + rng.normal(0, 0.002, len(lam))
        _table(folder / f"uniaxial_{k}.csv", {"time_s": (lam - 1) / 0.05, "force_N": force, "stretch_1": lam})
        inflated = lam[1:]
        pressure = 2 * 0.5 * inflated**-2 * mu * (inflated**2 - inflated**-4) / 40 * 1e3
        columns = {"time_s": inflated, "pressure_kPa": pressure, "apex_radius_mm": np.full(59, 40.0)}
        _table(folder / f"inflation_{k}.csv", columns | {"stretch_1": inflated})
        samples += [
            (f"uniaxial_{k}.csv", "uniaxial", k, "10", "2"),
            (f"inflation_{k}.csv", "equibiaxial", k, "10", "0.5"),
        ]
    _table(folder / "curve.csv", {"stretch_1": lam, "nominal_stress_kPa": 1e3 * MU_MPA * (lam - lam**-3)})
    samples.append(("curve.csv", "pure_shear", 1, "10", "2"))
    lines = [f"{file},{test},{k},{w},40,{h},0.05,20,22," for file, test, k, w, h in samples]
    header = "file,test,sample,width_mm,gauge_length_mm,thickness_mm,strain_rate_per_s,age_days,temperature_C,cycle"
    (folder / "samples.csv").write_text("\n".join([header, *lines]) + "\n")
    _table(folder / "friction.csv", {"trial": range(8), "tilt_deg": 24 + rng.normal(0, 0.5, 8)})
    sections = {"sample": ["1"] * 4, "section": range(4), "thickness_mm": 2 + rng.normal(0, 0.02, 4)}
    _table(folder / "thickness.csv", sections)
    z = np.linspace(0, 0.3, 120)
    d = np.maximum(z - 0.05, 0)
    push = 16 / 9 * MODULUS_MPA * np.sqrt(2.0) * d**1.5 + rng.normal(0, 2e-5, len(z))
    _table(folder / "ball.csv", {"depth_mm": z, "force_N": push})
    (folder / "ball.yaml").write_text("ball_radius_mm: 2.0\nlayer_thickness_mm: 20.0\n")


def _write_exports(folder: Path) -> None:
    rng = np.random.default_rng(6)
    lam = np.linspace(1.0, 1.8, 60)
    folder.mkdir(parents=True)
    for k in (1, 2, 3):
        force = 12.5 * MU_MPA * (lam - lam**-2) + rng.normal(0, 0.002, 60)
        rows = [f"{t:.3f};{w:.4f};{f:.5f};1" for t, w, f in zip(20 * (lam - 1), 40 * (lam - 1), force)]
        lines = [
            "Pruefmaschine 7",
            "",
            "Zeit;Weg;Kraft;Zyklus",
            "(s);(mm);(N);",
            *(r.replace(".", ",") for r in rows),
        ]
        (folder / f"strip_{k}.csv").write_text("\n".join(lines) + "\n")


def _write_logs(folder: Path) -> None:
    """Write the logs of a stage and of a force sensor whose clock shows 0.4 s more."""
    rng = np.random.default_rng(8)
    corners, at = [(0.0, 1.5)], []  # time, height above the surface
    for depth in (0.6, 1.0, 0.8, 0.5, 0.9):
        start = corners[-1][0] + rng.uniform(1.0, 1.6)
        down, wait = (1.5 + depth) / 2, rng.uniform(1.0, 1.6)
        ends = np.cumsum([start, down, wait, down])
        corners += list(zip(ends, (1.5, -depth, -depth, 1.5)))
        at.append(ends[-1] + 0.4)
    times, heights = np.array([*corners, (corners[-1][0] + 1.5, 1.5)]).T
    stage = np.arange(0, times[-1], 1 / 40)
    number = np.searchsorted(at, stage)
    z = 30 + np.interp(stage, times, heights) + rng.normal(0, 3e-4, len(stage))
    columns = {"time_s": stage, "x_mm": 10 + 3.0 * number, "y_mm": 12 + 0.0 * number, "z_mm": z}
    _table(folder / "stage.csv", columns, "{:.7g}")
    clock = np.arange(0.2, times[-1] - 0.2, 1 / 100)
    push = 1.2 * np.maximum(-np.interp(clock, times, heights), 0) ** 1.5
    force = {
        name: offset + share * push + rng.normal(0, 2e-3, len(clock))
        for name, offset, share in zip(FORCES, (0.2, -0.1, 0.6), (0.02, 0.01, -1.0))
    }
    _table(folder / "ft.csv", {"time_s": clock + 0.4} | force, "{:.7g}")


def _write_ball(path: Path, radius: float = 5.0, rings: int = 10, sides: int = 16) -> None:
    """Write a ball of quadrilaterals with a polygon at each pole."""
    polar, around = np.arange(1, rings) * np.pi / rings, np.arange(sides) * 2 * np.pi / sides
    points = [
        radius * np.array([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)])
        for p in polar
        for a in around
    ]
    ring = [[i * sides + k + 1 for k in range(sides)] for i in range(rings - 1)]
    faces = [ring[0], ring[-1][::-1]]
    for upper, lower in zip(ring, ring[1:]):
        faces += [[upper[k - 1], lower[k - 1], lower[k], upper[k]] for k in range(sides)]
    lines = ["v " + " ".join(f"{c:.6f}" for c in point) for point in points]
    path.write_text("\n".join([*lines, *("f " + " ".join(map(str, face)) for face in faces)]) + "\n")


def _write_recording(folder: Path, seed: int, images: bool, log: bool) -> None:
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True)
    (folder / "session.yaml").write_text(SESSION.format(name=folder.name) + (CAMERA if images else ""))
    presses = [(site, depth) for site in SITES for depth in DEPTHS_MM]
    rows = []
    for order, number in enumerate(rng.permutation(len(presses))):
        (x, y), depth = presses[number]
        rows += _press(rng, order, x, y, depth, images)
    header = "press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image"
    if log:
        time = np.arange(-0.5, rows[-1][3] + 1, 0.05)
        known = np.array([(row[3], *row[10:13]) for row in rows])
        force = [
            np.interp(time, known[:, 0], known[:, k]) + rng.normal(0, 0.002, len(time)) for k in (1, 2, 3)
        ]
        _table(folder / "ft.csv", dict(zip(("time_s", *FORCES), (time, *force))))
        rows = [(*row[:10], "", "", "", row[13]) for row in rows]
    lines = [",".join(v if isinstance(v, str) else f"{v:.6g}" for v in row) for row in rows]
    (folder / "indentations.csv").write_text("\n".join([header, *lines]) + "\n")
    if images:
        _write_images(folder, rows, rng)


def _press(rng, order, x, y, depth, images) -> list[tuple]:
    """Return the rows of one press; the stage's origin lies at (1, 2) mm of the sensor's frame."""
    name, start, offset = f"p{order:02d}", 20.0 * order, np.array([0.12, -0.05, 0.3])

    def row(phase, time, z, dwell, image=""):
        push = 16 / 9 * MODULUS_MPA * np.sqrt(RADIUS_MM) * max(z, 0.0) ** 1.5
        force = offset + np.array([0.03, 0.02, -1.0]) * push + rng.normal(0, 0.003, 3)
        fx, fy, fz = np.round(force / 0.002) * 0.002
        return (
            name,
            "",
            order,
            start + time,
            phase,
            x - 1,
            y - 2,
            z,
            1.0,
            dwell,
            fx,
            fy,
            fz,
            image if images else "",
        )

    rows = [row("zero", 0.2 * k, -1.0, "", f"{name}_z.png" if k == 0 else "") for k in range(4)]
    rows += [row("load", 2 + 0.2 * k, z, 0.0) for k, z in enumerate(np.linspace(0.2, 1.0, 5) * depth)]
    rows += [
        row("dwell", 4 + 0.2 * k, depth, 1 + 0.2 * k, f"{name}_d.png" if k == 0 else "") for k in range(4)
    ]
    return [*rows, row("unload", 6, depth / 2, "")]


def _write_images(folder: Path, rows: list[tuple], rng) -> None:
    (folder / "images").mkdir()
    width, height = SIZE_PX
    spots = cv2.GaussianBlur(rng.integers(0, 255, (height, width)).astype(np.uint8), (0, 0), 1.2)
    cv2.imwrite(str(folder / "reference.png"), spots)
    for row in rows:
        if not row[13]:
            continue
        moved = cv2.warpAffine(
            spots, np.float32([[1, 0, max(row[7], 0)], [0, 1, 0]]), SIZE_PX, borderMode=cv2.BORDER_REFLECT
        )
        noisy = np.clip(moved + rng.normal(0, 1, moved.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / "images" / row[13]), noisy)
